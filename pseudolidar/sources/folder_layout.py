"""How a user laid out two eyes in folders: found by content, stated, and overridden by patterns."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from pseudolidar.errors import SourceUnknown, UsageError
from pseudolidar.formats.pictures.image_kinds import EXTENSIONS
from pseudolidar.sources.names import natural_key
from pseudolidar.sources.pairing import (
    FOLDER_NUMBERS,
    FURTHER_NUMBER,
    LETTERS,
    NUMBERED,
    SAME_NAME,
    WORDS,
    EyeRule,
    Pairing,
    PicturePair,
    pair_pictures,
    pattern_rule,
)

# Folders that some recorders put the pictures of a camera into.
INNER = ("", "data")


@dataclass(frozen=True)
class Layout:
    """The pairs of a folder and how they were found.

    Args:
        pairing: the pairs.
        left: folder of the left pictures.
        line: what it is, one line.
        notes: what was assumed.
        scenes: whether each pair has a folder of its own.
    """

    pairing: Pairing
    left: Path
    line: str
    notes: tuple[str, ...] = ()
    scenes: bool = False


def find_layout(folder: Path, *, tolerance_s: float) -> Layout | None:
    """The pairs in `folder` by the first layout that fits: two folders, one folder, scenes."""
    return (
        _two_folders(folder, tolerance_s)
        or _one_folder(folder, tolerance_s)
        or _scenes(folder, tolerance_s)
    )


def explicit_layout(left: Path, right: Path, *, tolerance_s: float) -> Layout | None:
    """The pairs of two folders that the user named."""
    rules = (SAME_NAME, WORDS, LETTERS, NUMBERED)
    pairing = _best(list_pictures(left), list_pictures(right), rules, tolerance_s)
    line = f"two folders of pictures, {left.name} and {right.name}"
    return Layout(pairing, left, line) if pairing.pairs else None


def pattern_layout(folder: Path, left: str, right: str, *, tolerance_s: float) -> Layout:
    """The pairs that two patterns name, such as `cam_a_*.png` and `cam_b_*.png`.

    Raises:
        UsageError: a pattern without exactly one `*` in its last part.
        SourceUnknown: nothing fits.
    """
    for pattern in (left, right):
        name = Path(pattern).name
        if pattern.count("*") != 1 or "*" not in name:
            raise UsageError(
                f"pattern {pattern!r}",
                want="one * in the file name, for what both eyes share",
                fix="Write for example 'cam_a_*.png' and 'cam_b_*.png'.",
            )
    lefts, rights = _matching(folder, left), _matching(folder, right)
    pairing = pair_pictures(lefts, rights, pattern_rule(left, right), tolerance_s=tolerance_s)
    if not pairing.pairs:
        raise SourceUnknown(
            f"{len(lefts)} pictures fit {left!r}, {len(rights)} fit {right!r}, no pair",
            want="pairs in which the part under * is equal",
            path=folder,
        )
    return Layout(pairing, (folder / left).parent, "pictures named by patterns")


def list_pictures(folder: Path) -> list[Path]:
    """Files of `folder` whose names end like a picture's; in numeric order.

    A link is a picture whatever it points to: a broken or looping one fails when it is read.
    """
    names = [entry.name for entry in _entries(folder) if not _is_folder(entry)]
    return [
        folder / name
        for name in sorted(names, key=natural_key)
        if Path(name).suffix.lower() in EXTENSIONS and not name.startswith(".")
    ]


def list_folders(folder: Path) -> list[Path]:
    """Folders in `folder`, links followed, in numeric order."""
    names = [entry.name for entry in _entries(folder) if _is_folder(entry)]
    return [folder / name for name in sorted(names, key=natural_key) if not name.startswith(".")]


def _two_folders(folder: Path, tolerance_s: float) -> Layout | None:
    candidates = list(_eye_folders(list_folders(folder)))
    found = [
        layout
        for left, right in candidates
        if (layout := _pictures_in(left, right, tolerance_s)) is not None
    ]
    if not found:
        return None
    others = [layout.left.relative_to(folder).as_posix() for layout in found[1:]]
    notes = (f"also there, left out: {', '.join(others)}",) if others else ()
    return replace(found[0], notes=found[0].notes + notes)


def _eye_folders(folders: Iterable[Path]) -> Iterator[tuple[Path, Path]]:
    """Pairs of folders whose names differ by an eye's mark alone."""
    folders = list(folders)
    for rule in (WORDS, LETTERS, *FOLDER_NUMBERS):
        right = dict(_keyed(rule, folders, "right"))
        for key, path in _keyed(rule, folders, "left"):
            if key in right:
                yield path, right[key]


def _keyed(rule: EyeRule, folders: Iterable[Path], eye: str) -> list[tuple[str, Path]]:
    # A folder has no extension: what looks like one belongs to its name.
    stand_ins = {path.with_name(path.name + ".x"): path for path in folders}
    return [(key, stand_ins[stand_in]) for key, stand_in in rule.keys(stand_ins, eye)]


def _pictures_in(left: Path, right: Path, tolerance_s: float) -> Layout | None:
    for inner in INNER:
        layout = explicit_layout(left / inner, right / inner, tolerance_s=tolerance_s)
        if layout is not None:
            line = f"two folders of pictures, {left.name} and {right.name}"
            return replace(layout, line=line)
    return None


def _one_folder(folder: Path, tolerance_s: float) -> Layout | None:
    pictures = list_pictures(folder)
    numbered = not any(FURTHER_NUMBER.search(picture.stem) for picture in pictures)
    rules = (WORDS, LETTERS, *((NUMBERED,) if numbered else ()))
    pairing = _best(pictures, pictures, rules, tolerance_s)
    if not pairing.pairs:
        return None
    known = 2 * len(pairing.pairs) + len(pairing.unpaired)
    others = len(pictures) - known
    notes = (f"{others} other pictures there were left out",) if others > 0 else ()
    if len(pairing.pairs) == 1 and not pairing.pairs[0].key:
        pairing = _named_by_folder(pairing, folder)
    return Layout(pairing, folder, "one folder of pictures of both eyes", notes)


def _scenes(folder: Path, tolerance_s: float) -> Layout | None:
    """One pair in each folder, such as `*/im0.png` and `*/im1.png`."""
    pairs: list[PicturePair] = []
    rules: dict[str, None] = {}
    skipped = 0
    for scene in list_folders(folder):
        layout = _one_folder(scene, tolerance_s)
        if layout is None or len(layout.pairing.pairs) != 1:
            skipped += 1
            continue
        pairs.append(replace(layout.pairing.pairs[0], key=scene.name))
        rules[layout.pairing.rule] = None
    if not pairs:
        return None
    keys = tuple(pair.key for pair in pairs)
    pairing = Pairing(tuple(pairs), (), keys, "; ".join(rules))
    notes = (f"{skipped} folders without exactly one pair were left out",) if skipped else ()
    return Layout(pairing, folder, "a folder for each scene", notes, scenes=True)


def _named_by_folder(pairing: Pairing, folder: Path) -> Pairing:
    name = folder.resolve().name
    pairs = (replace(pairing.pairs[0], key=name),)
    return replace(pairing, pairs=pairs, left_keys=(name,))


def _best(
    left: list[Path], right: list[Path], rules: Iterable[EyeRule], tolerance_s: float
) -> Pairing:
    """The rule that pairs most; the first of equals."""
    pairings = [pair_pictures(left, right, rule, tolerance_s=tolerance_s) for rule in rules]
    return max(pairings, key=lambda pairing: len(pairing.pairs))


def _matching(folder: Path, pattern: str) -> list[Path]:
    place, name = (folder / pattern).parent, Path(pattern).name
    before, _, after = name.partition("*")
    return [
        picture
        for picture in list_pictures(place)
        if picture.name.startswith(before)
        and picture.name.endswith(after)
        and len(picture.name) >= len(before) + len(after)
    ]


def _entries(folder: Path) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as entries:
            return list(entries)
    except OSError:
        return []


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:  # a loop of links
        return False
