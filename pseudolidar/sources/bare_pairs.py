"""Pictures of two cameras that nobody has calibrated yet: folders, or videos."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from pseudolidar.errors import NoPairs, PseudolidarError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.sources.asked_layout import TOLERANCE_S, asked_layout
from pseudolidar.sources.body import Body
from pseudolidar.sources.folder_layout import find_layout
from pseudolidar.sources.names import safe_id
from pseudolidar.sources.selection import FrameSelection, chosen_positions
from pseudolidar.sources.source import KIND_NAMES, NO_PAIRS_FIXES, SourceSummary
from pseudolidar.structures.arrays import Image
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.frame import RawPair

ReadPair = Callable[[int], tuple[Image, Image]]


@dataclass(frozen=True, eq=False)
class BarePair:
    """A picture of each eye; they may differ in size.

    Args:
        left: (H, W) grey or (H, W, 3) RGB, uint8 or uint16.
        right: the same.
        id: the source's name of the pair.
        index: position in the source.
    """

    left: Image
    right: Image
    id: str
    index: int


@dataclass(frozen=True, eq=False)
class BarePairs:
    """An opened source of pairs without a calibration.

    Args:
        summary: what it is.
        ids: names of the pairs.
        refused: pictures without a partner, and the like.
        read: the pictures of a pair by its number.
        film: whether pairs follow one another in time, so that steady ones are to be chosen.
        numbers: which of the source's pairs these are.
    """

    summary: SourceSummary
    ids: tuple[str, ...]
    refused: tuple[tuple[str, PseudolidarError], ...]
    read: ReadPair = field(repr=False)
    film: bool = False
    numbers: tuple[int, ...] = ()

    def load(self, index: int) -> BarePair:
        """Read and decode a pair.

        Raises:
            PseudolidarError: a picture cannot be read.
        """
        left, right = self.read(self.numbers[index] if self.numbers else index)
        return BarePair(left, right, self.ids[index], index)

    def chosen(self, frames: FrameSelection | None, exclude: FrameSelection | None) -> BarePairs:
        """Some of the pairs.

        Raises:
            UsageError: an id that there is not, or nothing left.
        """
        names = tuple(name for name, _ in self.refused)
        return self.at(sorted(chosen_positions(self.ids, names, frames, exclude)))

    def at(self, positions: list[int]) -> BarePairs:
        """The pairs at some positions."""
        every = self.numbers or tuple(range(len(self.ids)))
        return replace(
            self,
            ids=tuple(self.ids[i] for i in positions),
            numbers=tuple(every[i] for i in positions),
        )


@dataclass(frozen=True)
class Pictures:
    """Pictures of both eyes in two folders, in one, or in a folder for each scene.

    Pairs are found by name: folders `left` and `right`, `cam0` and `cam1`; in one folder `left*`
    and `right*`, `*_l` and `*_r`; names that are times are paired by time.

    Args:
        path: folder of both eyes, or of the left one if `right` is given.
        right: folder of the right pictures.
        left_pattern: names of left pictures, such as `cam_a_*.png`.
        right_pattern: names of right pictures, such as `cam_b_*.png`.
        tolerance_s: names that are times are paired up to this difference.
        limits: caps on the files.
    """

    path: str
    right: str | None = None
    left_pattern: str | None = None
    right_pattern: str | None = None
    tolerance_s: float = TOLERANCE_S
    limits: Limits = DEFAULT_LIMITS

    def open(self) -> BarePairs:
        """List and pair the pictures.

        Raises:
            SourceUnknown: no such folder.
            SourceEmpty: no pairs in it.
            UsageError: one pattern without the other.
            NoPairs: it holds several pairs on one body.
        """
        check_one_pair(Path(self.path))
        layout = asked_layout(
            self.path,
            self.right,
            (self.left_pattern, self.right_pattern),
            tolerance_s=self.tolerance_s,
        )
        pairs = layout.pairing.pairs

        def read(number: int) -> tuple[Image, Image]:
            left = read_image(pairs[number].left, limits=self.limits)
            right = read_image(pairs[number].right, limits=self.limits)
            return left.pixels, right.pixels

        summary = SourceSummary(
            kind="pictures",
            path=self.path,
            line=f"{layout.line}: {len(pairs)} pairs by {layout.pairing.rule}",
            notes=(*layout.pairing.notes, *layout.notes),
        )
        ids = tuple(safe_id(pair.key) for pair in pairs)
        return BarePairs(summary, ids, layout.pairing.unpaired, read)

    @classmethod
    def looks_like(cls, path: Path) -> bool:
        """Whether `path` holds pairs of pictures."""
        return path.is_dir() and find_layout(path, tolerance_s=TOLERANCE_S) is not None


def check_one_pair(folder: Path) -> None:
    """Refuse the folder of a body, of which each pair is in a folder of its own.

    Raises:
        NoPairs: it is one.
    """
    if Body.looks_like(folder):
        raise NoPairs(
            "a folder of several pairs on one body",
            want=KIND_NAMES[RawPair],
            fix=NO_PAIRS_FIXES[BodyFrame],
            path=folder,
        )
