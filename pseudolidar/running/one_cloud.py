"""One cloud in one file, named by the user: where it may be written, and how."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pseudolidar.errors import OutputError, StructureError, UsageError, printable
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.crew.attempt import Skipped
from pseudolidar.running.folder import check_usable
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.products.encoders import ENCODERS, losses_in_bin
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.recorded import RecordedCloud

SUFFIXES = (".ply", ".pcd", ".bin", ".npz")
# Skipped frames named one by one on the terminal; --json has all.
NAMED_SKIPS = 5


def check_place(out: Path, *, overwrite: bool) -> None:
    """Raise where a cloud cannot or should not be written, before there is any work.

    Raises:
        UsageError: a name of no known format, or a file that is there already.
        OutputError: a folder, or a place that cannot be written to.
    """
    if out.suffix.lower() not in SUFFIXES:
        raise UsageError(
            f"a file named {out.suffix or 'without extension'}",
            want=", ".join(SUFFIXES),
            path=out,
        )
    if out.is_dir():
        raise OutputError("a folder", want="the name of a file", path=out)
    if out.exists() and not overwrite:
        raise UsageError(
            "there is such a file already",
            want="a new name",
            fix="Name another file, or pass --overwrite.",
            path=out,
        )
    check_usable(out.parent)


def check_apart(out: Path, files: Sequence[Path], folder: Path) -> None:
    """Raise where the next run would take its own result for one of the clouds.

    Args:
        out: the file.
        files: of the clouds.
        folder: what the user gave; may be a file itself.

    Raises:
        UsageError: OUT is one of the files, or lies among them.
    """
    place = out.resolve()
    taken = {file.resolve() for file in files}
    among = {file.parent.resolve() for file in files} | {folder.resolve()}
    if place in taken or (folder.is_dir() and place.parent in among):
        raise UsageError(
            "lies among the clouds that are read: the next run would take it for one of them",
            want="another folder",
            path=out,
        )


def write_cloud(out: Path, cloud: PointCloud) -> tuple[str, ...]:
    """Write a cloud in the format that the file is named after.

    Returns:
        What the format cannot hold.

    Raises:
        UsageError: there is no point.
        OutputError: it cannot be written; nothing is left.
        StructureError: the format can hold none of it.
    """
    if not len(cloud):
        raise UsageError("not one point is left", want="points", fix="Crop less.", path=out)
    frame = RecordedCloud(cloud, out.stem, 0, cloud.timestamp_ns)
    converted, kind = Converted(frame, cloud), out.suffix.lower().removeprefix(".")
    try:
        data = ENCODERS[kind](converted)
    except StructureError as error:
        raise error.located(out) from error.__cause__
    write_atomic(out, data)
    return losses_in_bin(converted) if kind == "bin" else ()


def skipped_lines(skipped: Sequence[Skipped]) -> list[str]:
    """Frames that were left out, the first of them by name."""
    lines = [
        printable(f"  skipped {each.id}: {each.error.code}: {each.error.got}")
        for each in skipped[:NAMED_SKIPS]
    ]
    more = len(skipped) - NAMED_SKIPS
    return [*lines, f"  ... and {more} more, see --json"] if more > 0 else lines
