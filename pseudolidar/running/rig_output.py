"""Rig files that verbs write: never over anything else, and the one that was there is kept."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pseudolidar.errors import PseudolidarError, UsageError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.rigs.body_json import has_pairs, read_body
from pseudolidar.formats.rigs.rig_json import read_rig, write_rig
from pseudolidar.running.new_file import check_new_file
from pseudolidar.structures.camera import StereoRig

SUFFIX = ".json"


def check_rig_place(out: Path, *, overwrite: bool) -> None:
    """Refuse a rig file by a wrong name, in a wrong place, or in the place of something else.

    Raises:
        UsageError: a file would be written over, unasked or one that is no rig; its name does not
            end in `.json`, by which `--rig` knows a rig.
        OutputError: nothing can be written there.
    """
    if out.suffix.lower() != SUFFIX:
        raise UsageError(
            f"a rig file called {out.name!r}",
            want=f"a name that ends in {SUFFIX}, by which --rig knows it",
            fix=f"Pass --out {out}{SUFFIX}.",
        )
    check_new_file(out, overwrite=overwrite)
    if out.exists():
        try:
            if has_pairs(out):
                read_body(out)
            else:
                read_rig(out)
        except PseudolidarError as error:
            raise UsageError(
                f"a file that is no rig ({error})",
                want="a rig file, or the name of a new file",
                fix="Name another with --out.",
                path=out,
            ) from None


def store_rig(out: Path, rig: StereoRig) -> Path | None:
    """Write the rig file; one that was there is kept beside it, so that it can be taken back."""
    return stored(out, lambda: write_rig(out, rig))


def stored(out: Path, write: Callable[[], None]) -> Path | None:
    """Write a rig file by `write`; returns where the one is that was there, None without one."""
    if not out.exists():
        write()
        return None
    previous = out.with_name(f"{out.stem}.previous{out.suffix}")
    write_atomic(previous, out.read_bytes())
    write()
    return previous
