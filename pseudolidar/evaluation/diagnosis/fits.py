"""Sets of causes fitted to the blocks of one rig, and what they are worth outside the fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.evaluation.diagnosis.blocks import ErrorBlocks
from pseudolidar.evaluation.diagnosis.causes import CAUSES, Cause, Seen
from pseudolidar.evaluation.diagnosis.effects import JointEffect
from pseudolidar.geometry.robust import robust_sigma
from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.camera import StereoRig

# The blocks of one frame (or of so many parts of them) are left out at a time.
FOLDS = 6
# Residuals beyond so many sigmas weigh less (Huber), in so many turns.
HUBER, TURNS = 2.0, 8
# Such patterns are alike within parts of the image and of the disparities, so many of each; they
# bound how well any size can be known.
PATTERN_PX, PATTERN_COLUMNS, PATTERN_BANDS = 0.05, 4, 4
# Causes whose errors over the blocks seen point in directions with this cosine look the same.
TWIN_COSINE = 0.97


@dataclass(frozen=True)
class FoundCause:
    """A cause with its size.

    Args:
        cause: which.
        size: signed, in its unit.
        sigma: one standard deviation of it: over frames, and by patterns of 0.05 px that matchers
            make.
        twins: names of causes that look nearly the same where there are points.
    """

    cause: Cause
    size: float
    sigma: float
    twins: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """In words with its number, such as `right camera turned outwards by 0.10 +- 0.01 deg`."""
        words = self.cause.words[0 if self.size >= 0 else 1]
        return words.format(size=f"{abs(self.size):.2g} +- {self.sigma:.1g} {self.cause.unit}")

    def as_dict(self) -> dict[str, Any]:
        """The fields, by the cause's name."""
        return {
            "cause": self.cause.name,
            "size": self.size,
            "sigma": self.sigma,
            "unit": self.cause.unit,
            "twins": list(self.twins),
            "text": self.text,
        }


@dataclass(frozen=True)
class Explanation:
    """Causes that together explain the error.

    Args:
        causes: the fewest that do; empty where the rig is healthy.
        loss: mean loss on frames outside the fit; smaller is better.
        explained: share of the systematic error that they explain, 0-1.
        effect: what they make of the disparities, alone and together.
    """

    causes: tuple[FoundCause, ...]
    loss: float
    explained: float
    effect: JointEffect

    @property
    def names(self) -> tuple[str, ...]:
        """Of the causes."""
        return tuple(found.cause.name for found in self.causes)

    def as_dict(self) -> dict[str, Any]:
        """The fields."""
        return {
            "causes": [found.as_dict() for found in self.causes],
            "loss": self.loss,
            "explained": self.explained,
            "effect": self.effect.as_dict(),
        }


class CauseFits:
    """Robust fits of sets of causes to the blocks of one rig."""

    def __init__(self, blocks: ErrorBlocks, rig: StereoRig) -> None:
        self.blocks, seen = blocks, Seen.of(blocks, rig)
        self.from_middle = np.abs(blocks.u / rig.left.width_px - 0.5)
        self.patterns = np.stack([cause.pattern(seen) for cause in CAUSES], axis=1)
        frames = np.unique(blocks.frame)
        part = blocks.frame
        if len(frames) == 1:
            part = (blocks.u * FOLDS / rig.left.width_px).astype(np.int64)
        self.part = np.unique(part, return_inverse=True)[1]
        if len(frames) > 1:
            self.part = self.part % max(2, min(FOLDS, len(frames)))

    def sizes(self, chosen: tuple[int, ...], inside: Int64 | None = None) -> Float64:
        """(n,) most likely sizes of the causes, fitted to the blocks `inside` (all by default)."""
        rows = np.arange(len(self.blocks)) if inside is None else inside
        error = self.blocks.error_px[rows] / self.blocks.sigma_px[rows]
        patterns = self.patterns[rows][:, chosen] / self.blocks.sigma_px[rows, None]
        sizes: Float64 = np.zeros(len(chosen))
        scale = 1.0
        for _ in range(TURNS if chosen else 0):
            off = np.abs(error - patterns @ sizes) / scale
            root = np.sqrt(np.minimum(1.0, HUBER / np.maximum(off, HUBER)))
            found = np.linalg.lstsq(patterns * root[:, None], error * root, rcond=None)[0]
            sizes = found.astype(np.float64)
            scale = max(1.0, robust_sigma(error - patterns @ sizes))
        return sizes

    def predicted(self, chosen: tuple[int, ...]) -> Float64:
        """(N,) error of the blocks that the causes explain, px."""
        return np.asarray(self.patterns[:, chosen] @ self.sizes(chosen))

    def held_out(self, chosen: tuple[int, ...]) -> Float64:
        """(folds,) mean weighted absolute error of each part, causes fitted to the others."""
        losses = []
        for turn in np.unique(self.part):
            held = self.part == turn
            sizes = self.sizes(chosen, np.flatnonzero(~held))
            left = self.blocks.error_px[held] - self.patterns[held][:, chosen] @ sizes
            weight = 1.0 / self.blocks.sigma_px[held]
            losses.append(float((np.abs(left) * weight).sum() / weight.sum()))
        return np.array(losses)

    def explanation(
        self, chosen: tuple[int, ...], losses: dict[tuple[int, ...], Float64]
    ) -> Explanation:
        """The causes with their sizes, standard deviations by jackknife over parts."""
        sizes = self.sizes(chosen)
        parts = np.unique(self.part)
        without = np.array(
            [self.sizes(chosen, np.flatnonzero(self.part != part)) for part in parts]
        )
        n = len(parts)
        over_frames = (n - 1) / n * ((without - without.mean(axis=0)) ** 2).sum(axis=0)
        sigma = np.sqrt(over_frames + self._by_patterns(chosen) ** 2)
        nothing = float(losses[()].mean())
        loss = float(losses[chosen].mean())
        return Explanation(
            tuple(
                FoundCause(CAUSES[i], float(size), float(s), self._twins(i, chosen))
                for i, size, s in zip(chosen, sizes, sigma, strict=True)
            ),
            loss,
            max(0.0, 1.0 - loss / nothing) if nothing > 0 else 0.0,
            self.effect(chosen),
        )

    def effect(self, chosen: tuple[int, ...]) -> JointEffect:
        """What the causes make of the blocks, alone and together."""
        return JointEffect.of(self.patterns[:, chosen] * self.sizes(chosen), self.from_middle)

    def _by_patterns(self, chosen: tuple[int, ...]) -> Float64:
        """(n,) standard deviation that errors of `PATTERN_PX` cause, alike within coarse parts."""
        if not chosen:
            return np.zeros(0)
        weighted = self.patterns[:, chosen] / self.blocks.sigma_px[:, None]
        influence = np.linalg.pinv(weighted) / self.blocks.sigma_px
        order = [np.argsort(np.argsort(a)) for a in (self.blocks.u, self.blocks.reference_px)]
        across, deep = (
            (rank * parts // len(rank))
            for rank, parts in zip(order, (PATTERN_COLUMNS, PATTERN_BANDS), strict=True)
        )
        part = across * PATTERN_BANDS + deep
        sums = [[row[part == p].sum() for p in np.unique(part)] for row in influence]
        return np.asarray(PATTERN_PX * np.linalg.norm(sums, axis=1), np.float64)

    def _twins(self, cause: int, chosen: tuple[int, ...]) -> tuple[str, ...]:
        """Names of causes outside of `chosen` whose pattern looks like that of `cause`."""
        weighted = self.patterns / self.blocks.sigma_px[:, None]
        length = np.maximum(np.linalg.norm(weighted, axis=0), 1e-12)
        cosine = np.abs(weighted.T @ weighted[:, cause]) / (length * length[cause])
        return tuple(
            CAUSES[i].name for i in np.flatnonzero(cosine > TWIN_COSINE) if i not in chosen
        )
