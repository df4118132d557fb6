"""A rig put right by the pictures of a sequence alone: its motion, and points of both eyes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pseudolidar.calibration.motion import Motion, MotionEstimator
from pseudolidar.calibration.motion_fit import MotionFit
from pseudolidar.calibration.rows import RowFit, RowPoints, Rows, fit_rows, row_points
from pseudolidar.errors import ALL_DONE, SOME_SKIPPED, CalibrationValue
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.rows import rows_aligned
from pseudolidar.geometry.tracking import MatchedPair
from pseudolidar.running.bad_frames import OnError, good_frames
from pseudolidar.running.crew.attempt import Skipped
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.stream import stream
from pseudolidar.sources.selection import SelectedSource
from pseudolidar.sources.source import FrameSource
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import StereoFrame

# So many frames are matched again with their rows put right, to tell what it is worth.
FRAMES_TRIED = 6
# Projections of one rig agree to this: text files have 7 digits.
SAME_RIG = 1e-6


@dataclass(frozen=True, eq=False)
class LookedAt:
    """What is kept of one frame.

    Args:
        pair: its pictures and disparities, where motion is looked for.
        points: where rows are looked at.
        T_map_left: (4, 4) where the left camera was, if the source knows.
        density: share of its pixels that have a disparity.
    """

    pair: MatchedPair | None
    points: RowPoints | None
    T_map_left: Float64 | None
    density: float


@dataclass(frozen=True)
class LookAt:
    """Matches one frame, and finds its points in both eyes.

    Args:
        rig: of all frames.
        matcher: pair to disparity.
        motion: whether its pictures are followed afterwards.
        rows: indices of the frames whose rows are looked at.
    """

    rig: StereoRig
    matcher: StereoMatcher
    motion: bool
    rows: frozenset[int]

    def __call__(self, frame: StereoFrame) -> LookedAt:
        """Pictures, points and density.

        Raises:
            CalibrationValue: the frame is of another rig.
        """
        for mine, theirs in (
            (self.rig.P_left, frame.rig.P_left),
            (self.rig.P_right, frame.rig.P_right),
        ):
            if not np.allclose(mine, theirs, rtol=SAME_RIG, atol=0):
                raise CalibrationValue(
                    f"a frame of another rig: f {frame.rig.left.focal_px:g} px",
                    want=f"frames of one rig: f {self.rig.left.focal_px:g} px",
                    fix="Choose frames of one rig with --frames.",
                    where=frame.id,
                )
        disparity = self.matcher(frame)
        pair = MatchedPair.of(frame, disparity)
        points = row_points(pair) if frame.index in self.rows else None
        T_map_left = None
        if frame.pose is not None:
            T_map_left = (frame.pose @ left_in_base_link(frame.rig)).matrix
        followed = pair if self.motion else None
        return LookedAt(followed, points, T_map_left, float(disparity.valid.mean()))


@dataclass(frozen=True, eq=False)
class PictureRefinement:
    """A rig, and what was put right.

    Args:
        rig: with its corrections.
        motion: where the motion was looked at.
        rows: what points of both eyes say.
        density: before and after the rows were put right, on some frames; None where they stay.
        skipped: id and reason of frames that could not be used.
        replaced: whether the rig had corrections that these replace.
    """

    rig: StereoRig
    motion: MotionFit | None
    rows: RowFit
    density: tuple[float, float] | None
    skipped: Sequence[tuple[str, str]]
    replaced: bool

    @property
    def exit_code(self) -> int:
        """4 if frames were skipped, else 0."""
        return SOME_SKIPPED if self.skipped else ALL_DONE

    @property
    def changed(self) -> bool:
        """Whether there is anything to be stored."""
        return self.motion is not None or self.rows.correction is not None

    @property
    def lines(self) -> tuple[str, ...]:
        """For people."""
        lines = [] if self.motion is None else [*self.motion.lines]
        lines.append(self.rows.line)
        if self.density is not None:
            before, after = self.density
            lines.append(f"rows: pixels matched {before:.1%} before, {after:.1%} after")
        if self.replaced:
            lines.append("corrections that the rig had are replaced")
        lines += [f"skipped: {name}: {reason}" for name, reason in self.skipped]
        return tuple(lines)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        before, after = self.density or (None, None)
        return {
            "motion": None if self.motion is None else self.motion.as_dict(),
            "rows": self.rows.as_dict() | {"density_before": before, "density_after": after},
            "replaced": self.replaced,
            "skipped": [{"id": name, "reason": reason} for name, reason in self.skipped],
        }


def refined_by_pictures(
    source: FrameSource,
    by: Motion | Rows,
    matcher: StereoMatcher,
    *,
    crew: CrewPlan,
    on_error: OnError = "skip",
) -> PictureRefinement:
    """Look at a sequence, and put right what its pictures tell of the rig.

    Args:
        source: pairs as they were taken, rows not yet put right.
        by: what is looked at; the motion, rows included, or rows alone.
        matcher: pair to disparity.
        crew: how the frames are done.
        on_error: what happens when frames fail.

    Raises:
        MotionInsufficient: the sequence does not carry what is asked of its motion.
        TooManyBadFrames: as `good_frames`.
    """
    n = len(source.ids)
    rig = source.rig.with_rows(None).with_correction(None)
    row_frames = set((by if isinstance(by, Rows) else Rows()).needed(n))
    needed = {*row_frames, *(by.needed(n) if isinstance(by, Motion) else ())}
    look = LookAt(rig, matcher, isinstance(by, Motion), _indices(source, row_frames))
    unneeded = {name for position, name in enumerate(source.ids) if position not in needed}
    gathered = _Gathered(by.load(rig, n) if isinstance(by, Motion) else None)
    skipped: list[Skipped] = []
    outcomes = stream(source, look, crew=crew, skip=unneeded)
    with FrameProgress(len(needed)) as progress:
        for frame in good_frames(
            outcomes, frames=len(needed), on_error=on_error, skipped=skipped.append
        ):
            progress.advance()
            gathered.add(frame.index, frame.value)
    rows = fit_rows(gathered.points)
    motion = None if gathered.estimator is None else gathered.estimator.fit()
    correction = source.rig.correction if motion is None else motion.correction
    corrected = rig.with_rows(rows.correction).with_correction(correction)
    return PictureRefinement(
        rig=corrected,
        motion=motion,
        rows=rows,
        density=_density(source, matcher, rows, gathered.densities),
        skipped=[(frame.id, str(frame.error)) for frame in skipped],
        replaced=_replaced(source.rig, corrected),
    )


class _Gathered:
    """What frames told, in order.

    Args:
        estimator: follows their pictures, where the motion is looked at.
    """

    def __init__(self, estimator: MotionEstimator | None) -> None:
        self.estimator = estimator
        self.points: list[RowPoints] = []
        self.densities: list[tuple[int, float]] = []

    def add(self, position: int, looked: LookedAt) -> None:
        if self.estimator is not None and looked.pair is not None:
            self.estimator.add(position, looked.pair, looked.T_map_left)
        if looked.points is not None:
            self.points.append(looked.points)
            self.densities.append((position, looked.density))


def _indices(source: FrameSource, positions: set[int]) -> frozenset[int]:
    """The frames' own indices: where a source is a selection, those in the whole."""
    if isinstance(source, SelectedSource):
        return frozenset(source.chosen[position] for position in positions)
    return frozenset(positions)


def _density(
    source: FrameSource, matcher: StereoMatcher, fit: RowFit, tried: list[tuple[int, float]]
) -> tuple[float, float] | None:
    """Share of pixels with a disparity before and after, on evenly spread frames."""
    if fit.correction is None or not tried:
        return None
    chosen = np.unique(np.linspace(0, len(tried) - 1, FRAMES_TRIED).round().astype(int))
    after = []
    for position in chosen:
        frame = source.load(tried[position][0])
        aligned = replace(frame, right=rows_aligned(frame.right, fit.correction))
        after.append(float(matcher(aligned).valid.mean()))
    before = float(np.mean([tried[position][1] for position in chosen]))
    return before, float(np.mean(after))


def _replaced(old: StereoRig, new: StereoRig) -> bool:
    return any(
        mine is not None and mine is not theirs
        for mine, theirs in ((old.correction, new.correction), (old.rows, new.rows))
    )
