"""Memory of long conversions stays flat."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from pseudolidar.running.journal.journal_file import JOURNAL_NAME
from tests.benchmarks.conversion import cycled_drive

MB = 1_000_000
SAMPLE_S = 0.05


def resident_by_frames(source: Path, out: Path) -> np.ndarray:
    """(N, 2): frames committed, and MB resident at that moment, of a conversion."""
    line = [sys.executable, "-m", "pseudolidar.cli", "convert", str(source), str(out)]
    journal, samples = out / JOURNAL_NAME, []
    with subprocess.Popen([*line, "--to", "pcd,mcap"], stdout=subprocess.PIPE) as child:
        process = psutil.Process(child.pid)
        while child.poll() is None:
            frames = journal.read_bytes().count(b"\n") - 1 if journal.exists() else 0
            try:
                samples.append((frames, process.memory_info().rss / MB))
            except psutil.NoSuchProcess:
                break
            time.sleep(SAMPLE_S)
    assert child.returncode == 0
    return np.array(samples)


def growth(samples: np.ndarray, frames: int) -> float:
    """MB between the second fifth and the last fifth of the frames, the report left out."""
    done, resident_mb = samples.T
    early = resident_mb[(done > 0.2 * frames) & (done <= 0.4 * frames)]
    late = resident_mb[(done > 0.8 * frames) & (done < frames)]
    assert min(len(early), len(late)) >= 5, "too few samples"
    return float(np.median(late) - np.median(early))


@pytest.mark.slow
def test_500_small_frames(drive, tmp_path):
    """What is kept of a frame would show: 1 kB of each of the 300 frames between is 0.3 MB."""
    cycled = tmp_path / "cycled"
    for eye in ("left", "right"):
        (cycled / eye).mkdir(parents=True)
        given = sorted((drive / eye).iterdir())
        for i in range(500):
            (cycled / eye / f"{i:06d}.png").symlink_to(given[i % len(given)])
    shutil.copy(drive / "rig.json", cycled)
    samples = resident_by_frames(cycled, tmp_path / "out")
    assert growth(samples, 500) < 15


@pytest.mark.slow
def test_100_frames_of_full_size(tmp_path):
    """A pair, its maps and its cloud are 25 MB; the frames between would be more than 1 GB."""
    samples = resident_by_frames(cycled_drive(tmp_path, 100), tmp_path / "out")
    assert growth(samples, 100) < 100
    assert samples[:, 1].max() < 1500
