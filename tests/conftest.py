"""Shared fixtures: the folder of real data, and skipping where it is absent."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.clouds import assert_same_cloud, make_cloud, without_columns
from tests.rerun_program import Rerun

__all__ = ["assert_same_cloud", "make_cloud", "without_columns"]

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("PSEUDOLIDAR_DATA", ROOT.parent / "shared" / "data")).resolve()


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of the real data; skips the test where it is absent."""
    if not DATA.is_dir():
        pytest.skip(f"real data not found at {DATA} (set PSEUDOLIDAR_DATA)")
    return DATA


@pytest.fixture(scope="session")
def rerun(tmp_path_factory: pytest.TempPathFactory) -> Rerun:
    """The program `rerun`; skips the test where it is not installed."""
    return Rerun(tmp_path_factory.mktemp("home"))
