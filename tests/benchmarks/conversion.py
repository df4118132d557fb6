"""Frame rate of a whole conversion against the plain script that a user would write.

    python -m tests.benchmarks.conversion [FRAMES]

KITTI drive 0002, its ten frames cycled to 300 (by links), to PCD and MCAP; a synthetic street where
the real data is absent. Start-up is told apart: it is the time of a run of two frames. The share of
the cores that unavoidable work keeps busy is frames per second x CPU seconds that one frame needs
alone on one thread (decode, match, reproject, encode), over the number of cores.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from pseudolidar.pipelines.convert import Convert, ConvertFrame, opened

from pseudolidar.running.memory import keep_freed_memory
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.sources.recognise import recognise
from tests.conftest import DATA, ROOT

TO = "pcd,mcap"
FEW = 2
ALONE_ROUNDS = 3
PLAIN_SCRIPT = ROOT / "tests" / "benchmarks" / "plain_script.py"
DATE, DRIVE = "2011_09_26", "2011_09_26_drive_0002_sync"


def cycled_drive(folder: Path, frames: int) -> Path:
    """A drive of `frames` frames under `folder`, linked to the ten of KITTI (or synthetic ones)."""
    original = DATA / "kitti_raw" / DATE / DRIVE
    if not original.is_dir():
        run("pseudolidar", "synth", str(folder / "synthetic"), "--frames", "10")
        original = next((folder / "synthetic").rglob("*_sync"))
    drive = folder / str(frames) / DATE / original.name
    for name in ("image_02", "image_03", "velodyne_points", "oxts"):
        suffix = {"velodyne_points": "bin", "oxts": "txt"}.get(name, "png")
        given = sorted((original / name / "data").glob(f"*.{suffix}"))
        (drive / name / "data").mkdir(parents=True)
        for i in range(frames):
            (drive / name / "data" / f"{i:010d}.{suffix}").symlink_to(given[i % len(given)])
        stamps = [
            f"2011-09-26 13:{i // 600:02d}:{i // 10 % 60:02d}.{i % 10}00000000"
            for i in range(frames)
        ]
        (drive / name / "timestamps.txt").write_text("\n".join(stamps) + "\n")
    for calibration in original.parent.glob("calib_*.txt"):
        shutil.copy(calibration, drive.parent)
    return drive


def run(command: str, *arguments: str) -> float:
    """Seconds of a command of this environment."""
    begin = time.perf_counter()
    executable = str(Path(sys.executable).parent / command)
    done = subprocess.run([executable, *arguments], capture_output=True, text=True, cwd=ROOT)
    if done.returncode:
        sys.exit(f"{command} {' '.join(arguments)}\n{done.stdout}{done.stderr}")
    return time.perf_counter() - begin


def cpu_seconds_alone(drive: Path, out: Path) -> float:
    """CPU seconds that decode, match, reproject and encode need for a frame, on one thread."""
    import cv2

    cv2.setNumThreads(1)
    keep_freed_memory()  # as in a run
    job = Convert(source=recognise(str(drive)), out=out, to=Outputs.parse(TO))
    source = opened(job)
    per_frame = ConvertFrame.of(job, source)
    sampled = per_frame.encode.sampled
    unsampled = [i for i, name in enumerate(source.ids) if name not in sampled][:10]
    per_frame(source.load(0))
    rounds = []
    for _ in range(ALONE_ROUNDS):
        begin = time.thread_time()
        for i in unsampled:
            per_frame(source.load(i))
        rounds.append((time.thread_time() - begin) / len(unsampled))
    return min(rounds)


def main() -> None:
    """Print rates, their ratio, start-up and the share of busy cores."""
    frames = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    cores = os.cpu_count() or 1
    with tempfile.TemporaryDirectory(prefix="pseudolidar_bench_") as name:
        folder = Path(name)
        out = folder / "out"
        drives = {n: cycled_drive(folder, n) for n in (FEW, frames)}
        cpu_s = cpu_seconds_alone(drives[frames], out)
        commands = {
            "pseudolidar convert": lambda drive: run(
                "pseudolidar", "convert", str(drive), str(out), "--to", TO
            ),
            "plain script": lambda drive: run("python", str(PLAIN_SCRIPT), str(drive), str(out)),
        }
        commands["pseudolidar convert"](drives[FEW])  # kernels and page cache are warm after it
        rates = {}
        for label, convert in commands.items():
            seconds = {}
            for n, drive in drives.items():
                shutil.rmtree(out, ignore_errors=True)
                seconds[n] = convert(drive)
            rates[label] = (frames - FEW) / (seconds[frames] - seconds[FEW])
            start_s = seconds[FEW] - FEW / rates[label]
            print(f"{label:20s} {rates[label]:6.2f} frames/s, start-up {start_s:.2f} s")
    ours = rates["pseudolidar convert"]
    print(f"ratio {ours / rates['plain script']:.2f}")
    print(
        f"{1e3 * cpu_s:.0f} ms CPU a frame alone: {ours * cpu_s / cores:.0%} of {cores} cores busy"
    )


if __name__ == "__main__":
    main()
