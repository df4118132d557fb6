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
# Files that take long: they go first, so that none of them is left to one process at the end.
LONG_FIRST = ("test_wheel.py", "test_notebooks.py", "pipelines", "real")
DATA = Path(os.environ.get("PSEUDOLIDAR_DATA", ROOT.parent / "shared" / "data")).resolve()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put what takes long first; the order is else kept."""
    tests = ROOT / "tests"

    def turn(item: pytest.Item) -> int:
        part = item.path.relative_to(tests).parts[0] if item.path.is_relative_to(tests) else ""
        return LONG_FIRST.index(part) if part in LONG_FIRST else len(LONG_FIRST)

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
