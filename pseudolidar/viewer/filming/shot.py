"""One picture of a film, and how it is drawn."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.evaluation.cloud_views import Eye, perspective
from pseudolidar.structures.arrays import UInt8
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.filming.outlined import NO_OUTLINES, Outlines

# Drawn so many times as large and made smaller: edges of points do not flicker.
FINER = 2
# No point is larger in the film, px.
LARGEST_PX = 9


@dataclass(frozen=True, eq=False)
class Shot:
    """One picture before it is drawn.

    Args:
        cloud: everything in it, with colours.
        eye: from where.
        point_m: side of a point.
        outlines: drawn over the points.
    """

    cloud: PointCloud
    eye: Eye
    point_m: float
    outlines: Outlines = NO_OUTLINES

    def drawn(self) -> UInt8:
        """(H, W, 3) RGB."""
        import cv2

        eye, largest_px = self.eye, FINER * LARGEST_PX
        fine = replace(eye, width_px=FINER * eye.width_px, height_px=FINER * eye.height_px)
        picture = perspective(self.cloud, fine, point_m=self.point_m, largest_px=largest_px)
        size = eye.width_px, eye.height_px
        drawn = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
        self.outlines.draw(drawn, eye)
        return drawn
