"""Several detectors as one: what two of them see is one thing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.formats.regions import NO_CLASS
from pseudolidar.obstacles.cloud import THING
from pseudolidar.obstacles.detector import Detector, DetectorSettings
from pseudolidar.obstacles.overlap import agreement
from pseudolidar.obstacles.sight import Sight
from pseudolidar.obstacles.within import NEAR_THING
from pseudolidar.structures.arrays import Bool
from pseudolidar.structures.box import Detection

# Names that say no more than that something is there.
UNSPECIFIC = frozenset({THING, NEAR_THING, NO_CLASS, "colour", "template"})


@dataclass(frozen=True)
class Combined:
    """What several detectors find, agreeing things merged.

    Args:
        detectors: in order.
        agree: intersection over union of boxes or masks from which on two are of one thing.
    """

    detectors: tuple[DetectorSettings, ...]
    agree: float = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.agree <= 1:
            raise UsageError(f"agree {self.agree}", want="above 0, to 1", where="agree")

    def load(self) -> CombinedDetectors:
        """The detector. Raises what its parts raise."""
        return CombinedDetectors(tuple(one.load() for one in self.detectors), self.agree)


@dataclass(frozen=True)
class CombinedDetectors:
    """Asks all, and merges what agrees.

    Args:
        detectors: to ask, in order.
        agree: see `Combined`.
    """

    detectors: tuple[Detector, ...]
    agree: float

    def __call__(self, sight: Sight) -> tuple[Detection, ...]:
        """Things of the first detector, then those of the others that are new.

        Two things of one detector are never merged: it tells them apart for its reasons.
        """
        found: tuple[Detection, ...] = ()
        for detector in self.detectors:
            found = merged(found, detector(sight), self.agree)
        return found


def merged(
    first: Sequence[Detection], second: Sequence[Detection], agree: float
) -> tuple[Detection, ...]:
    """Both lists as one, pairs that agree best merged first; each thing is in one pair at most."""
    pairs = sorted(
        ((agreement(a, b), i, j) for i, a in enumerate(first) for j, b in enumerate(second)),
        key=lambda pair: (-pair[0], pair[1:]),
    )
    result, partners = list(first), dict[int, int]()
    for share, i, j in pairs:
        if share >= agree and i not in partners.values() and j not in partners:
            partners[j] = i
            result[i] = _one_of(first[i], second[j])
    return (*result, *(b for j, b in enumerate(second) if j not in partners))


def _one_of(a: Detection, b: Detection) -> Detection:
    """Named and placed by the more specific, else the surer one; with a mask if one has it."""
    better, other = (b, a) if _rank(b) > _rank(a) else (a, b)
    mask = better.mask
    if mask is None and other.mask is not None:
        mask = _cut(other.mask, better.box_px)
    return replace(better, score=max(a.score, b.score), mask=mask)


def _rank(detection: Detection) -> tuple[bool, float]:
    return detection.name not in UNSPECIFIC, detection.score


def _cut(mask: Bool, box_px: tuple[float, float, float, float]) -> Bool | None:
    """The part of a mask inside of a box; None where that is nothing."""
    left, top, right, bottom = (max(0, round(edge)) for edge in box_px)
    cut = np.zeros_like(mask)
    window = slice(top, bottom + 1), slice(left, right + 1)
    cut[window] = mask[window]
    return cut if cut.any() else None
