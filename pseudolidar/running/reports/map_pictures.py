"""A map in pictures: from above with the path, and in perspective along it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.evaluation.cloud_views import Eye, from_above, perspective
from pseudolidar.evaluation.page import Picture, PictureRow, Section
from pseudolidar.running.mapped.trajectory_files import body_poses_of
from pseudolidar.running.mapped.walked import Piece
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.cloud import PointCloud

# Points of a map are drawn as large as this, m.
POINT_M = 0.06
# Rows of pixels meet a road so far apart at most where a map has it, m: from above, gaps between
# them would hide what is there.
GAP_M = 0.2
# The eye is so far behind and above a place on the path, and looks so far ahead of it, m.
BEHIND_M, ABOVE_M, AHEAD_M = 1.0, 2.5, 14.0
# Places on the path that are looked from, as shares of its frames.
PLACES = (0.0, 0.5)


def map_sections(
    whole: PointCloud | None, pieces: Sequence[Piece], rig: StereoRig
) -> list[Section]:
    """The map from above, and two views along the path; none where there is no map.

    Args:
        whole: the map.
        pieces: of path, the longest first.
        rig: places the camera on the body.
    """
    if whole is None:
        return []
    path = body_poses_of(pieces[0], rig)
    above, per_px = from_above(whole, point_m=POINT_M, gap_m=GAP_M, way=path[:, :2, 3])
    told = f"from above, {1 / per_px:.1f} px a metre; orange: the way, from the dot on"
    rows = [PictureRow((Picture.photo(above, told),))]
    views = tuple(
        Picture.photo(perspective(whole, eye_at(path, share), point_m=POINT_M), caption)
        for share, caption in zip(PLACES, ("along the path", "farther along"), strict=True)
    )
    return [Section("The map", pictures=[*rows, PictureRow(views)])]


def eye_at(T_map_base: Float64, share: float) -> Eye:
    """An eye behind and above a place on a path, that looks along it."""
    T = T_map_base[int(share * (len(T_map_base) - 1))]
    ahead = T[:3, 0] * (1, 1, 0)
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    at = T[:3, 3] - BEHIND_M * ahead + (0, 0, ABOVE_M)
    towards = T[:3, 3] + AHEAD_M * ahead
    x, y, z = (float(value) for value in at)
    to_x, to_y, to_z = (float(value) for value in towards)
    return Eye((x, y, z), (to_x, to_y, to_z))
