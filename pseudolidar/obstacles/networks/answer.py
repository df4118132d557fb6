"""What a network answers to one picture, and the objects that are read from it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pseudolidar.errors import ModelOutput
from pseudolidar.structures.arrays import AnyArray, Float32, Float64, Int64
from pseudolidar.structures.image_size import ImageSize

# Scores of 16-bit networks end a little beyond 1.
_SCORE_SLACK = 1e-2


@dataclass(frozen=True, eq=False)
class Answer:
    """The outputs for one picture.

    Args:
        outputs: by name, in the file's order; the first axis is the batch, of length 1, where the
            network has one.
        size: of the network's input.
    """

    outputs: dict[str, AnyArray]
    size: ImageSize

    @property
    def arrays(self) -> list[AnyArray]:
        """The outputs alone."""
        return list(self.outputs.values())

    def named(self, *parts: str) -> AnyArray | None:
        """The first output whose name contains one of the parts, in their order."""
        for part in parts:
            for name, array in self.outputs.items():
                if part in name.lower():
                    return array
        return None

    def __str__(self) -> str:
        """Shapes and ranges for people."""
        return "; ".join(f"{name} {_told(array)}" for name, array in self.outputs.items())


@dataclass(frozen=True, eq=False)
class Candidates:
    """Objects as a network has them.

    Args:
        boxes: (N, 4) float64 left, top, right, bottom in network coordinates.
        scores: (N,) float64 0-1.
        labels: (N,) int64.
        masks: of each: (N, h, w) logits or probabilities, or None.
    """

    boxes: Float64
    scores: Float64
    labels: Int64
    masks: CandidateMasks | None = None

    def take(self, chosen: Int64) -> Candidates:
        """Those of these positions, in this order."""
        masks = None if self.masks is None else self.masks.take(chosen)
        return Candidates(self.boxes[chosen], self.scores[chosen], self.labels[chosen], masks)


@dataclass(frozen=True, eq=False)
class CandidateMasks:
    """Masks of candidates, small, as the network has them.

    Args:
        values: (N, h, w) float32, or, with `prototypes`, (N, K) coefficients of them.
        level: above it a pixel is of the object.
        in_box: a mask covers its box; otherwise the whole input.
        prototypes: (K, h, w) float32 or None.
    """

    values: Float32
    level: float
    in_box: bool = False
    prototypes: Float32 | None = field(default=None)

    def take(self, chosen: Int64) -> CandidateMasks:
        """Those of these positions."""
        return CandidateMasks(self.values[chosen], self.level, self.in_box, self.prototypes)

    def plane(self, index: int) -> Float32:
        """(h, w) of one candidate."""
        if self.prototypes is None:
            return np.asarray(self.values[index], np.float32)
        return np.asarray(np.tensordot(self.values[index], self.prototypes, 1), np.float32)


def kept(scores: AnyArray, threshold: float) -> Int64:
    """Positions of scores at or above the threshold.

    Args:
        scores: (N,) as the network has them.
        threshold: 0-1.

    Raises:
        ModelOutput: they are no scores: NaN, or not 0-1.
    """
    if scores.size and not np.isfinite(scores).all():
        share = float(np.mean(~np.isfinite(scores)))
        raise ModelOutput(
            f"{share:.0%} of the scores are NaN or infinite",
            want="scores of 0-1",
            fix="A 16-bit network may overflow: take a 32-bit export. Or leave the frame out.",
        )
    if scores.size and (scores.min() < -_SCORE_SLACK or scores.max() > 1 + _SCORE_SLACK):
        raise ModelOutput(
            f"scores from {float(scores.min()):.3g} to {float(scores.max()):.3g}",
            want="0-1",
            fix="Its layout is another one: pass --detector.layout.family.",
        )
    return np.flatnonzero(scores >= threshold).astype(np.int64)


def corners(centres: AnyArray) -> Float64:
    """(N, 4) left, top, right, bottom of centre x, y, width, height."""
    values = np.asarray(centres, np.float64)
    half = values[:, 2:] / 2
    return np.concatenate([values[:, :2] - half, values[:, :2] + half], axis=1)


def in_pixels(boxes: Float64, unit: str | None, size: ImageSize) -> Float64:
    """(N, 4) px of the network's input, of shares of it where they are that."""
    if unit != "share":
        return boxes
    return np.asarray(boxes * np.array([size.width, size.height] * 2), np.float64)


def _told(array: AnyArray) -> str:
    shape = f"{array.dtype}[{','.join(map(str, array.shape))}]"
    if not array.size or array.dtype.kind not in "fiu":
        return shape
    with np.errstate(invalid="ignore"):
        low, high = float(np.nanmin(array)), float(np.nanmax(array))
    return f"{shape} of {low:.3g} to {high:.3g}"
