"""The layout of two eyes in folders that the user asked for, or that is found."""

from __future__ import annotations

from pathlib import Path

from pseudolidar.errors import SourceEmpty, SourceUnknown, UsageError
from pseudolidar.sources.folder_layout import (
    Layout,
    explicit_layout,
    find_layout,
    list_folders,
    list_pictures,
    pattern_layout,
)

# Names that are times are paired up to this difference, s: eyes that were triggered together.
TOLERANCE_S = 0.01
# Names of pictures and of folders that an error tells.
NAMES_TOLD = 4


def asked_layout(
    path: str, right: str | None, patterns: tuple[str | None, str | None], *, tolerance_s: float
) -> Layout:
    """The pairs of a folder: by patterns, by a second folder, or by the first layout that fits.

    Args:
        path: folder of both eyes, or of the left one if `right` is given.
        right: folder of the right pictures.
        patterns: names of left and right pictures, such as `cam_a_*.png`; None for both or neither.
        tolerance_s: names that are times are paired up to this difference.

    Raises:
        SourceUnknown: no such folder, or nothing that fits the patterns.
        SourceEmpty: no pairs in it.
        UsageError: one pattern without the other.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise SourceUnknown("no such folder", want="a folder of pictures", path=folder)
    left_pattern, right_pattern = patterns
    if (left_pattern is None) != (right_pattern is None):
        raise UsageError("one pattern", want="a left pattern and a right one")
    if left_pattern is not None and right_pattern is not None:
        return pattern_layout(folder, left_pattern, right_pattern, tolerance_s=tolerance_s)
    if right is None:
        layout = find_layout(folder, tolerance_s=tolerance_s)
    else:
        layout = explicit_layout(folder, Path(right), tolerance_s=tolerance_s)
    if layout is None:
        raise SourceEmpty(
            f"no pair of pictures among {seen_in(folder)}",
            want="folders left and right, or names with left and right, _l and _r, im0 and im1",
            fix="Name the pictures: --left-pattern 'a_*.png' --right-pattern 'b_*.png'.",
            path=folder,
        )
    return layout


def seen_in(folder: Path) -> str:
    """What a folder holds, in a few words."""
    pictures, folders = list_pictures(folder), list_folders(folder)
    names = [f"{path.name}/" for path in folders[:NAMES_TOLD]]
    names += [path.name for path in pictures[:NAMES_TOLD]]
    examples = f" ({', '.join(names)}, ...)" if names else ""
    return f"{len(pictures)} pictures and {len(folders)} folders{examples}"
