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
    if CACHE_VARIABLE in os.environ or any(map(_writable, _own_places())):
        return
    owner = os.getuid() if hasattr(os, "getuid") else "user"
    os.environ[CACHE_VARIABLE] = str(Path(tempfile.gettempdir()) / f"pseudolidar-kernels-{owner}")


def kernel_cache_folder() -> Path:
    """Folder in which compiled kernels will be looked for first."""
    if CACHE_VARIABLE in os.environ:
        return Path(os.environ[CACHE_VARIABLE])
    return next((place for place in _own_places() if _writable(place)), _own_places()[-1])


def _own_places() -> tuple[Path, Path]:
    """Where numba looks by itself: `__pycache__` beside the kernels, then the user's cache."""
    user = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(pseudolidar.__file__).parent / "stereo" / "__pycache__", Path(user) / "numba"


def _writable(folder: Path) -> bool:
    while not folder.exists():
        folder = folder.parent
    return os.access(folder, os.W_OK)
