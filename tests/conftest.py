"""Shared fixtures: the folder of real data, and skipping where it is absent."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of the real data; skips the test where it is absent."""
    folder = Path(os.environ.get("PSEUDOLIDAR_DATA", ROOT.parent / "shared" / "data")).resolve()
    if not folder.is_dir():
        pytest.skip(f"real data not found at {folder} (set PSEUDOLIDAR_DATA)")
    return folder
