"""The doctor, with libraries really hidden or broken in the processes that try the parts."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import pseudolidar
from pseudolidar.running.installation.environment import PARTS, Finding, try_part
from pseudolidar.running.installation.requirements import Library, libraries
from pseudolidar.running.kernel_cache import (
    CACHE_VARIABLE,
    kernel_cache_folder,
    prepare_kernel_cache,
)

# Runs in every Python process that finds it on its path, before anything else.
BREAK_IMPORTS = """
import os, signal, sys

class Broken:
    def find_spec(self, name, path=None, target=None):
        how = dict(part.split("=") for part in os.environ["BREAK"].split(",")).get(name)
        if how == "hidden":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        if how == "unlinked":
            raise ImportError("libGL.so.1: cannot open shared object file: No such file", name=name)
        if how == "illegal":
            os.kill(os.getpid(), signal.SIGILL)

sys.meta_path.insert(0, Broken())
"""


@pytest.fixture
def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    (tmp_path / "sitecustomize.py").write_text(BREAK_IMPORTS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return monkeypatch


def tried(name: str) -> Finding:
    return try_part(next(part for part in PARTS if part.name == name))


def doctor() -> tuple[int, dict[str, Any]]:
    ended = subprocess.run(
        [sys.executable, "-m", "pseudolidar.cli", "doctor", "--json"],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    return ended.returncode, json.loads(ended.stdout)


def test_everything_works_here() -> None:
    code, report = doctor()
    assert [part for part in report["parts"] if not part["fine"]] == []
    assert [library for library in report["libraries"] if not library["fine"]] == []
    assert (code, report["core_works"]) == (0, True)
    processor = report["machine"][0]["found"]
    assert any(level in processor for level in ("AVX", "SSE", "NEON"))


def test_the_core_works_without_open3d_and_its_absence_is_named(
    broken: pytest.MonkeyPatch,
) -> None:
    broken.setenv("BREAK", "open3d=hidden,libusb_package=hidden")
    code, report = doctor()
    assert (code, report["core_works"]) == (0, True)
    bad = [part for part in report["parts"] if not part["fine"]]
    assert [part["name"] for part in bad] == ["worlds"]
    assert "pip install open3d libusb-package" in bad[0]["fix"]


@pytest.mark.parametrize(
    ("name", "breakage", "fix"),
    [
        ("matcher", "numba=hidden", "pip install numba"),
        ("images", "cv2=hidden", "pip install opencv-python-headless"),
        ("images", "cv2=unlinked", "apt install libgl1"),
        ("recordings", "mcap=hidden", "pip install mcap"),
        ("reports", "matplotlib=hidden", "pip install matplotlib"),
    ],
)
def test_advice_names_the_package(
    broken: pytest.MonkeyPatch, name: str, breakage: str, fix: str
) -> None:
    broken.setenv("BREAK", breakage)
    finding = tried(name)
    assert not finding.fine
    assert fix in finding.fix
    assert finding.core == (name != "reports")


def test_a_library_that_kills_the_process_is_survived_and_explained(
    broken: pytest.MonkeyPatch,
) -> None:
    broken.setenv("BREAK", "cv2=illegal")
    finding = tried("images")
    assert not finding.fine
    assert "instructions that this processor lacks" in finding.found


def test_without_the_core_the_exit_code_says_so(broken: pytest.MonkeyPatch) -> None:
    broken.setenv("BREAK", "numba=hidden,open3d=hidden,matplotlib=hidden")
    code, report = doctor()
    assert (code, report["core_works"]) == (5, False)


@pytest.mark.parametrize(
    ("wanted", "found", "fine"),
    [
        ("1.10", "1.9.3", False),
        ("1.9", "1.10", True),
        ("2.0", "2.0rc1", True),
        ("5.0", "5.0.0.93", True),
        ("5.0", None, False),
        ("0", "0.1.dev3", True),
    ],
)
def test_versions_are_compared_as_numbers(wanted: str, found: str | None, fine: bool) -> None:
    library = Library("example", wanted, found)
    assert library.fine == fine
    assert bool(library.fix) != fine


def test_libraries_are_those_of_the_package_without_extras() -> None:
    names = {library.name for library in libraries()}
    assert {"numpy", "open3d", "numba"} <= names
    assert not names & {"pytest", "ruff"}


# --- where kernels are kept ---


def test_kernels_go_to_a_temporary_folder_where_nothing_else_can_be_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv(CACHE_VARIABLE, raising=False)
    monkeypatch.setattr(pseudolidar, "__file__", "/proc/pseudolidar/__init__.py")
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/cache")
    monkeypatch.setenv(CACHE_VARIABLE, "to be restored")
    monkeypatch.delenv(CACHE_VARIABLE)
    prepare_kernel_cache()
    assert "pseudolidar-kernels" in kernel_cache_folder().name


def test_kernels_stay_where_numba_puts_them_if_it_can(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv(CACHE_VARIABLE, raising=False)
    monkeypatch.setattr(pseudolidar, "__file__", "/proc/pseudolidar/__init__.py")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    prepare_kernel_cache()
    assert kernel_cache_folder() == tmp_path / "numba"
