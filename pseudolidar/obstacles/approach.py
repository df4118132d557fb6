"""How fast the nearest thing of a corridor comes nearer, by its last frames."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.obstacles.corridor import Ahead

# An approach is told of so many of the last frames.
FRAMES, LEAST_FRAMES = 6, 3
# A nearest thing that jumps by more sigmas than this is another one.
SAME_SIGMAS = 4.0


@dataclass(frozen=True)
class Approach:
    """How fast the nearest thing comes nearer.

    Args:
        closing_m_s: above 0 where it comes nearer.
        sigma_m_s: one standard deviation.
        contact_s: until it is reached, as fast as now; None where it does not come nearer.
        sigma_contact_s: one standard deviation of that.
    """

    closing_m_s: float
    sigma_m_s: float
    contact_s: float | None
    sigma_contact_s: float | None


class Nearing:
    """How fast the nearest thing of a corridor comes nearer, while frames come in their order."""

    def __init__(self) -> None:
        self._last = deque[tuple[float, Ahead | None]](maxlen=FRAMES)

    def __call__(self, time_s: float, ahead: Ahead | None) -> Approach | None:
        """Its approach at the next frame; None where it is a new one.

        Args:
            time_s: of the frame.
            ahead: the nearest thing in it; None where nothing is seen.
        """
        self._last.append((time_s, ahead))
        return approach(*zip(*self._last, strict=True))


def approach(times_s: Sequence[float], seen: Sequence[Ahead | None]) -> Approach | None:
    """The approach of the nearest thing over the last frames; None where it is a new one.

    A straight line through its last distances. What the rig's calibration leaves is the same in
    all of them and does not count.

    Args:
        times_s: of the frames up to now.
        seen: the nearest thing of each.
    """
    chosen: list[tuple[float, Ahead]] = []
    for time_s, one in zip(reversed(times_s[-FRAMES:]), reversed(seen[-FRAMES:]), strict=True):
        if one is None or (chosen and not _same(chosen[-1][1], one, chosen[-1][0] - time_s)):
            break
        chosen.append((time_s, one))
    if len(chosen) < LEAST_FRAMES:
        return None
    t = np.array([time_s for time_s, _ in chosen])
    d = np.array([one.distance_m for _, one in chosen])
    weight = np.array([one.sigma_m**-2 for _, one in chosen])
    t = t - (weight * t).sum() / weight.sum()
    spread = float((weight * t * t).sum())
    if spread <= 0:
        return None
    closing = -float((weight * t * d).sum()) / spread
    sigma = spread**-0.5
    last = chosen[0][1]
    if closing <= sigma:
        return Approach(closing, sigma, None, None)
    contact_s = last.distance_m / closing
    relative = math.hypot(sigma / closing, last.sigma_m / last.distance_m)
    return Approach(closing, sigma, contact_s, contact_s * relative)


def _same(later: Ahead, earlier: Ahead, seconds: float) -> bool:
    """Whether both may be one thing: no jump beyond their errors and any likely speed."""
    reach_m = SAME_SIGMAS * math.hypot(later.sigma_m, earlier.sigma_m) + 40.0 * max(0.0, seconds)
    return abs(later.distance_m - earlier.distance_m) <= reach_m
