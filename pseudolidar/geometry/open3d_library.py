"""The one door to open3d: loads the libusb it needs, keeps it quiet, says what is missing."""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import io
import signal
import sys
import threading
from collections.abc import Iterator
from typing import Any

from pseudolidar.errors import MissingDependency

_importing = threading.Lock()


def load_open3d() -> Any:
    """Import open3d (seconds, the first time) and return the module.

    open3d links libusb-1.0, which pip does not install for it: the copy inside `libusb_package` is
    loaded first, with its symbols global. Threads may call it at once.

    Raises:
        MissingDependency: open3d or the libusb it needs is absent or does not load.
    """
    with _importing:
        if "open3d" in sys.modules:
            return sys.modules["open3d"]
        _load_libusb()
        try:
            # It greets on standard output inside notebooks, which would break `--json`.
            with contextlib.redirect_stdout(io.StringIO()), _signals_wait():
                open3d = importlib.import_module("open3d")
        except (ImportError, OSError) as error:
            raise MissingDependency(
                f"open3d does not load: {error}",
                want="open3d 0.19 or newer and the libraries that it links",
                fix="Run `pip install open3d libusb-package`; on Debian also `apt install libgl1 "
                "libgomp1`.",
                where="open3d",
            ) from error
        open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
        return open3d


@contextlib.contextmanager
def _signals_wait() -> Iterator[None]:
    """A block that Ctrl-C and SIGTERM end only when it is over.

    An exception out of a signal's handler would surface inside open3d's own code, as an import that
    failed, and leave half of open3d behind.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM)
    previous = {n: signal.signal(n, lambda number, _frame: came.append(number)) for n in numbers}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
    for first in came[:1]:
        signal.raise_signal(first)


def _load_libusb() -> None:
    """Make libusb's symbols known to the loader; a system-wide libusb serves as well.

    Raises:
        MissingDependency: `libusb_package` has a library and it does not load.
    """
    try:
        path = importlib.import_module("libusb_package").get_library_path()
    except ImportError:
        return  # then open3d finds the system's, or its own error says that there is none
    if path is None:
        return
    try:
        ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    except OSError as error:
        raise MissingDependency(
            f"libusb does not load: {error}",
            want="a libusb-1.0 for this machine",
            fix="Reinstall it: `pip install --force-reinstall libusb-package`.",
            path=path,
            where="libusb-1.0",
        ) from error
