"""Frame rate of `obstacles` against that of `convert`, on the same frames with the same matcher.

    python -m tests.benchmarks.obstacle_rate [ROUNDS] [REPEATS] [all]     # 3 rounds, 4 repeats

The labelled frames of KITTI, repeated (by links); labels are the detections. Runs of both verbs
take turns. Start-up and the page, which do not grow with the frames, are taken off by runs of fewer
frames, so many that the pages of both have all their pictures (33 make 6 and 12). `all`: both write
everything that they can, films and recordings included.
"""

from __future__ import annotations

import resource
import shutil
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.benchmarks.conversion import run
from tests.conftest import DATA

ROUNDS, REPEATS = 3, 4
# How often the frames come in the runs that are taken off.
FEWER = 3
TRAINING = DATA / "kitti_object" / "training"
PLAIN = {"convert": ("--to", "pcd"), "obstacles": ()}
EVERYTHING = {
    "convert": ("--to", "pcd,mcap", "--ground", "label", "--video"),
    "obstacles": (
        *("--to", "pcd,mcap,kitti", "--video"),
        *("--track", "tracker", "--corridor", "2x2x30"),
    ),
}


class Cost(NamedTuple):
    """Of a run or of a frame.

    Args:
        wall_s: as the clock says.
        cpu_s: of all cores.
    """

    wall_s: float
    cpu_s: float


def repeated(folder: Path, repeats: int) -> Path:
    """The labelled frames so many times, under new numbers."""
    frames = sorted(path.stem for path in (TRAINING / "label_2").glob("*.txt"))
    training = folder / str(repeats) / "training"
    for name in ("image_2", "image_3", "calib", "label_2"):
        (training / name).mkdir(parents=True)
        for i in range(repeats * len(frames)):
            given = next((TRAINING / name).glob(f"{frames[i % len(frames)]}.*"))
            (training / name / f"{i:06d}{given.suffix}").symlink_to(given)
    return training


def cost(verb: str, training: Path, out: Path, flags: tuple[str, ...]) -> Cost:
    """Of a run."""
    shutil.rmtree(out, ignore_errors=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    wall_s = run("pseudolidar", verb, str(training), str(out), *flags)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Cost(wall_s, cpu_s)


def main() -> None:
    """Print the cost of a frame of both verbs, and ratios of their rates."""
    numbers = [int(one) for one in sys.argv[1:] if one.isdigit()]
    rounds, repeats = (*numbers, *(ROUNDS, REPEATS)[len(numbers) :])
    flags = EVERYTHING if "all" in sys.argv[1:] else PLAIN
    with tempfile.TemporaryDirectory(prefix="pseudolidar_bench_") as name:
        folder, out = Path(name), Path(name) / "out"
        fewer, often = repeated(folder, FEWER), repeated(folder, FEWER + repeats)
        frames = len(list((often / "calib").iterdir())) - len(list((fewer / "calib").iterdir()))
        costs: dict[str, list[Cost]] = {verb: [] for verb in flags}
        whole: dict[str, list[Cost]] = {verb: [] for verb in flags}
        for verb, chosen in flags.items():
            cost(verb, fewer, out, chosen)  # kernels and page cache are warm after it
        for _ in range(rounds):
            for verb, chosen in flags.items():
                less, more = (cost(verb, source, out, chosen) for source in (fewer, often))
                whole[verb].append(more)
                costs[verb].append(
                    Cost(*((b - a) / frames for a, b in zip(less, more, strict=True)))
                )
    for kind in Cost._fields:
        a_frame, runs = (
            {verb: float(np.median([getattr(c, kind) for c in found[verb]])) for verb in flags}
            for found in (costs, whole)
        )
        print(
            f"{kind}: {1e3 * a_frame['convert']:.0f} ms a frame of convert, "
            f"{1e3 * a_frame['obstacles']:.0f} of obstacles: ratio of rates "
            f"{a_frame['convert'] / a_frame['obstacles']:.2f}; of whole runs "
            f"{runs['convert'] / runs['obstacles']:.2f}"
        )


if __name__ == "__main__":
    main()
