"""Files by a name of the user's: nothing is replaced unasked, or by another kind of file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pseudolidar.errors import UsageError
from pseudolidar.running.folder import check_usable

# How much of a file is looked at to tell what it is.
HEAD_BYTES = 4096


def check_new_file(out: Path, *, overwrite: bool, flag: str = "--out") -> None:
    """Refuse a file that cannot be written, or is there and may not be replaced; no folder may.

    Args:
        out: file to be written.
        overwrite: whether one that is there is replaced.
        flag: that names it.

    Raises:
        UsageError: there is one.
        OutputError: nothing can be written there.
    """
    if out.exists() and not (overwrite and out.is_file()):
        raise UsageError(
            "a folder" if out.is_dir() else "there is such a file already",
            want="the name of a new file",
            fix=f"Name another with {flag}, or pass --overwrite to replace a file.",
            path=out,
        )
    check_usable(out.parent)


def check_kind(out: Path, ours: Callable[[bytes], bool], kind: str, *, flag: str = "--out") -> None:
    """Refuse to replace a file that is of another kind than what will be written.

    Args:
        out: file that may be there.
        ours: whether the first bytes of a file are those of such a file.
        kind: such a file, in words.
        flag: that names it.

    Raises:
        UsageError: it is something else.
    """
    if not out.exists():
        return
    with out.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if not ours(head):
        raise UsageError(
            f"a file that is no {kind}",
            want=f"a {kind} to replace, or the name of a new file",
            fix=f"Name another with {flag}.",
            path=out,
        )


def is_text(head: bytes) -> bool:
    """Whether a file begins as text does, and not as pictures, videos and recordings."""
    return b"\0" not in head and not head.startswith((b"\xff\xd8", b"%PDF"))
