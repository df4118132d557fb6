"""The output folder of one run: usable, ours alone, and free of leftovers."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import socket
import tempfile
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath

from pseudolidar.errors import OutputError, OutputLocked
from pseudolidar.formats.atomic import is_temporary, output_error, write_atomic

LOCK_NAME = ".lock"
PROBE_NAME = ".writable"
# Files that are opened under their own name, to go on with them; all others replace what is there.
_CONTINUED = (".lock", ".jsonl", ".part")


@contextlib.contextmanager
def own_folder(folder: Path) -> Iterator[None]:
    """Make `folder`, prove that it can be written to, and keep every other run out of it.

    The lock is `flock`'s: it is released when the process dies, however it dies. It works between
    processes of one host.

    Raises:
        OutputError: the folder cannot be made or written to, or a link in it leads elsewhere.
        OutputLocked: another run is writing to it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for entry in folder.iterdir():
            if entry.name.endswith(_CONTINUED):
                _refuse_link(entry)
    except OSError as error:
        raise output_error(folder, error) from error
    with _locked(folder / LOCK_NAME):
        write_atomic(folder / PROBE_NAME, b"")
        (folder / PROBE_NAME).unlink()
        remove_leftovers(folder)
        yield


def check_usable(folder: Path) -> None:
    """Try to write where `folder` is, or would be made, and leave nothing: before heavy loading.

    Raises:
        OutputError: nothing can be written there.
    """
    nearest = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    try:
        with tempfile.TemporaryFile(dir=nearest):
            pass
    except OSError as error:
        raise output_error(folder, error) from error


def remove_leftovers(folder: Path) -> None:
    """Delete what interrupted writes left in `folder` and the folders in it."""
    folders = (e for e in folder.iterdir() if e.is_dir() and not e.is_symlink())
    for place in (folder, *folders):
        for entry in place.iterdir():
            if is_temporary(entry.name):
                entry.unlink(missing_ok=True)


def stays_inside(name: str) -> bool:
    """Whether an output name (with /) means a file in the output folder."""
    parts = PurePosixPath(name).parts
    return bool(parts) and not name.startswith("/") and ".." not in parts and "\0" not in name


def inside(folder: Path, name: str) -> Path:
    """Path of the output `name` (with /) in `folder`.

    Raises:
        OutputError: the name is absolute, climbs out, or is none, or a link on its way leads out.
    """
    if not stays_inside(name):
        raise OutputError(f"output name {name!r}", want="a name inside the folder", path=folder)
    for parent in PurePosixPath(name).parents[:-1]:
        _refuse_link(folder / parent)
    return folder / name


def _refuse_link(path: Path) -> None:
    if path.is_symlink():
        raise OutputError(
            f"a link, to {path.readlink()}",
            want="a file or folder of its own: nothing is written through links",
            fix="Remove the link, or make the output folder itself one.",
            path=path,
        )


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    descriptor = _lock(path)
    try:
        owner = {"pid": os.getpid(), "host": socket.gethostname(), "since": _now()}
        try:
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, json.dumps(owner).encode(), 0)
        except OSError as error:  # a disk without a single free block
            raise output_error(path, error) from error
        yield
    finally:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
        os.close(descriptor)


def _lock(path: Path) -> int:
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise output_error(path, error) from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(descriptor)
            raise _taken(path) from error
        # The run before may have removed the file between our opening and our locking it.
        with contextlib.suppress(FileNotFoundError):
            if path.stat().st_ino == os.fstat(descriptor).st_ino:
                return descriptor
        os.close(descriptor)


def _taken(path: Path) -> OutputLocked:
    owner = {"pid": "?", "host": "?", "since": "?"}
    with contextlib.suppress(OSError, ValueError):
        owner |= json.loads(path.read_text())
    return OutputLocked(
        f"process {owner['pid']} on {owner['host']} has been writing here since {owner['since']}",
        want="one run on a folder",
        fix="Wait for it, end it, or choose another output folder.",
        path=path.parent,
    )


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
