"""What is imported when: the command answers without the heavy libraries."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = {"cv2", "dask", "matplotlib", "mcap", "numba", "open3d", "rich", "scipy", "tyro", "viser"}


def modules_after(code: str) -> set[str]:
    program = f"import sys\n{code}\nsys.stdout.write(' '.join(sys.modules))"
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    return set(ended.stdout.rpartition("\n")[2].split())


@pytest.mark.parametrize(
    ("code", "allowed"),
    [
        ("import pseudolidar", set()),
        ("from pseudolidar.cli import main; assert main(['--help']) == 0", set()),
        ("from pseudolidar.cli import main; assert main(['doctor', '--help']) == 0", {"tyro"}),
    ],
)
def test_nothing_heavy_is_imported(code: str, allowed: set[str]) -> None:
    loaded = modules_after(code)
    assert "numpy" in loaded
    assert loaded & HEAVY <= allowed
