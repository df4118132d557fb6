"""Rig files that verbs write: never over anything else, and the one that was there is kept."""

from __future__ import annotations

from pathlib import Path

from pseudolidar.errors import PseudolidarError, UsageError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.rigs.rig_json import read_rig, write_rig
from pseudolidar.running.new_file import check_new_file
from pseudolidar.structures.camera import StereoRig


def check_rig_place(out: Path, *, overwrite: bool) -> None:
    """Raise `UsageError` where a file would be written over, unasked or one that is no rig."""
    check_new_file(out, overwrite=overwrite)
    if out.exists():
        try:
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
    if not out.exists():
        write_rig(out, rig)
        return None
    previous = out.with_name(f"{out.stem}.previous{out.suffix}")
    write_atomic(previous, out.read_bytes())
    write_rig(out, rig)
    return previous
