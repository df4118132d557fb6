"""What is imported when: the command and the help of every verb answer without heavy libraries."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.commandline.verbs import verb_files
from pseudolidar.formats.points.pcd import write_pcd
from pseudolidar.structures.cloud import PointCloud

HEAVY = {"av", "cv2", "dask", "google", "lz4", "matplotlib", "mcap", "mcap_ros2", "numba"}
HEAVY |= {"onnxruntime", "open3d", "rich", "scipy", "viser", "zstandard"}
FOR_FLAGS = {"tyro"}


def modules_after(code: str) -> set[str]:
    program = f"import sys\n{code}\nsys.stdout.write('\\n' + ' '.join(sys.modules))"
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    return set(ended.stdout.rpartition("\n")[2].split())


@pytest.mark.parametrize(
    "code",
    ["import pseudolidar", "from pseudolidar.cli import main; assert main(['--help']) == 0"],
)
def test_package_and_overview_import_numpy_at_most(code: str) -> None:
    loaded = modules_after(code)
    assert "numpy" in loaded
    assert not loaded & (HEAVY | FOR_FLAGS)


@pytest.mark.parametrize("verb", verb_files())
def test_help_of_a_verb_imports_nothing_heavy(verb: str) -> None:
    code = f"from pseudolidar.cli import main; assert main(['{verb}', '--help']) == 0"
    assert not modules_after(code) & HEAVY


def test_clouds_are_converted_without_the_kernels_of_matching(tmp_path: Path) -> None:
    write_pcd(tmp_path / "a.pcd", PointCloud(np.ones((3, 3), np.float32), "velodyne", 0))
    words = ["convert", str(tmp_path / "a.pcd"), str(tmp_path / "out"), "--to", "ply"]
    loaded = modules_after(f"from pseudolidar.cli import main; assert main({words}) == 0")
    assert "pseudolidar.stereo.reproject" in loaded
    assert not loaded & {"numba", "open3d", "onnxruntime", "av"}
