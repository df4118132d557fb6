"""Shared fixtures: the folder of real data, and skipping where it is absent."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import pytest

from tests.clouds import assert_same_cloud, make_cloud, without_columns
from tests.rerun_program import Rerun

__all__ = ["assert_same_cloud", "make_cloud", "without_columns"]

ROOT = Path(__file__).resolve().parent.parent
# What takes long goes first, so that none of it is left to one process at the end: files by the
# processor time that they take (2026-11-27), then the folders in which most tests run whole verbs.
LONG_FIRST = (
    "test_notebooks.py",
    "pipelines/test_compare.py",
    "pipelines/test_refine_reference.py",
    "pipelines/test_convert_isolated.py",
    "test_wheel.py",
    "pipelines/test_check.py",
    "real/test_doors.py",
    "pipelines/test_comparison_page.py",
    "pipelines/test_convert_interrupted.py",
    "calibration/solving/test_solve.py",
    "real/test_accuracy.py",
    "pipelines/test_refine.py",
    "real/test_refine_motion.py",
    "pipelines",
    "real",
    "calibration",
    "viewer",
)
TURNS = {ROOT / "tests" / name: turn for turn, name in enumerate(LONG_FIRST)}
DATA = Path(os.environ.get("PSEUDOLIDAR_DATA", ROOT.parent / "shared" / "data")).resolve()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put what takes long first; the order is else kept."""

    def turn(item: pytest.Item) -> int:
        places = [item.path, *item.path.parents]
        return min((TURNS[place] for place in places if place in TURNS), default=len(TURNS))

    items.sort(key=turn)


def pytest_collection_finish() -> None:
    """Leave out of all searches for garbage what is here to stay: modules, thousands of tests."""
    gc.collect()
    gc.freeze()


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
