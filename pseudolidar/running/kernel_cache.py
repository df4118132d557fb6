"""Where compiled kernels are kept: numba fails at import where it finds no writable folder."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pseudolidar

CACHE_VARIABLE = "NUMBA_CACHE_DIR"


def prepare_kernel_cache() -> None:
    """Point numba to a temporary folder where its own places cannot be written.

    Call before numba is imported; worker processes inherit the setting.
    """
    if CACHE_VARIABLE in os.environ or any(map(is_writable, _own_places())):
        return
    owner = os.getuid() if hasattr(os, "getuid") else "user"
    os.environ[CACHE_VARIABLE] = str(Path(tempfile.gettempdir()) / f"pseudolidar-kernels-{owner}")


def kernel_cache_folder() -> Path:
    """Folder in which compiled kernels are kept."""
    if CACHE_VARIABLE in os.environ:
        return Path(os.environ[CACHE_VARIABLE])
    places = _own_places()
    return next((place for place in places if is_writable(place)), places[0])


def is_writable(folder: Path) -> bool:
    """Whether a file can be made in the folder, found out by making one."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _own_places() -> list[Path]:
    """Where numba looks by itself: `__pycache__` beside the kernels, then the user's cache."""
    places = [Path(pseudolidar.__file__).parent / "stereo" / "__pycache__"]
    if cache := os.environ.get("XDG_CACHE_HOME"):
        return [*places, Path(cache) / "numba"]
    try:
        return [*places, Path.home() / ".cache" / "numba"]
    except RuntimeError:  # no home folder
        return places
