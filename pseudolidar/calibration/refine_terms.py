"""Which terms a disparity correction may have: what the data carry, and what holds outside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.calibration.refine_fit import (
    PITCH,
    block_columns,
    block_medians,
    coefficients,
    rising,
    some_of,
)
from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.samples import DisparitySamples

ONE, D, X, Y, XX, XY, YY, XXX, XXY, XXXX = range(DisparityCorrection.TERMS)
# From nothing to all: what a rig does first stands first. A vergence (x^2) and a scale (d) are what
# wrong calibrations have; tilts and the rest follow.
LADDER: tuple[tuple[str, tuple[int, ...]], ...] = (
    ("none", ()),
    ("offset", (ONE,)),
    ("offset and scale", (ONE, D)),
    ("offset and vergence", (ONE, XX)),
    ("offset, scale, vergence", (ONE, D, XX)),
    ("offset, scale, tilt", (ONE, D, X, Y)),
    ("offset, scale, tilt, vergence", (ONE, D, X, Y, XX)),
    ("third order", (ONE, D, X, Y, XX, XY, YY, XXX)),
    ("all", (ONE, D, X, Y, XX, XY, YY, XXX, XXY, XXXX)),
)
AND_PITCH = "; pitch of the LiDAR"
FOLDS = 5
# Fits that only decide on the terms are made to so many samples: of KITTI stereo 2015, what is left
# by them differs by less than 0.002 px from that of fits to all.
MAX_SAMPLES = 25_000
# A simpler set is taken where it is worse by no more standard errors, or by less than this, px.
ALIKE_SIGMAS, ALIKE_PX = 1.0, 0.005
# Coverage that terms need: share of the image's width and height between the outer 5 % of the
# samples, and largest disparity over smallest, likewise.
MIN_COLUMNS, MIN_ROWS, MIN_DISPARITIES = 0.5, 0.3, 2.0
OUTER = (0.05, 0.95)
# Terms of third order and the pitch of a LiDAR want this many frames: fewer see too few places with
# too few disparities, and the pitch of KITTI's differs by 0.03 degrees from frame to frame.
MIN_FRAMES_FOR_MORE = 3
# The pitch of a LiDAR is seen where this share of the samples or more rises towards the camera, and
# as many do not.
MIN_RISING = 0.1


@dataclass(frozen=True)
class Candidate:
    """A set of terms and what it leaves on data outside the fit.

    Args:
        name: in words.
        terms: numbers of the features.
        left_px: mean absolute median error of blocks outside the fit; None where it was not tried.
        refused: why the data do not carry it; empty where they do.
    """

    name: str
    terms: tuple[int, ...]
    left_px: float | None
    refused: str = ""

    def as_dict(self) -> dict[str, Any]:
        """The fields."""
        return vars(self) | {"terms": list(self.terms)}


@dataclass(frozen=True)
class Choice:
    """The terms that are fitted, and those that were tried.

    Args:
        chosen: the simplest that is as good as the best.
        candidates: all, from none to all terms.
    """

    chosen: Candidate
    candidates: tuple[Candidate, ...]

    @property
    def refusals(self) -> tuple[str, ...]:
        """What the data do not carry, each once."""
        return tuple(dict.fromkeys(c.refused for c in self.candidates if c.refused))


def parts_of(samples: DisparitySamples) -> Int64:
    """(N,) number of the part that each sample is left out with: frames; of one, its columns."""
    frames = np.unique(samples.frame, return_inverse=True)[1]
    part = block_columns(samples) if not frames.any() else frames
    return np.asarray(part % max(2, min(FOLDS, int(part.max()) + 1)), np.int64)


def choose_terms(samples: DisparitySamples, *, pitch: bool) -> Choice:
    """The simplest set of terms that is as good as the best one on parts outside the fit.

    Args:
        samples: of several frames where more than an offset is wanted.
        pitch: beside every set, the pitch of the LiDAR that the reference is of.
    """
    part = parts_of(samples)
    tried: list[tuple[Candidate, Float64]] = []
    candidates: list[Candidate] = []
    for rig_name, rig_terms in LADDER:
        name, terms = rig_name, rig_terms
        if pitch:
            name, terms = rig_name + AND_PITCH, (*rig_terms, PITCH)
        refused = _not_carried(samples, part, rig_terms)
        if refused:
            candidates.append(Candidate(name, terms, None, refused))
            continue
        left = _left_by_part(samples, part, terms)
        candidates.append(Candidate(name, terms, float(left.mean())))
        tried.append((candidates[-1], left))
    best = min(tried, key=lambda pair: float(pair[1].mean()))[1]
    chosen = next(candidate for candidate, left in tried if _alike(left, best))
    return Choice(chosen, tuple(candidates))


def tells_pitch(samples: DisparitySamples) -> bool:
    """Whether the samples of several frames show a ground and things that stand on it."""
    frames = len(np.unique(samples.frame))
    if samples.per_pitch is None or frames < MIN_FRAMES_FOR_MORE:
        return False
    return MIN_RISING <= float(rising(samples).mean()) <= 1 - MIN_RISING


def _alike(left: Float64, best: Float64) -> bool:
    more = left - best
    chance = ALIKE_SIGMAS * more.std(ddof=1) / np.sqrt(len(more)) if len(more) > 1 else 0.0
    return bool(more.mean() <= max(ALIKE_PX, chance))


def _left_by_part(samples: DisparitySamples, part: Int64, terms: tuple[int, ...]) -> Float64:
    """(parts,) mean absolute median error of the blocks of each part, fitted to the others.

    Fitted to `MAX_SAMPLES` of them, judged on all.
    """
    left, start = list[float](), None
    for turn in np.unique(part):
        held = part == turn
        rest = samples if held.all() else samples[~held]
        start = coefficients(some_of(rest, MAX_SAMPLES), terms, start=start)
        left.append(float(np.abs(list(block_medians(samples[held], start))).mean()))
    return np.array(left)


def _not_carried(samples: DisparitySamples, part: Int64, terms: tuple[int, ...]) -> str:
    """What is missing for a set of terms; empty where nothing is."""
    if len(terms) > 1 and not np.ptp(part):
        return "more than an offset needs several frames, or more than a quarter of the width"
    width, height = samples.size_px
    low, high = np.quantile(samples.reference, OUTER)
    columns = float(np.diff(np.quantile(samples.u, OUTER))[0]) / width
    rows = float(np.diff(np.quantile(samples.v, OUTER))[0]) / height
    frames = len(np.unique(samples.frame))
    if D in terms and high < MIN_DISPARITIES * low:
        return (
            f"a scale needs disparities that differ by {MIN_DISPARITIES:g} times; "
            f"they are {low:.1f} to {high:.1f} px"
        )
    if {X, XX, XXX} & set(terms) and columns < MIN_COLUMNS:
        return f"tilt and vergence need {MIN_COLUMNS:.0%} of the width; {columns:.0%} is covered"
    if {Y, YY} & set(terms) and rows < MIN_ROWS:
        return f"tilt needs {MIN_ROWS:.0%} of the height; {rows:.0%} is covered"
    if XXX in terms and frames < MIN_FRAMES_FOR_MORE:
        return f"all terms need {MIN_FRAMES_FOR_MORE} frames; there are {frames}"
    return ""
