"""Numbered files of a sequence, paired by their number and never by position."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from pseudolidar.errors import ImageMissing, PairMismatch, PseudolidarError
from pseudolidar.formats.pictures.image_kinds import EXTENSIONS

# What `formats/pictures/image.py` decodes.
IMAGE_SUFFIXES = frozenset(EXTENSIONS)
# The numbers of a name: `0000000005` is (5,), stereo's `000013_10` is (13, 10).
FrameNumber = tuple[int, ...]
DIGITS = re.compile(r"[0-9]+(?:_[0-9]+)*")
LARGEST_LISTED = 10


@dataclass(frozen=True)
class NumberedFiles:
    """Files of a folder by the number in their name.

    Args:
        folder: where they are.
        paths: one file a number.
        duplicates: further files with a number that is taken.
        unnumbered: names of the right kind without a number.
    """

    folder: Path
    paths: Mapping[FrameNumber, Path] = field(default_factory=dict)
    duplicates: tuple[tuple[FrameNumber, Path], ...] = ()
    unnumbered: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.paths)

    def get(self, number: FrameNumber) -> Path | None:
        """The file with this number, or None."""
        return self.paths.get(number)

    def only(self, wanted: Callable[[FrameNumber], bool]) -> NumberedFiles:
        """The files whose number is wanted."""
        return replace(
            self,
            paths={number: path for number, path in self.paths.items() if wanted(number)},
            duplicates=tuple(entry for entry in self.duplicates if wanted(entry[0])),
        )

    def nearest(self, number: FrameNumber) -> str:
        """Name of the file whose number is nearest."""
        if not self.paths:
            return "none: the folder has no numbered picture"
        return self.paths[min(self.paths, key=lambda other: _distance(other, number))].name

    def notes(self) -> tuple[str, ...]:
        """What is odd about the names."""
        notes = []
        stems = {len(path.stem) for path in self.paths.values()}
        if len(stems) > 1:
            by_width = sorted(self.paths.values(), key=lambda path: len(path.stem))
            notes.append(
                f"{self.folder.name}: names of different widths ({by_width[0].name}, "
                f"{by_width[-1].name}), taken in numeric order"
            )
        if self.unnumbered:
            names = listed(self.unnumbered)
            notes.append(f"{self.folder.name}: left out, no frame number: {names}")
        return tuple(notes)


def _distance(a: FrameNumber, b: FrameNumber) -> tuple[int, ...]:
    return tuple(abs(x - y) for x, y in zip(a, b, strict=False))


def listed(names: Iterable[str]) -> str:
    """Names, the first few of them, and how many more there are."""
    names = list(names)
    more = len(names) - LARGEST_LISTED
    return ", ".join(names[:LARGEST_LISTED]) + (f" and {more} more" if more > 0 else "")


def numbered_files(folder: Path, suffixes: frozenset[str] = IMAGE_SUFFIXES) -> NumberedFiles:
    """The numbered files of `folder` with one of `suffixes`; none where it is not there."""
    try:
        with os.scandir(folder) as entries:
            names = sorted(
                entry.name
                for entry in entries
                if Path(entry.name).suffix.lower() in suffixes and entry.is_file()
            )
    except OSError:
        return NumberedFiles(folder)
    paths: dict[FrameNumber, Path] = {}
    duplicates: list[tuple[FrameNumber, Path]] = []
    unnumbered: list[str] = []
    for name in names:
        stem = Path(name).stem
        if not DIGITS.fullmatch(stem):
            unnumbered.append(name)
            continue
        number = tuple(int(part) for part in stem.split("_"))
        if number in paths:
            duplicates.append((number, folder / name))
        else:
            paths[number] = folder / name
    return NumberedFiles(folder, paths, tuple(duplicates), tuple(unnumbered))


def first_number_parts(folder: Path) -> int:
    """How many numbers the name of a picture in `folder` has: 1 for 000013, 2 for 000013_10, or 0.

    Looks at any one numbered picture, as a folder may hold tens of thousands.
    """
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                name = Path(entry.name)
                if name.suffix.lower() in IMAGE_SUFFIXES and DIGITS.fullmatch(name.stem):
                    return name.stem.count("_") + 1
    except OSError:
        pass
    return 0


@dataclass(frozen=True)
class Pairs:
    """Pairs of pictures in numeric order.

    Args:
        pairs: number, left, right.
        refused: stem and reason of each picture that has no partner.
        notes: what is odd about the names.
    """

    pairs: tuple[tuple[FrameNumber, Path, Path], ...]
    refused: tuple[tuple[str, PseudolidarError], ...]
    notes: tuple[str, ...]


def pair_by_number(left: NumberedFiles, right: NumberedFiles) -> Pairs:
    """Pair pictures with the same number."""
    both = sorted(left.paths.keys() & right.paths.keys())
    alone = [(number, "right", left, right) for number in left.paths.keys() - right.paths.keys()]
    alone += [(number, "left", right, left) for number in right.paths.keys() - left.paths.keys()]
    refused: list[tuple[str, PseudolidarError]] = [
        (here.paths[number].stem, _missing(side, here.paths[number], there, number))
        for number, side, here, there in sorted(alone, key=lambda entry: entry[0])
    ]
    for files in (left, right):
        refused += [
            (path.name, _duplicate(files.paths[number], path)) for number, path in files.duplicates
        ]
    return Pairs(
        tuple((number, left.paths[number], right.paths[number]) for number in both),
        tuple(refused),
        left.notes() + right.notes(),
    )


def _missing(side: str, here: Path, there: NumberedFiles, number: FrameNumber) -> ImageMissing:
    return ImageMissing(
        f"no {side} image for {here.name}",
        want=f"an image of the same number in {there.folder.name}",
        fix=f"The nearest name there is {there.nearest(number)}.",
        path=there.folder / here.name,
        where=f"frame {here.stem}",
    )


def _duplicate(taken: Path, other: Path) -> PairMismatch:
    return PairMismatch(
        f"{taken.name} and {other.name} have the same number",
        want="one file a frame",
        fix="Remove one of them.",
        path=other,
    )
