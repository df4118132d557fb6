"""Files that verbs write by a name of the user's: nothing is replaced unasked."""

from __future__ import annotations

from pathlib import Path

from pseudolidar.errors import UsageError


def check_new_file(out: Path, *, overwrite: bool) -> None:
    """Refuse a file that is there already, unless it may be replaced; a folder never may.

    Raises:
        UsageError: there is one.
    """
    if out.exists() and not (overwrite and out.is_file()):
        raise UsageError(
            "a folder" if out.is_dir() else "there is such a file already",
            want="the name of a new file",
            fix="Name another with --out, or pass --overwrite to replace a file.",
            path=out,
        )
