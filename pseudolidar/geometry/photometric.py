"""How differently two eyes turn light into grey levels: gain, colour, gamma, vignetting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.robust import robust_sigma
from pseudolidar.structures.arrays import Bool, Float32, Float64, Image

# Levels nearer to either end of the range are clipped, or mostly noise; share of the range.
CLIPPED = 0.02
# Points are chosen by what the left eye saw, so that the right eye should see no more than this:
# chosen by what it saw, the brightest of noise would be missing, and a gain of 1.4 be 1.33.
BRIGHTEST, DARKEST = 0.88, 0.04
# Pixels that a difference is fitted to: more tell nothing new.
MOST_POINTS, LEAST_POINTS = 1_500, 40
# How often weights are found anew; a pixel's logarithm is never surer than this.
ROUNDS, LEAST_NOISE = 6, 0.01
# Where an eye is clipped is known to so much.
CERTAINLY = 0.97
# Where the pictures hold one brightness only, gamma and vignetting are taken for none: this is how
# much they are expected to differ (one standard deviation), against `NOISE` of a pixel's logarithm.
EXPECTED, NOISE = 0.3, 0.05
PRIOR = (NOISE / EXPECTED) ** 2
# Brightnesses, as shares of the range, and squared radii by which a difference is judged.
JUDGED_LEVELS, JUDGED_RADII = (0.15, 0.35, 0.55, 0.75), (0.0, 0.5)


@dataclass(frozen=True)
class PhotometricDifference:
    """The right eye's value of what the left eye sees: r = gain l^gamma exp(vignetting rho^2).

    Args:
        gain: of each channel, at white.
        gamma: exponent, the same for all channels; 1 where the eyes have one curve.
        vignetting: logarithm of the light that the right eye gains towards a corner against the
            left one; negative where its corners are darker.

    Values are shares of the range, 0 to 1; rho is 0 in the middle and 1 in a corner.
    """

    gain: tuple[float, ...]
    gamma: float
    vignetting: float

    def seen(self, level: float, radius2: float = 0.0) -> Float64:
        """(C,) the right eye's value of a left one."""
        value = level**self.gamma * float(np.exp(self.vignetting * radius2))
        return np.asarray(np.array(self.gain) * value, np.float64)

    def seen_at(self, levels: Float64, radius2: Float64) -> Float64:
        """(N, C) the right eye's values of left ones (N, C) at squared radii (N,)."""
        falloff = np.exp(self.vignetting * radius2)[:, None]
        return np.asarray(np.array(self.gain) * levels**self.gamma * falloff)

    @property
    def largest(self) -> float:
        """Largest difference at usual brightnesses, as a share of the range."""
        return max(
            float(np.abs(np.minimum(self.seen(level, radius2), 1.0) - level).max())
            for level in JUDGED_LEVELS
            for radius2 in JUDGED_RADII
        )

    def undone(self, right: Image) -> Image:
        """The right picture as the left eye would have taken it, of the same kind.

        What was clipped stays clipped; levels that the right eye could not tell apart stay one.
        """
        white = np.iinfo(right.dtype).max
        levels = np.arange(white + 1, dtype=np.float64) / white
        channels = np.atleast_3d(right)
        out = np.empty(channels.shape, right.dtype)
        inverse = 1.0 / self.gamma
        falloff = np.exp(-self.vignetting * inverse * radius2_of(right.shape[:2]))
        for channel, gain in enumerate(self.gain):
            table = (white * (levels / gain) ** inverse).astype(np.float32)
            values = table[channels[:, :, channel]] * falloff
            np.rint(values, out=values)
            out[:, :, channel] = np.minimum(values, white)
        return out.reshape(right.shape)

    def clipped_alike(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Both pictures without what either eye is too bright for: it has no texture in both."""
        white = np.iinfo(right.dtype).max
        falloff = np.exp(self.vignetting * radius2_of(right.shape[:2]))
        alike = [np.array(np.atleast_3d(eye)) for eye in (left, right)]
        for channel, gain in enumerate(self.gain):
            seen = gain * falloff
            tops = (CERTAINLY / seen) ** (1.0 / self.gamma), CERTAINLY * seen
            for eye, top in zip(alike, tops, strict=True):
                most = (np.minimum(top, 1.0) * white).astype(eye.dtype)
                np.minimum(eye[:, :, channel], most, out=eye[:, :, channel])
        return alike[0].reshape(left.shape), alike[1].reshape(right.shape)


def radius2_of(shape: tuple[int, ...]) -> Float32:
    """(H, W) float32 squared distance from the middle of a picture, 1 in its corners."""
    height, width = shape
    y = np.linspace(-1.0, 1.0, height, dtype=np.float32)[:, None] * np.float32(height)
    x = np.linspace(-1.0, 1.0, width, dtype=np.float32)[None, :] * np.float32(width)
    return np.asarray((x * x + y * y) / np.float32(height * height + width * width))


def fit_difference(left: Float64, right: Float64, radius2: Float64) -> PhotometricDifference | None:
    """Fit the difference to what both eyes see of the same points.

    Robust: a tenth or more of the points may be matched wrongly. In the logarithm the model is
    linear; as both eyes are noisy, it is fitted both ways and gamma is the mean of both.

    Args:
        left: (N, C) shares of the range, 0 to 1.
        right: (N, C) likewise.
        radius2: (N,) squared distance from the middle of the right picture, 1 in a corner.

    Returns:
        None where fewer than 40 points are neither clipped nor dark.
    """
    clear = np.all((np.minimum(left, right) > CLIPPED) & (np.maximum(left, right) < 1 - CLIPPED), 1)
    if int(clear.sum()) < LEAST_POINTS:
        return None
    first = _fitted(left, right, radius2, clear)
    expected = first.seen_at(left, radius2)
    inside = np.all((expected > DARKEST) & (expected < BRIGHTEST) & (left > DARKEST), axis=1)
    inside &= np.all((left < 1 - CLIPPED) & (right > 0), axis=1)
    if int(inside.sum()) < LEAST_POINTS:
        return first
    return _fitted(left, right, radius2, inside)


def _fitted(left: Float64, right: Float64, radius2: Float64, points: Bool) -> PhotometricDifference:
    chosen = np.flatnonzero(points)
    chosen = chosen[:: max(1, len(chosen) // MOST_POINTS)]
    x, y, rho2 = np.log(left[chosen]), np.log(right[chosen]), radius2[chosen]
    gamma, _ = _slopes(x, y, rho2)
    backwards, _ = _slopes(y, x, rho2)
    gamma = float(np.sqrt(gamma / backwards)) if min(gamma, backwards) > 0 else 1.0
    gains, vignetting = _levels(y - gamma * x, rho2)
    return PhotometricDifference(tuple(float(g) for g in np.exp(gains)), gamma, vignetting)


def _slopes(x: Float64, y: Float64, rho2: Float64) -> tuple[float, float]:
    """Slope and vignetting of y = a_c + slope x + vignetting rho^2, robustly."""
    n, channels = x.shape
    vignetting = np.repeat(rho2[:, None], channels, axis=1)
    weights = np.ones((n, channels))
    slope, bend = 1.0, 0.0
    for _ in range(ROUNDS):
        total = weights.sum(0)
        centred = [each - (weights * each).sum(0) / total for each in (x, vignetting, y)]
        a, b, c = centred
        c = c - a  # the slope's difference from 1 is what the prior is about
        normal = np.array(
            [
                [(weights * a * a).sum() + PRIOR, (weights * a * b).sum()],
                [(weights * a * b).sum(), (weights * b * b).sum() + PRIOR],
            ]
        )
        right = np.array([(weights * a * c).sum(), (weights * b * c).sum()])
        more, bend = (float(value) for value in np.linalg.solve(normal, right))
        slope = 1.0 + more
        weights = _weights(c - more * a - bend * b)
    return slope, bend


def _levels(rest: Float64, rho2: Float64) -> tuple[Float64, float]:
    """(C,) level of each channel and the common vignetting of rest = a_c + vignetting rho^2."""
    weights = np.ones_like(rest)
    levels, bend = np.median(rest, axis=0), 0.0
    for _ in range(ROUNDS):
        total = weights.sum(0)
        b = rho2[:, None] - (weights * rho2[:, None]).sum(0) / total
        c = rest - (weights * rest).sum(0) / total
        bend = float((weights * b * c).sum() / ((weights * b * b).sum() + PRIOR))
        levels = (weights * (rest - bend * rho2[:, None])).sum(0) / total
        weights = _weights(rest - levels - bend * rho2[:, None])
    return np.asarray(levels, np.float64), bend


def _weights(residuals: Float64) -> Float64:
    """Cauchy weights, with the width that the residuals themselves have."""
    sigma = max(LEAST_NOISE, robust_sigma(residuals))
    return np.asarray(1.0 / (1.0 + (residuals / sigma) ** 2))
