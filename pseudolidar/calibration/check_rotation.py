"""Whether one eye is turned against what the rig says, from all pairs that were looked at."""

from __future__ import annotations

import numpy as np

from pseudolidar.calibration.check_finding import SUREST, Finding, sure_beyond
from pseudolidar.calibration.drift import NAMES, EyeRotation
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig

ROTATION = "rotation"
YAW = 1
# Row difference that is worth a word if putting the turn right gains it, px; a third of what the
# rows of a pair are warned of.
WORTH_PX = 0.2
MEND = (
    "Write the rig with the turn put right, `pseudolidar check SOURCE --frames 0::1 --out "
    "rig.json`, and pass --rig rig.json."
)


def rotation_found(rotation: EyeRotation | None, rig: StereoRig, *, why: str = "") -> Finding:
    """Judge how the right eye is turned.

    A turn about the vertical makes all disparities wrong, and hardly shows in the rows: where it is
    seen for sure that is a warning. What a pitch or roll does to the rows is warned of as that.

    Args:
        rotation: from the pairs; None where they do not tell.
        rig: rectified rig of the pairs.
        why: why they do not tell.
    """
    if rotation is None:
        return Finding(ROTATION, "unknown", f"cannot tell: {why or 'too few matches agree'}")
    figures = _figures(rotation)
    if not turned(rotation):
        text = f"no turn that is worth putting right: {angles_text(rotation)}"
        return Finding(ROTATION, "good", text, None, "", figures)
    seen = (
        f"right eye turned against its rig: {angles_text(rotation)}; rows {rotation.before_px:.2f} "
        f"px off, {rotation.after_px:.2f} with it put right"
    )
    if rotation.believed[YAW]:
        moved_px = float(rotation.rotation_rad[YAW] * rig.right.focal_px)
        seen += f"; disparities {abs(moved_px):.1f} px too {'small' if moved_px > 0 else 'large'}"
        sure = sure_beyond(moved_px, 0.0, float(rotation.sigma_rad[YAW] * rig.right.focal_px))
        return Finding(ROTATION, "warn", seen, sure, MEND, figures)
    return Finding(
        ROTATION, "note", seen, SUREST if rotation.gained_px > 0 else None, MEND, figures
    )


def turned(rotation: EyeRotation) -> bool:
    """Whether the turn is there for sure, and worth putting right."""
    return bool(
        rotation.believed[YAW] or (rotation.believed.any() and rotation.gained_px > WORTH_PX)
    )


def angles_text(rotation: EyeRotation) -> str:
    """The angles with their standard deviations, in words."""
    degrees, sigmas = np.degrees(rotation.rotation_rad), np.degrees(rotation.sigma_rad)
    parts = [
        f"{name} {angle:+.3f} +- {sigma:.3f}"
        for name, angle, sigma in zip(NAMES, degrees, sigmas, strict=True)
    ]
    return f"{', '.join(parts)} degrees, seen in {rotation.pairs} pairs"


def _figures(rotation: EyeRotation) -> dict[str, float | int | None]:
    degrees: Float64 = np.degrees(rotation.rotation_rad)
    sigmas: Float64 = np.degrees(rotation.sigma_rad)
    named: dict[str, float | int | None] = {}
    for name, angle, sigma in zip(NAMES, degrees, sigmas, strict=True):
        named |= {f"{name}_deg": float(angle), f"{name}_sigma_deg": float(sigma)}
    return named | {
        "pairs": rotation.pairs,
        "matches": rotation.matches,
        "rows_before_px": rotation.before_px,
        "rows_after_px": rotation.after_px,
    }
