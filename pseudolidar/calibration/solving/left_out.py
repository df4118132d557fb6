"""Views and corners that disagree with the others, and why they are left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.calibration.solving.bundle import Fit
from pseudolidar.calibration.solving.observations import Observations
from pseudolidar.calibration.solving.robust import spread, view_spread
from pseudolidar.structures.arrays import Bool, Float64

# A view is left out where it is off this many times as much as is usual, and by this much, px.
VIEW_RATIO, LEAST_OFF_PX = 3.0, 0.3
# A corner is where it is off this many standard deviations of its view.
CORNER_SIGMAS, LEAST_CORNER_PX = 6.0, 0.5
# No more views than this share are left out: then it is not they who are wrong.
MOST_LEFT_OUT = 0.4


@dataclass(frozen=True)
class LeftOut:
    """A view that is not used.

    Args:
        id: its name.
        reason: why.
        off_px: by how much it disagrees, where it was measured.
    """

    id: str
    reason: str
    off_px: float | None = None

    def as_dict(self) -> dict[str, str | float | None]:
        """For `--json`."""
        return {"id": self.id, "reason": self.reason, "off_px": self.off_px}


def bad_views(off_px: Float64) -> Bool:
    """(V,) views that are off much more than is usual, those that are off most first."""
    limit = max(VIEW_RATIO * float(np.median(off_px)), LEAST_OFF_PX)
    bad = off_px > limit
    most = int(MOST_LEFT_OUT * len(off_px))
    if bad.sum() > most:
        bad &= off_px >= np.sort(off_px)[len(off_px) - max(most, 1)]
    return np.asarray(bad)


def bad_corners(fit: Fit, seen: Observations) -> Bool:
    """(V, E, N) corners that are off where their view is not."""
    off = np.linalg.norm(fit.residuals, axis=-1)
    usual = np.maximum(view_spread(fit.residuals, seen.seen), spread(fit.residuals, seen.seen))
    limit = np.maximum(CORNER_SIGMAS * usual, LEAST_CORNER_PX)
    return np.asarray(seen.seen & (off > limit[:, None, None]))
