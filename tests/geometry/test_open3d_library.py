import importlib
import subprocess
import sys

import pytest

from pseudolidar.errors import MissingDependency
from pseudolidar.geometry import open3d_library

CHILD = """
import sys
assert "open3d" not in sys.modules
from pseudolidar.geometry.open3d_library import load_open3d
open3d = load_open3d()
assert load_open3d() is open3d
assert hasattr(open3d.t.geometry, "RaycastingScene")
"""


def test_open3d_loads_from_pip_alone_and_says_nothing() -> None:
    done = subprocess.run([sys.executable, "-c", CHILD], capture_output=True, text=True, check=True)
    assert done.stdout == ""


def test_absent_open3d_is_a_missing_dependency(monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.import_module

    def without_open3d(name: str, package: str | None = None) -> object:
        if name == "open3d":
            raise ModuleNotFoundError("No module named 'open3d'")
        return real(name, package)

    monkeypatch.delitem(sys.modules, "open3d", raising=False)
    monkeypatch.setattr(importlib, "import_module", without_open3d)
    with pytest.raises(MissingDependency, match="open3d") as caught:
        open3d_library.load_open3d()
    assert "pip install" in caught.value.fix
    assert caught.value.exit_code == 5


def test_a_libusb_that_does_not_load_is_named(monkeypatch, tmp_path) -> None:
    broken = tmp_path / "libusb-1.0.so"
    broken.write_bytes(b"not a library")
    monkeypatch.delitem(sys.modules, "open3d", raising=False)
    monkeypatch.setattr("libusb_package.get_library_path", lambda: broken)
    with pytest.raises(MissingDependency, match="libusb"):
        open3d_library.load_open3d()


INTERRUPTED = """
import os, signal, sys, threading
from pseudolidar.geometry.open3d_library import load_open3d

threading.Timer(0.15, os.kill, (os.getpid(), signal.SIGINT)).start()
try:
    load_open3d()
except KeyboardInterrupt:
    print("whole" if hasattr(sys.modules["open3d"], "t") else "half")
print(load_open3d().__name__)
"""


def test_an_interrupt_waits_until_open3d_is_whole():
    """It ended inside open3d, as an import that failed and could not be tried again."""
    ended = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stdout.split()) == (0, ["whole", "open3d"]), ended.stderr
