"""Time of each matcher on one thread against OpenCV's SGBM 3-way, in turn and in one process.

    python -m tests.benchmarks.matchers

On a KITTI stereo 2015 frame where the real data is present, else on a synthetic street.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2
import numpy as np
import psutil

from pseudolidar.geometry.grey import grey8_pair
from pseudolidar.sources.recognise import recognise
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.structures.frame import StereoFrame
from tests.conftest import DATA

DISPARITIES = 128
ROUNDS = 15
BASELINE = "sgbm 3way, compute() alone"


def frame() -> StereoFrame:
    """The pair that is matched."""
    training = DATA / "kitti_stereo2015" / "training"
    source = recognise(str(training) if training.is_dir() else "synthetic:street:1").open()
    print(source.summary.line)
    return source.load(0)


def timed(calls: dict[str, Callable[[], object]]) -> dict[str, list[float]]:
    """Seconds of each call in each round; the calls take turns, so drift hits all alike."""
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(ROUNDS):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            seconds[name].append(time.perf_counter() - begin)
    return seconds


def main() -> None:
    """Print milliseconds and ratios."""
    cv2.setNumThreads(1)
    pair = frame()
    grey = grey8_pair(pair.left, pair.right)
    baseline = Sgbm(disparities=DISPARITIES).build(DISPARITIES)
    settings = {
        "census fast": Census(disparities=DISPARITIES),
        "census fine": Census(quality="fine", disparities=DISPARITIES),
        "census fast, 2 threads": Census(disparities=DISPARITIES, threads=2),
        "census fine, 2 threads": Census(quality="fine", disparities=DISPARITIES, threads=2),
        "sgbm hh": Sgbm(mode="hh", block_size=3, disparities=DISPARITIES),
        "bm": Bm(disparities=DISPARITIES),
    }
    calls: dict[str, Callable[[], object]] = {BASELINE: lambda: baseline.compute(*grey)}
    for name, chosen in settings.items():
        matcher = chosen.load()
        calls[name] = lambda matcher=matcher: matcher(pair)  # type: ignore[misc]
    seconds = timed(calls)
    base = np.array(seconds[BASELINE])
    print(f"{'':28s}   min ms  median ms  ratio to 3way (median of {ROUNDS} rounds)")
    for name, values in seconds.items():
        ratio = np.median(np.array(values) / base)
        print(f"{name:28s} {1e3 * min(values):8.1f} {1e3 * np.median(values):9.1f} {ratio:9.2f}")
    print(f"peak memory of the process: {psutil.Process().memory_info().rss / 2**20:.0f} MiB")


if __name__ == "__main__":
    main()
