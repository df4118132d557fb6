"""Tracks against exact truth: identities, velocities, and whether their sigmas are honest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pseudolidar.evaluation.obstacles import iou
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Box3D

# A track is of a thing whose centre is no farther than this, or this share of its range.
SAME_M, SAME_SHARE = 2.0, 0.06
# Where both have boxes in the picture and these overlap so much (intersection over union), they are
# one thing: far away others are nearer than the error of the distance.
SAME_IOU = 0.5
NEVER = 1e9

BoxPx = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class TrueObject:
    """What is really there in a frame.

    Args:
        number: identity.
        box: in the camera's frame.
        velocity_m_s: (3,) along the camera's axes.
        seen: enough of it can be seen; what is hidden may be missed, or told, without blame.
        box_px: left, top, right, bottom in the picture, where known.
    """

    number: int
    box: Box3D
    velocity_m_s: Float64
    seen: bool = True
    box_px: BoxPx | None = None


@dataclass(frozen=True, eq=False)
class ToldTrack:
    """What a tracker says of a frame.

    Args:
        number: identity.
        box: in the camera's frame.
        velocity_m_s: (3,) along the camera's axes; None where it has none yet.
        sigma_velocity_m_s: (3,) one standard deviation; None where nobody gave one.
        coasting: predicted, not seen.
        box_px: what it was seen as in the picture, where known.
    """

    number: int
    box: Box3D
    velocity_m_s: Float64 | None = None
    sigma_velocity_m_s: Float64 | None = None
    coasting: bool = False
    box_px: BoxPx | None = None


@dataclass(frozen=True, eq=False)
class TrackScore:
    """How well tracks are those of the things.

    Args:
        objects: seen objects, summed over frames.
        missed: of them without a track.
        wrong: tracks of nothing, coasting ones left out.
        switches: how often the track of a thing became another one.
        fragments: how often a thing that had a track was without one for a while.
        identities: tracks that were ever told, coasting and wrong ones included.
        place_off_m: (N,) distance of the centres, tracks that were seen.
        coasting_off_m: (M,) likewise of those that coasted.
        velocity_off_m_s: (K, 3) errors of velocity.
        sigma_velocity_m_s: (K, 3) one standard deviation of them; NaN where nobody gave one.
    """

    objects: int
    missed: int
    wrong: int
    switches: int
    fragments: int
    identities: int
    place_off_m: Float64
    coasting_off_m: Float64
    velocity_off_m_s: Float64
    sigma_velocity_m_s: Float64

    @property
    def mota(self) -> float:
        """1 - (missed + wrong + switches) / objects.

        Source: Bernardin & Stiefelhagen, Evaluating multiple object tracking performance: the
        CLEAR MOT metrics, 2008.
        """
        return 1.0 - (self.missed + self.wrong + self.switches) / max(1, self.objects)

    @property
    def speed_errors_m_s(self) -> Float64:
        """(K,) lengths of the errors of velocity on the level (the camera's x and z)."""
        return np.asarray(np.hypot(self.velocity_off_m_s[:, 0], self.velocity_off_m_s[:, 2]))

    @property
    def within_1_sigma(self) -> float | None:
        """Share of the errors of velocity along x and z within their sigma, 0-1."""
        return self._within(1.0)

    @property
    def within_2_sigma(self) -> float | None:
        """Likewise within twice their sigma: 0.954 is honest."""
        return self._within(2.0)

    def _within(self, sigmas: float) -> float | None:
        off, sigma = self.velocity_off_m_s[:, ::2], self.sigma_velocity_m_s[:, ::2]
        known = np.isfinite(sigma)
        return float(np.mean(np.abs(off[known]) <= sigmas * sigma[known])) if known.any() else None

    @property
    def normalised_squared(self) -> float | None:
        """Mean of (error / sigma)^2 of velocities along x and z: 1 is honest."""
        off, sigma = self.velocity_off_m_s[:, ::2], self.sigma_velocity_m_s[:, ::2]
        known = np.isfinite(sigma)
        return float(np.mean((off[known] / sigma[known]) ** 2)) if known.any() else None

    def as_dict(self) -> dict[str, Any]:
        """The figures; None where there is nothing to tell."""
        return {
            "objects": self.objects,
            "mota": self.mota if self.objects else None,
            "missed": self.missed,
            "wrong": self.wrong,
            "switches": self.switches,
            "fragments": self.fragments,
            "identities": self.identities,
            "place_median_abs_m": _quantile(self.place_off_m, 0.5),
            "coasting_median_abs_m": _quantile(self.coasting_off_m, 0.5),
            "velocity_median_abs_m_s": _quantile(self.speed_errors_m_s, 0.5),
            "velocity_p90_abs_m_s": _quantile(self.speed_errors_m_s, 0.9),
            "velocity_within_1_sigma": self.within_1_sigma,
            "velocity_within_2_sigma": self.within_2_sigma,
            "velocity_normalised_squared": self.normalised_squared,
        }


@dataclass(eq=False)
class TrackJudge:
    """Takes frames in order, and scores them."""

    _last: dict[int, int] = field(default_factory=dict)
    _lost: set[int] = field(default_factory=set)
    _identities: set[int] = field(default_factory=set)
    _counts: dict[str, int] = field(
        default_factory=lambda: dict.fromkeys(
            ("objects", "missed", "wrong", "switches", "fragments"), 0
        )
    )
    _place: list[float] = field(default_factory=list)
    _coasting: list[float] = field(default_factory=list)
    _velocity: list[Float64] = field(default_factory=list)
    _sigma: list[Float64] = field(default_factory=list)

    def add(self, truth: Sequence[TrueObject], told: Sequence[ToldTrack]) -> None:
        """Compare one frame: a thing keeps its track of the last frame while that is near it."""
        self._identities |= {track.number for track in told}
        pairs = same(truth, told, self._last)
        counts = self._counts
        counts["objects"] += sum(one.seen for one in truth)
        found = {row for row, _ in pairs}
        for row, one in enumerate(truth):
            if one.seen and row not in found:
                counts["missed"] += 1
                if one.number in self._last:
                    self._lost.add(one.number)
        taken = {column for _, column in pairs}
        counts["wrong"] += sum(
            not track.coasting for column, track in enumerate(told) if column not in taken
        )
        for row, column in pairs:
            if truth[row].seen or told[column].coasting:
                self._add_pair(truth[row], told[column])

    def _add_pair(self, one: TrueObject, track: ToldTrack) -> None:
        off = track.box.pose.translation_m - one.box.pose.translation_m
        if track.coasting:
            self._coasting.append(float(np.sqrt((off**2).sum())))
        else:
            self._place.append(float(np.sqrt((off**2).sum())))
            if track.velocity_m_s is not None:
                self._velocity.append(track.velocity_m_s - one.velocity_m_s)
                sigma = track.sigma_velocity_m_s
                self._sigma.append(np.full(3, np.nan) if sigma is None else sigma)
        self._counts["switches"] += self._last.get(one.number, track.number) != track.number
        if one.seen and one.number in self._lost:
            self._counts["fragments"] += 1
            self._lost.discard(one.number)
        self._last[one.number] = track.number

    def score(self) -> TrackScore:
        """Of all frames so far."""
        return TrackScore(
            **self._counts,
            identities=len(self._identities),
            place_off_m=np.array(self._place),
            coasting_off_m=np.array(self._coasting),
            velocity_off_m_s=np.array(self._velocity).reshape(-1, 3),
            sigma_velocity_m_s=np.array(self._sigma).reshape(-1, 3),
        )


def pooled(scores: Sequence[TrackScore]) -> TrackScore:
    """Several runs as one."""

    def together(name: str) -> Float64:
        return np.concatenate([getattr(one, name) for one in scores])

    counts = ("objects", "missed", "wrong", "switches", "fragments", "identities")
    arrays = ("place_off_m", "coasting_off_m", "velocity_off_m_s", "sigma_velocity_m_s")
    return TrackScore(
        *(sum(getattr(one, name) for one in scores) for name in counts),
        *(together(name) for name in arrays),
    )


def same(
    truth: Sequence[TrueObject], told: Sequence[ToldTrack], last: dict[int, int]
) -> list[tuple[int, int]]:
    """Pairs of a thing and a track: those of the last frame that still hold, then the nearest."""
    from scipy.optimize import linear_sum_assignment

    if not truth or not told:
        return []
    off = np.array([[_off(one, track) for track in told] for one in truth])
    # A track that coasts is of the thing that it was of, if that is seen, and of no other.
    for row, one in enumerate(truth):
        for column, track in enumerate(told):
            if one.seen and track.coasting and last.get(one.number) != track.number:
                off[row, column] = NEVER
    pairs = [
        (row, column)
        for row, one in enumerate(truth)
        for column, track in enumerate(told)
        if last.get(one.number) == track.number and off[row, column] < NEVER
    ]
    for row, column in pairs:
        off[row, :] = off[:, column] = NEVER
    rows, columns = linear_sum_assignment(off)
    rest = zip(rows.tolist(), columns.tolist(), strict=True)
    return pairs + [(row, column) for row, column in rest if off[row, column] < NEVER]


def _off(one: TrueObject, track: ToldTrack) -> float:
    """How far apart they are: boxes in the picture where both have one, else centres, m.

    `NEVER` where that is too much for one thing.
    """
    if one.box_px is not None and track.box_px is not None:
        overlap = iou(one.box_px, track.box_px)
        return 1.0 - overlap if overlap >= SAME_IOU else NEVER
    a, b = track.box.pose.translation_m, one.box.pose.translation_m
    off_m = float(np.sqrt(((a - b) ** 2).sum()))
    return off_m if off_m <= max(SAME_M, SAME_SHARE * float(np.sqrt((b**2).sum()))) else NEVER


def _quantile(values: Float64, share: float) -> float | None:
    return float(np.quantile(values, share)) if len(values) else None
