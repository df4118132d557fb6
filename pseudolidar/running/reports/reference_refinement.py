"""What a rig that was put right by known depths is worth, in figures and in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pseudolidar.calibration.refine import Refinement
from pseudolidar.calibration.refine_terms import AND_PITCH
from pseudolidar.errors import ALL_DONE, SOME_SKIPPED
from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.evaluation.ranges import RangeErrors, errors_by_range
from pseudolidar.evaluation.sigma import SigmaShares, sigma_shares
from pseudolidar.geometry.triangulation import depth_per_disparity, disparity_from_depth
from pseudolidar.running.table import table_text
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import RowCorrection

# Fits to fewer frames differ by more than they say (KITTI stereo 2015: two fits to 3 frames each by
# 3 of their sigmas, to 5 by 1.1, to 11 by 0.9).
FEW_FRAMES = 5
# Where the systematic error is told, m.
FAR_M = (10, 20, 30, 50, 80)


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
