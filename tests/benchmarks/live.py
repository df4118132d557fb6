"""How fast `live` is, and how late: KITTI drive 0002 as JPEG from two cameras, played as if live.

    .venv/bin/python -m tests.benchmarks.live DRIVE [--pictures 60]

Each line is one run: rate of the cameras, scale, what was finished per second, latency from the
moment of the pictures to when all of the frame is durable, also as a multiple of the time that the
work on one frame took alone just before, share of pairs dropped, and the processor time of a frame,
which says what the machine would do if it had nothing else to do.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from pseudolidar.pipelines.live import Live, convert_frame, run

from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.running.live.opening import opened_cameras, opened_pairs
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.sources.capture.cameras import CameraSettings
from pseudolidar.sources.recognise import recognise
from tests.cameras import MJPEG
from tests.videos import write_video

RATE_HZ = 10  # of the drive
ROWS = 374  # of 375: half the colours of a JPEG need an even number


def write_cameras(drive: Path, folder: Path, pictures: int) -> None:
    """The drive to and fro, as often as it takes, with hardly any loss."""
    source = recognise(str(drive)).open()
    pairs = [source.load(index) for index in range(len(source.ids))]
    last = len(pairs) - 1
    order = [last - abs(last - number % (2 * last)) for number in range(pictures)]
    for eye in ("left", "right"):
        shown = [np.ascontiguousarray(getattr(pairs[index], eye)[:ROWS]) for index in order]
        quality = {"qmin": "2", "qmax": "2"}
        write_video(folder / f"{eye}.mkv", shown, rate=RATE_HZ, options=quality, **MJPEG)
    rig = source.rig
    cameras = (replace(camera, height_px=ROWS) for camera in (rig.left, rig.right))
    write_rig(folder / "rig.json", replace(rig, left=(left := next(cameras)), right=next(cameras)))
    assert left.height_px == ROWS


def alone(job: Live) -> float:
    """Seconds of the work on one frame, nothing else being done here; median of five."""
    with opened_cameras(job) as cameras:
        source = opened_pairs(job, cameras)
        per_frame, (frame, _) = convert_frame(job, source), source.specimen()
        times = []
        for _ in range(1 + 5):
            begin_s = time.perf_counter()
            per_frame(frame)
            times.append(time.perf_counter() - begin_s)
    return float(np.median(times[1:]))


def measured(folder: Path, out: Path, speed: float, scale: float, to: str) -> str:
    """One run as a line."""
    job = Live(
        str(folder / "left.mkv"),
        str(folder / "right.mkv"),
        out,
        to=Outputs.parse(to),
        realtime=True,
        camera=CameraSettings(speed=speed),
        scale=scale,
        overwrite=True,
    )
    alone_s = alone(job)
    result = run(job).as_dict()
    live, times = result["live"], result["times"]
    return (
        f"{RATE_HZ * speed:4.0f}/s  scale {scale:<4g} {to:9} finished {live['rate_hz']:5.2f}/s  "
        f"p50 {1000 * live['latency_p50_s']:4.0f} ms  p95 {1000 * live['latency_p95_s']:4.0f} ms "
        f"({live['latency_p50_s'] / alone_s:.1f} and {live['latency_p95_s'] / alone_s:.1f} "
        f"times alone)  "
        f"dropped {live['dropped'] / live['formed']:4.0%} of {live['formed']}  "
        f"{1000 * times['worker_cpu_s_per_frame']:4.0f} ms CPU a frame  "
        f"load {os.getloadavg()[0]:.1f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("drive", type=Path)
    parser.add_argument("--pictures", type=int, default=60)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_cameras(arguments.drive, folder, arguments.pictures)
        for _ in range(2):
            for speed in (1.0, 3.0):
                for scale in (1.0, 0.5):
                    print(measured(folder, folder / "out", speed, scale, "mcap"), flush=True)
        print(measured(folder, folder / "out", 1.0, 0.5, "pcd"), flush=True)


if __name__ == "__main__":
    main()
