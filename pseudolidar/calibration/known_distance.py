"""The scale of a rig that pictures alone do not tell, from one distance that somebody measured."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np

from pseudolidar.errors import CalibrationValue, UsageError
from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.rectification import Rectification
from pseudolidar.geometry.robust import robust_sigma
from pseudolidar.structures.arrays import Float32, Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.pose import Pose

Kind = Literal["baseline", "points", "box"]
_NUMBER = r"[0-9]+(?:\.[0-9]*)?"
_FORM = re.compile(
    rf"(points|box):({_NUMBER}),({_NUMBER}),({_NUMBER}),({_NUMBER})=({_NUMBER})(?:@(\S+))?"
)
_BASELINE = re.compile(rf"baseline:({_NUMBER})")
FORMS = "baseline:0.12, points:U,V,U,V=1.8 or box:U,V,U,V=4.5, px of a left picture and metres"
# Around a pixel, matched pixels up to so far from it tell its disparity, px, and so many must.
NEAR_PX, LEAST_NEAR = 3, 5
LEAST_IN_BOX = 20


@dataclass(frozen=True)
class KnownDistance:
    """A distance in metres: between the eyes, between two things, or to one.

    Written `baseline:0.12`; `points:310,200,420,205=1.8`, what is seen at two pixels of a left
    picture is 1.8 m apart; `box:300,180,360,260=4.5`, what a box shows is 4.5 m away along the
    optical axis (its median). `@ID` behind it names the picture, by default the first.

    Args:
        kind: what it is a distance of.
        metres: how long it is.
        px: the four numbers of pixels, in the left picture as it was taken.
        id: the picture's frame, None for the first.
    """

    kind: Kind
    metres: float
    px: tuple[float, float, float, float] | None = None
    id: str | None = None

    @classmethod
    def parse(cls, text: str) -> Self:
        """The distance that `text` writes.

        Raises:
            UsageError: it is of no such form, or 0.
        """
        between = _BASELINE.fullmatch(text)
        seen = _FORM.fullmatch(text)
        metres = float(between[1]) if between else float(seen[6]) if seen else 0.0
        if not metres > 0:
            raise UsageError(f"{text!r}", want=FORMS, where="known_distance")
        if between:
            return cls("baseline", metres)
        assert seen is not None
        u, v, u_other, v_other = (float(seen[k]) for k in range(2, 6))
        kind: Kind = "points" if seen[1] == "points" else "box"
        return cls(kind, metres, (u, v, u_other, v_other), seen[7])

    def __str__(self) -> str:
        if self.px is None:
            return f"baseline:{self.metres:g}"
        pixels = ",".join(f"{value:g}" for value in self.px)
        return f"{self.kind}:{pixels}={self.metres:g}" + (f"@{self.id}" if self.id else "")


@dataclass(frozen=True)
class Scale:
    """Metres of one unit of a rig.

    Args:
        metres: of a unit.
        sigma_share: one standard deviation as a share, by the spread of the disparities of what
            was measured, and by an error that all disparities share; 0 where it was said.
        text: how it is known, in words.
    """

    metres: float
    sigma_share: float
    text: str


def said_scale(known: KnownDistance, rig: StereoRig) -> Scale:
    """The scale where the distance between the eyes is known."""
    between = float(np.linalg.norm(rig.T_right_left.translation_m))
    return Scale(known.metres / between, 0.0, f"the eyes are {known.metres:g} m apart, as said")


def seen_scale(
    known: KnownDistance,
    plan: Rectification,
    disparity: DisparityMap,
    *,
    offset_sigma_px: float = 0.0,
) -> Scale:
    """The scale where a distance is known that a picture shows.

    Args:
        known: with pixels of the left picture as it was taken.
        plan: how that is rectified, in units of its rig.
        disparity: (H, W) px of the rectified picture.
        offset_sigma_px: what all disparities may be off by together.

    Raises:
        CalibrationValue: nothing was matched there.
    """
    assert known.px is not None
    corners = _rectified(plan, np.array(known.px).reshape(2, 2), known)
    if known.kind == "points":
        ends = [_near(disparity, at, known) for at in corners]
        places = [_place(plan.rig, at, d) for at, (d, _) in zip(corners, ends, strict=True)]
        length = float(np.linalg.norm(places[1] - places[0]))
        nudged = [
            float(np.linalg.norm(_place(plan.rig, at, d + sigma) - place))
            for at, (d, sigma), place in zip(corners, ends, places, strict=True)
        ]
        shifted = [
            _place(plan.rig, at, d + offset_sigma_px)
            for at, (d, _) in zip(corners, ends, strict=True)
        ]
        together = float(np.linalg.norm(shifted[1] - shifted[0])) - length
        share = math.hypot(*nudged, together) / length
    else:
        d, sigma = _in_box(disparity, corners, known)
        nearness_px = d + plan.rig.doffs_px
        length = float(plan.rig.fB_px_m / nearness_px)
        share = math.hypot(sigma, offset_sigma_px) / nearness_px
    what = "two things apart" if known.kind == "points" else "away"
    text = f"{known.metres:g} m {what}, as said of {known}"
    return Scale(known.metres / length, share, text)


def scaled_rig(rig: StereoRig, scale: Scale) -> StereoRig:
    """The rig in metres."""
    pose = rig.T_right_left
    matrix = pose.matrix.copy()
    matrix[:3, 3] *= scale.metres
    origin = f"{rig.origin}; scale: {scale.text}" if rig.origin else f"scale: {scale.text}"
    return replace(rig, T_right_left=Pose(pose.dst, pose.src, matrix), metric=True, origin=origin)


def _rectified(plan: Rectification, px: Float64, known: KnownDistance) -> Float64:
    """(2, 2) pixels of the rectified left picture."""
    seen = Lens.of(plan.raw.left).directions(px) @ plan.R_left.T
    flat = (seen @ plan.rig.left.K.T)[:, :2] / seen[:, 2:]
    width, height = plan.rig.left.size_px
    inside = (flat >= 0).all() and (flat <= (width - 1, height - 1)).all()
    if not (np.isfinite(flat).all() and inside):
        raise CalibrationValue(
            f"{known}: outside of the rectified picture",
            want=f"pixels of the left picture, {plan.raw.left.width_px}x{plan.raw.left.height_px}",
            where="known_distance",
        )
    return np.asarray(flat)


def _near(disparity: DisparityMap, at: Float64, known: KnownDistance) -> tuple[float, float]:
    """Disparity around a pixel and its standard deviation."""
    u, v = np.rint(at).astype(int)
    rows = slice(max(0, v - NEAR_PX), v + NEAR_PX + 1)
    columns = slice(max(0, u - NEAR_PX), u + NEAR_PX + 1)
    return _typical(disparity.values[rows, columns], LEAST_NEAR, known)


def _in_box(disparity: DisparityMap, corners: Float64, known: KnownDistance) -> tuple[float, float]:
    (left, top), (right, bottom) = np.sort(np.rint(corners).astype(int), axis=0)
    return _typical(disparity.values[top : bottom + 1, left : right + 1], LEAST_IN_BOX, known)


def _typical(values: Float32, least: int, known: KnownDistance) -> tuple[float, float]:
    found = values[np.isfinite(values) & (values > 0)].astype(np.float64)
    if len(found) < least:
        raise CalibrationValue(
            f"{known}: {len(found)} pixels are matched there",
            want=f"{least} or more",
            fix="Choose a place with texture that both eyes see.",
            where="known_distance",
        )
    middle = float(np.median(found))
    return middle, robust_sigma(found - middle)


def _place(rig: StereoRig, at: Float64, d: float) -> Float64:
    """(3,) where what is seen at a pixel stands, in the rig's units."""
    depth = rig.fB_px_m / (d + rig.doffs_px)
    K = rig.left.K
    return np.array([(at[0] - K[0, 2]) / K[0, 0], (at[1] - K[1, 2]) / K[1, 1], 1.0]) * depth
