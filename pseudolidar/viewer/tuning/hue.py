"""The colour detector set by pointing: a place in the picture to hues, and what they find."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from pseudolidar.geometry.grey import rgb_of
from pseudolidar.obstacles.colour import Colour
from pseudolidar.obstacles.hues import CIRCLE_DEG, Hues, unit_rgb
from pseudolidar.obstacles.measure import measured
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.arrays import Bool, Image, UInt8
from pseudolidar.structures.obstacle import Obstacle

# Pixels about the place that are looked at, to each side.
REACH_PX = 3
# Less saturated or darker pixels have no hue that means anything.
LEAST_SATURATION, LEAST_VALUE = 0.12, 0.08
# The range is so many times the spread of the hues, within these limits to each side, degrees.
SPREADS, NARROWEST_DEG, WIDEST_DEG = 2.5, 10.0, 25.0
# Shadows and glare are less saturated and darker than the place that was pointed at.
SATURATION_SHARE, VALUE_SHARE = 0.6, 0.5
# How well the edge of a colour lies, px.
EDGE_PX = 0.5
# Things that are not found are drawn so much darker; their outline.
DARKER, OUTLINE = 0.3, (255, 212, 59)


def colour_at(image: Image, x: float, y: float) -> Colour | None:
    """The detector for the colour about a place; None where it is grey or black.

    Args:
        image: (H, W, 3) RGB; grey ones have no colour.
        x: column, px.
        y: row, px.
    """
    import cv2

    if image.ndim == 2:
        return None
    height, width = image.shape[:2]
    column, row = (int(np.clip(round(at), 0, size - 1)) for at, size in ((x, width), (y, height)))
    rows = slice(max(row - REACH_PX, 0), row + REACH_PX + 1)
    columns = slice(max(column - REACH_PX, 0), column + REACH_PX + 1)
    patch = np.ascontiguousarray(unit_rgb(image)[rows, columns])
    hue, saturation, value = np.moveaxis(np.asarray(cv2.cvtColor(patch, cv2.COLOR_RGB2HSV)), 2, 0)
    coloured = (saturation > LEAST_SATURATION) & (value > LEAST_VALUE)
    if 2 * np.count_nonzero(coloured) < coloured.size:
        return None
    # On a circle: the mean direction, and how far hues lie about it.
    turns = np.exp(2j * np.pi * hue[coloured] / CIRCLE_DEG)
    middle = turns.mean()
    away_deg = np.degrees(np.angle(turns / middle))
    half_deg = float(np.clip(SPREADS * away_deg.std(), NARROWEST_DEG, WIDEST_DEG))
    at_deg = float(np.degrees(np.angle(middle)))
    return Colour(
        Hues(*(round(deg % CIRCLE_DEG) % 360 for deg in (at_deg - half_deg, at_deg + half_deg))),
        least_saturation=_floor(SATURATION_SHARE * float(np.median(saturation[coloured]))),
        least_value=_floor(VALUE_SHARE * float(np.median(value[coloured]))),
    )


def _floor(share: float) -> float:
    return int(100 * share) / 100


def flag_of(colour: Colour) -> str:
    """What to give to commands: `--detector colour:350-10 --detector.least-saturation 0.4`."""
    flags = [f"--detector colour:{colour.hues}"]
    for field in fields(colour)[1:]:
        value = getattr(colour, field.name)
        if value != field.default:
            said = value if isinstance(value, str) else f"{value:g}"
            flags.append(f"--detector.{field.name.replace('_', '-')} {said}")
    return " ".join(flags)


@dataclass(frozen=True, eq=False)
class Found:
    """What a colour finds in a frame.

    Args:
        things: the largest first.
        mask: (H, W) their pixels.
        focal_px: of the camera.
    """

    things: tuple[Obstacle, ...]
    mask: Bool
    focal_px: float

    @property
    def lines(self) -> tuple[str, ...]:
        """Each in words."""
        return tuple(
            f"{number}: {_said(thing, self.focal_px)}"
            for number, thing in enumerate(self.things, start=1)
        )


def found_by(colour: Colour, sight: Sight) -> Found:
    """The things of a colour, measured.

    Raises:
        ImageFormat: the picture is grey.
    """
    detections = colour.load()(sight)
    mask = np.zeros(sight.image.shape[:2], np.bool_)
    for detection in detections:
        if detection.mask is not None:
            mask |= detection.mask
    return Found(measured(sight, detections), mask, sight.camera.focal_px)


def _said(thing: Obstacle, focal_px: float) -> str:
    left, _, right, _ = thing.detection.box_px
    size = f"{right - left:.1f} px wide"
    if thing.measured_by == "size":
        return f"{size}; nothing in it was matched: it is not measured"
    # Between the edges of the colour, at its distance: what the fitted box has behind them is none
    # of it.
    far_m, sigma_m = thing.distance_m, thing.sigma_distance_m
    wide_m = (right - left) / focal_px * far_m
    of_edges_m = EDGE_PX * 2**0.5 * far_m / focal_px
    sigma_wide_m = math.hypot(wide_m * sigma_m / far_m, of_edges_m)
    return (
        f"**{wide_m:.2f} ± {sigma_wide_m:.2f} m wide, {far_m:.2f} ± {sigma_m:.2f} m away**, {size}"
    )


def marked(photo: UInt8, mask: Bool) -> UInt8:
    """(H, W, 3) the photo, dark where nothing was found, what was found outlined."""
    import cv2

    drawn = rgb_of(photo).copy()
    drawn[~mask] = (drawn[~mask] * DARKER).astype(np.uint8)
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(cv2.drawContours(drawn, contours, -1, OUTLINE, 2), np.uint8)
