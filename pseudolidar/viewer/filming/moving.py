"""The film of a sequence: its frames at their pace, the eye behind the rig."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pseudolidar.evaluation.cloud_views import Eye
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.filming.flights import RATE_HZ, Chase, behind, between
from pseudolidar.viewer.filming.painted import Painter, joined
from pseudolidar.viewer.filming.shot import Shot
from pseudolidar.viewer.moment import STEREO, Moment
from pseudolidar.viewer.reel import Reel
from pseudolidar.viewer.stage import Look
from pseudolidar.viewer.stills import Still
from pseudolidar.viewer.timeline import LONGEST_WAIT_S

# Side of a point of a frame, m.
POINT_M = 0.05
FORWARD = np.array([1.0, 0.0, 0.0])


def moving_shots(
    reel: Reel, stills: Sequence[Still], looks: Mapping[str, Look], size_px: tuple[int, int]
) -> Iterator[Shot]:
    """Each frame as long as it lasts, where it is in the map, and what lies still.

    Args:
        reel: the frames.
        stills: drawn with each of them.
        looks: how clouds look, by name.
        size_px: of the pictures.
    """
    wanted, following, chase = pictures_of(reel), reel.load(0), Chase()
    origin = np.zeros(3) if following.T_map_forward is None else following.T_map_forward[:3, 3]
    painter = Painter(looks, origin)
    still = joined([painter.still(one) for one in stills if painter.visible(one.name)])
    for index, pictures in enumerate(wanted):
        moment, following = following, reel.load(min(index + 1, len(wanted) - 1))
        cloud = joined([*_painted(moment, painter), still])
        eyes = [_eye_behind(one, origin, size_px) for one in (moment, following)]
        for number in range(pictures):
            target = between(eyes[0], eyes[1], number / pictures)
            yield Shot(cloud, chase.follow(target, 1 / RATE_HZ), POINT_M)


def pictures_of(reel: Reel) -> list[int]:
    """How many pictures each frame is shown for, by the times of the frames; at least one."""
    steps = np.clip(np.diff(np.asarray(reel.times_s, np.float64)), 0, LONGEST_WAIT_S)
    last = steps[-1] if len(steps) else LONGEST_WAIT_S
    ends = np.rint(np.cumsum([*steps, last]) * RATE_HZ).astype(int)
    return [max(int(count), 1) for count in np.diff([0, *ends])]


def _eye_behind(moment: Moment, origin: Float64, size_px: tuple[int, int]) -> Eye:
    T = moment.T_map_forward
    eye = behind(-origin, FORWARD) if T is None else behind(T[:3, 3] - origin, T[:3, 0])
    return replace(eye, width_px=size_px[0], height_px=size_px[1])


def _painted(moment: Moment, painter: Painter) -> list[PointCloud]:
    """The clouds of a frame: what cameras saw, or else whatever there is."""
    names: Sequence[str] = (STEREO,) if STEREO in moment.clouds else tuple(moment.clouds)
    return [
        painter.cloud(name, moment.clouds[name], moment.T_map_forward)
        for name in names
        if painter.visible(name)
    ]
