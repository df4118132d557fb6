"""A rig put right by depths that are known, and what that is worth on frames outside the fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pseudolidar.calibration.reference import Reference
from pseudolidar.calibration.refine import Refinement, refined
from pseudolidar.calibration.refine_terms import AND_PITCH
from pseudolidar.errors import ALL_DONE, SOME_SKIPPED, PseudolidarError, ReferenceMissing
from pseudolidar.evaluation.compared import ComparedFrame, against_scan, against_truth
from pseudolidar.evaluation.ranges import RangeErrors, errors_by_range
from pseudolidar.evaluation.sigma import SigmaShares, sigma_shares
from pseudolidar.geometry.triangulation import depth_per_disparity, disparity_from_depth
from pseudolidar.running.bad_frames import OnError, good_frames
from pseudolidar.running.crew.attempt import Skipped
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.stream import stream
from pseudolidar.running.table import table_text
from pseudolidar.sources.source import FrameSource
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import RowCorrection
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.samples import DisparitySamples

# Frames are left out in so many turns to judge what the correction is worth.
FOLDS = 5
# Fits to fewer frames differ by more than they say (KITTI stereo 2015: two fits to 3 frames each by
# 3 of their sigmas, to 5 by 1.1, to 11 by 0.9).
FEW_FRAMES = 5
# Points beyond these quantiles of depth are too few to say what the rig does there.
OUTER = (0.01, 0.99)
# Where the systematic error is told, m.
FAR_M = (10, 20, 30, 50, 80)


@dataclass(frozen=True)
class CompareFrame:
    """Matches one frame and compares it with its reference.

    Args:
        matcher: pair to disparity.
        kind: which reference.
        most: points to keep.
    """

    matcher: StereoMatcher
    kind: str
    most: int

    def __call__(self, frame: StereoFrame) -> ComparedFrame | None:
        """The comparison; None where the frame has no such reference."""
        if self.kind != "truth" and frame.scan is not None:
            return against_scan(self.matcher(frame), frame).thinned(self.most)
        if self.kind != "scan" and frame.truth is not None:
            return against_truth(self.matcher(frame), frame, most=self.most)
        return None


@dataclass(frozen=True, eq=False)
class Judged:
    """Errors of frames, by range.

    Args:
        by_range: relative depth errors.
        sigma: shares of the errors within the stated sigma; None without sigma.
    """

    by_range: tuple[RangeErrors, ...]
    sigma: SigmaShares | None

    @classmethod
    def of(cls, frames: Sequence[ComparedFrame]) -> Judged:
        """Pooled over all points of all frames, by their rigs as they are."""
        depth_m = np.concatenate([frame.depth_m for frame in frames])
        reference_m = np.concatenate([frame.reference_m for frame in frames])
        error_px = np.concatenate([frame.corrected_px - frame.reference_px for frame in frames])
        sigmas = [frame.total_sigma_px for frame in frames]
        known = [sigma for sigma in sigmas if sigma is not None]
        shares = None
        if len(known) == len(sigmas):
            both = np.isfinite(error_px)
            shares = sigma_shares(error_px[both], np.concatenate(known)[both])
        return cls(errors_by_range(depth_m, reference_m), shares)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        sigma = None if self.sigma is None else self.sigma.as_dict()
        return {"bins": [each.as_dict() for each in self.by_range], "sigma": sigma}


@dataclass(frozen=True, eq=False)
class ReferenceRefinement:
    """A rig, and what it is worth.

    Args:
        rig: with its correction.
        refinement: how that was found.
        before: errors by the rig as it came.
        after: errors of each frame by a correction fitted to other frames; None for one frame.
        kinds: how many frames were compared with what.
        without: frames that have no reference.
        skipped: id and reason of frames that could not be used.
        replaced: whether the rig had a correction that this one replaces.
    """

    rig: StereoRig
    refinement: Refinement
    before: Judged
    after: Judged | None
    kinds: dict[str, int]
    without: int
    skipped: Sequence[tuple[str, str]]
    replaced: bool

    def with_rows(self, rows: RowCorrection | None) -> ReferenceRefinement:
        """The same for pictures whose rows `rows` puts right."""
        return replace(self, rig=self.rig.with_rows(rows))

    @property
    def exit_code(self) -> int:
        """4 if frames were skipped, else 0."""
        return SOME_SKIPPED if self.skipped else ALL_DONE

    @property
    def changed(self) -> bool:
        """Whether there is anything to be stored."""
        return self.refinement.corrects or bool(self.refinement.lidar_pitch_rad)

    @property
    def lines(self) -> tuple[str, ...]:
        """For people."""
        found, correction = self.refinement, self.refinement.correction
        kinds = ", ".join(f"{count} by {kind}" for kind, count in self.kinds.items())
        lines = [f"{found.samples} points of {found.frames} frames ({kinds})"]
        if self.without:
            lines.append(f"{self.without} frames without a reference are left out")
        if 1 < found.frames < FEW_FRAMES:
            lines.append(
                f"{found.frames} frames look more alike than those to come: {FEW_FRAMES} or more "
                "say more"
            )
        lines += [f"not fitted: {refused}" for refused in found.choice.refusals]
        tried = ", ".join(
            f"{each.name.removesuffix(AND_PITCH)} {each.left_px:.3f}"
            for each in found.choice.candidates
            if each.left_px is not None
        )
        lines.append(f"left on frames outside the fit, px: {tried}")
        lines.append(
            f"correction: {found.choice.chosen.name}; leaves {correction.residual_px:.2f} px; "
            f"sigma of the matcher times {correction.sigma_scale}"
        )
        if found.lidar_pitch_rad:
            lines.append(
                f"pitch of the LiDAR: its scans lie {_pitch_text(found)} too low, and are raised"
            )
        lines.append(self._far)
        lines.append(self._table())
        if self.after is None:
            lines.append("one frame: what it is worth on others cannot be told")
        if self.replaced:
            lines.append("the correction that the rig had is replaced")
        return (*lines, *(f"skipped: {name}: {reason}" for name, reason in self.skipped))

    @property
    def systematic_rel(self) -> dict[int, float]:
        """Error that all depths of a surface may share, one standard deviation, by depth in m.

        As far as there were points to fit to.
        """
        rig = self.rig
        farthest_m = self.refinement.correction.fitted_m or (0.0, math.inf)
        depth_m = np.array([each for each in FAR_M if each <= farthest_m[1]], np.float64)
        centre = np.full(len(depth_m), rig.left.K[0, 2])
        d = disparity_from_depth(depth_m, centre, rig)
        relative = depth_per_disparity(d, depth_m, rig) / depth_m
        relative *= self.refinement.correction.residual_px
        return {int(z): float(share) for z, share in zip(depth_m, relative, strict=True)}

    @property
    def _far(self) -> str:
        shares = ", ".join(f"{rel:.1%} at {z} m" for z, rel in self.systematic_rel.items())
        line = f"systematic error left of the depths (68 %): {shares or 'not known'}"
        fitted_m = self.refinement.correction.fitted_m
        if fitted_m is None:
            return line
        return f"{line}; fitted at {fitted_m[0]:.0f} to {fitted_m[1]:.0f} m"

    def _table(self) -> str:
        heads = ("depth error", *(f"{b.from_m}-{b.to_m} m" for b in self.before.by_range), "sigma")
        rows = [("before", *_cells(self.before))]
        if self.after is not None:
            rows.append(("after, on frames left out", *_cells(self.after)))
        return table_text(rows, header=heads)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        correction = self.refinement.correction
        covariance = correction.covariance
        return {
            "correction": {
                "terms": self.refinement.choice.chosen.name,
                "coefficients": correction.coefficients.tolist(),
                "sigma_coefficients": None
                if covariance is None
                else np.sqrt(np.diag(covariance)).tolist(),
                "residual_px": correction.residual_px,
                "sigma_scale": {
                    "disparities_px": correction.sigma_scale.disparities_px.tolist(),
                    "factors": correction.sigma_scale.factors.tolist(),
                },
                "origin": correction.origin,
                "fitted_m": correction.fitted_m,
                "systematic_rel": [
                    {"at_m": z, "rel": rel} for z, rel in self.systematic_rel.items()
                ],
            },
            "lidar_pitch_deg": float(np.rad2deg(self.refinement.lidar_pitch_rad)),
            "lidar_pitch_sigma_deg": float(np.rad2deg(self.refinement.lidar_pitch_sigma_rad)),
            "candidates": [each.as_dict() for each in self.refinement.choice.candidates],
            "samples": self.refinement.samples,
            "frames": self.refinement.frames,
            "references": self.kinds,
            "without_reference": self.without,
            "before": self.before.as_dict(),
            "after": None if self.after is None else self.after.as_dict(),
            "replaced": self.replaced,
            "skipped": [{"id": name, "reason": reason} for name, reason in self.skipped],
        }


def refined_by_reference(
    source: FrameSource,
    by: Reference,
    matcher: StereoMatcher,
    *,
    crew: CrewPlan,
    on_error: OnError = "skip",
) -> ReferenceRefinement:
    """Match and compare every frame, fit, and judge on frames left out of the fit.

    Args:
        source: pairs with scans or ground truth.
        by: which of them.
        matcher: pair to disparity.
        crew: how the frames are done.
        on_error: what happens when frames fail.

    Raises:
        ReferenceMissing: no frame has a reference.
        CalibrationValue: too little of it, or frames of several image sizes.
        CalibrationUnits: the rig's lengths are no metres.
        TooManyBadFrames: as `good_frames`.
    """
    source.rig.check_metric()
    compare = CompareFrame(matcher, by.kind, max(1, by.most // max(1, len(source.ids))))
    compared: list[ComparedFrame] = []
    without = 0
    skipped: list[Skipped] = []
    outcomes = stream(source, compare, crew=crew)
    with FrameProgress(len(source.ids)) as progress:
        for frame in good_frames(
            outcomes, frames=len(source.ids), on_error=on_error, skipped=skipped.append
        ):
            progress.advance()
            if frame.value is None:
                without += 1
            else:
                compared.append(frame.value)
    if not compared:
        raise ReferenceMissing(
            f"{source.summary.line}: no frame has a reference",
            want="frames with LiDAR scans or ground truth",
            fix="Take another source, or fit to the motion of a sequence: --by motion.",
            path=source.summary.path,
        )
    stock = [each.with_correction(None) for each in compared]
    fitted_m = _fitted_m(stock)
    found = refined(_samples(stock), origin=_origin(source, stock), fitted_m=fitted_m)
    rig = source.rig.with_correction(found.correction if found.corrects else None)
    return ReferenceRefinement(
        rig=rig.with_lidar_raised(found.lidar_pitch_rad),
        refinement=found,
        before=Judged.of(compared),
        after=_on_frames_left_out(stock),
        kinds={kind: n for kind, n in _kinds(stock).items() if n},
        without=without,
        skipped=[(frame.id, str(frame.error)) for frame in skipped],
        replaced=source.rig.correction is not None,
    )


def _samples(frames: Sequence[ComparedFrame]) -> DisparitySamples:
    return DisparitySamples.concatenate([frame.samples() for frame in frames])


def _fitted_m(frames: Sequence[ComparedFrame]) -> tuple[float, float]:
    """Nearest and farthest depth of the points, but for one in a hundred; 0, 0 without any."""
    depth_m = np.concatenate([frame.reference_m[frame.matched] for frame in frames])
    if not len(depth_m):
        return 0.0, 0.0
    near_m, far_m = np.quantile(depth_m, OUTER)
    return float(near_m), float(far_m)


def _kinds(frames: Sequence[ComparedFrame]) -> dict[str, int]:
    return {kind: sum(f.kind == kind for f in frames) for kind in ("scan", "truth")}


def _origin(source: FrameSource, frames: Sequence[ComparedFrame]) -> str:
    words = {"scan": "LiDAR scans", "truth": "ground truth"}
    kinds = " and ".join(words[kind] for kind, n in _kinds(frames).items() if n)
    return f"{kinds} of {len(frames)} frames of {source.summary.name}"


def _on_frames_left_out(frames: Sequence[ComparedFrame]) -> Judged | None:
    """Each frame judged by a correction that was fitted to others; None for one frame."""
    turns = min(FOLDS, len(frames))
    if turns < 2:
        return None
    judged: list[ComparedFrame] = []
    for turn in range(turns):
        others = [frame for i, frame in enumerate(frames) if i % turns != turn]
        try:
            found = refined(_samples(others))
        except PseudolidarError:
            return None  # too few points without them
        judged += [
            frame.with_correction(found.correction).raised(found.lidar_pitch_rad)
            for frame in frames[turn::turns]
        ]
    return Judged.of(judged)


def _pitch_text(found: Refinement) -> str:
    pitch, sigma = np.rad2deg([found.lidar_pitch_rad, found.lidar_pitch_sigma_rad])
    return f"{pitch:.3f} +- {sigma:.3f} degrees"


def _cells(judged: Judged) -> tuple[str, ...]:
    cells = [
        "-"
        if b.median_rel is None or b.bias_rel is None
        else f"{b.median_rel:.2%} ({100 * b.bias_rel:+.2f})"
        for b in judged.by_range
    ]
    shares = judged.sigma
    if shares is None or shares.within_1_sigma is None or shares.within_95 is None:
        return (*cells, "-")
    return (*cells, f"{shares.within_1_sigma:.0%} / {shares.within_95:.0%}")
