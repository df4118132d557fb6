"""From where to where a number can be tuned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pseudolidar.running.settings_schema import choice_name
from pseudolidar.running.tuning.space import numbers_of


@dataclass(frozen=True)
class Span:
    """The range of a number.

    Args:
        low: smallest value.
        high: largest.
        step: from one value to the next.
        start: where a number begins that was left to itself, or was no limit.
    """

    low: float
    high: float
    step: float
    start: float | None = None

    def holding(self, value: Any) -> Span:
        """The same, wide enough for a value that somebody chose elsewhere; None changes nothing."""
        if value is None:
            return self
        return Span(min(self.low, value), max(self.high, value), self.step, self.start)


# Numbers that `tune` does not try, and those whose end means something that it does not: none.
# What they mean is in the docstrings of the settings; ranges are what is of use on real scenes.
_SPANS = {
    "census.disparities": Span(32, 256, 32, start=128),
    "census.penalty_small": Span(1, 40, 1, start=12),
    "census.penalty_large": Span(20, 95, 1),
    "census.agreement_px": Span(0, 5, 0.05, start=1),
    "census.speckle_pixels": Span(0, 1000, 10),
    "sgbm.disparities": Span(16, 256, 16, start=128),
    "sgbm.block_size": Span(1, 21, 2),
    "sgbm.p1": Span(1, 2000, 1, start=200),
    "sgbm.p2": Span(2, 8000, 1, start=800),
    "sgbm.agreement_px": Span(-1, 10, 1),
    "sgbm.speckle_pixels": Span(0, 1000, 10),
    "bm.disparities": Span(16, 256, 16, start=128),
    "bm.block_size": Span(5, 51, 2),
    "bm.texture": Span(0, 200, 1),
    "bm.agreement_px": Span(-1, 10, 1),
    "bm.speckle_pixels": Span(0, 1000, 10),
    "onnx.agreement_px": Span(0.1, 5, 0.1),
    "onnx.iterations": Span(1, 64, 1),
    "onnx.max_disparity": Span(16, 512, 16, start=192),
    "onnx.sigma_scale": Span(0.1, 10, 0.1),
    "clean.angle_deg": Span(0.5, 45, 0.5),
    "clean.gap_sigmas": Span(0.5, 10, 0.1),
    "clean.edge_error": Span(0.05, 2, 0.05),
    "clean.far_error": Span(0.1, 5, 0.1),
    "clean.speckle_m2": Span(0.005, 0.5, 0.005),
    "clean.neighbours": Span(1, 24, 1),
    "kalman.window": Span(2, 16, 1),
    "kalman.gate": Span(0.5, 10, 0.1),
    "fgs.strength": Span(100, 60_000, 100),
    "surfaces.max_depth_m": Span(5, 200, 1),
    "reproject.min_range_m": Span(0, 20, 0.5),
    "reproject.max_range_m": Span(5, 200, 1),
    "reproject.min_height_m": Span(-10, 2, 0.1, start=-2),
    "reproject.max_height_m": Span(-2, 20, 0.1, start=2),
    "reproject.max_sigma_m": Span(0.05, 5, 0.05, start=1),
    "reproject.max_sigma_rel": Span(0.01, 0.5, 0.01, start=0.1),
    "reproject.voxel_m": Span(0.02, 1, 0.02, start=0.1),
    "lonely.neighbours": Span(1, 20, 1),
    "lonely.radius_rel": Span(0.002, 0.1, 0.001),
    "lonely.min_radius_m": Span(0.01, 1, 0.01),
    "lonely.sigmas": Span(0, 5, 0.1),
    "colour.least_saturation": Span(0, 1, 0.01),
    "colour.least_value": Span(0, 1, 0.01),
    "colour.most": Span(1, 20, 1),
    "colour.least_pixels": Span(1, 2000, 1),
    "colour.opening": Span(1, 31, 1),
    "colour.closing": Span(1, 31, 1),
}


def span_of(kind: type, name: str) -> Span | None:
    """The range of a number of some settings; None where it is not tuned.

    Args:
        kind: class of the settings.
        name: of the field.
    """
    own = _SPANS.get(f"{choice_name(kind)}.{name}")
    if own is not None:
        return own
    tried = numbers_of(kind).get(name)
    return None if tried is None else Span(tried.low, tried.high, tried.step)
