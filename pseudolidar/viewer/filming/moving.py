"""The film of a sequence: its frames at their pace, the eye behind the rig."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pseudolidar.evaluation.cloud_views import Eye
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.filming.flights import RATE_HZ, Chase, behind, between, sized
from pseudolidar.viewer.filming.outlined import (
    NO_OUTLINES,
    FilmedObjects,
    Outlines,
    points_of,
)
from pseudolidar.viewer.filming.painted import Painter, joined, nothing_seen
from pseudolidar.viewer.filming.shot import Shot
from pseudolidar.viewer.moment import STEREO, Moment
from pseudolidar.viewer.reel import Reel
from pseudolidar.viewer.stage import Look
from pseudolidar.viewer.stills import Still
from pseudolidar.viewer.timeline import LONGEST_WAIT_S

# Side of a point of a frame, m.
POINT_M = 0.05
# The points of all objects of a frame, among clouds.
THINGS = "points of objects"
FORWARD = np.array([1.0, 0.0, 0.0])


def moving_shots(
    load: Callable[[int], Moment],
    wanted: Sequence[int],
    stills: Sequence[Still],
    looks: Mapping[str, Look],
    size_px: tuple[int, int],
    objects: FilmedObjects | None = None,
) -> Iterator[Shot]:
    """Each frame as long as it lasts, where it is in the map, and what lies still.

    Args:
        load: makes a frame, by its number.
        wanted: how many pictures each frame is shown for.
        stills: drawn with each of them.
        looks: how clouds look, by name.
        size_px: of the pictures.
        objects: of the frames; None for none.

    Raises:
        CloudEmpty: not one picture shows anything.
    """
    following, chase = load(0), Chase()
    shown = (one for one in map(load, range(1, len(wanted))) if not one.fault)
    first = next(shown, None) if following.fault else following
    if first is None:
        raise nothing_seen(following.fault)
    following = _placed(following, first)
    origin = np.zeros(3) if first.T_map_forward is None else first.T_map_forward[:3, 3]
    painter = Painter(looks, origin)
    still = joined([painter.still(one) for one in stills if painter.visible(one.name)])
    seen, fault = False, ""
    for index, pictures in enumerate(wanted):
        ahead = load(min(index + 1, len(wanted) - 1))
        moment, following = following, _placed(ahead, following)
        outlines, things = _outlined(moment, objects, painter)
        cloud = joined([*_painted(moment, painter), *things, still])
        seen, fault = seen or len(cloud) > 0, fault or moment.fault
        eyes = [_eye_behind(one, origin, size_px) for one in (moment, following)]
        for number in range(pictures):
            target = between(eyes[0], eyes[1], number / pictures)
            yield Shot(cloud, chase.follow(target, 1 / RATE_HZ), POINT_M, outlines)
    if not seen:
        raise nothing_seen(fault)


def _placed(moment: Moment, before: Moment) -> Moment:
    """A frame; one that cannot be shown is where the one before it is."""
    return replace(moment, T_map_forward=before.T_map_forward) if moment.fault else moment


def pictures_of(reel: Reel) -> list[int]:
    """How many pictures each frame is shown for, by the times of the frames; at least one."""
    steps = np.clip(np.diff(np.asarray(reel.times_s, np.float64)), 0, LONGEST_WAIT_S)
    last = steps[-1] if len(steps) else LONGEST_WAIT_S
    ends = np.rint(np.cumsum([*steps, last]) * RATE_HZ).astype(int)
    return [max(int(count), 1) for count in np.diff([0, *ends])]


def _eye_behind(moment: Moment, origin: Float64, size_px: tuple[int, int]) -> Eye:
    T = moment.T_map_forward
    eye = behind(-origin, FORWARD) if T is None else behind(T[:3, 3] - origin, T[:3, 0])
    return sized(eye, size_px)


def _painted(moment: Moment, painter: Painter) -> list[PointCloud]:
    """The clouds of a frame: what cameras saw, or else whatever there is."""
    names: Sequence[str] = (STEREO,) if STEREO in moment.clouds else tuple(moment.clouds)
    return [
        painter.cloud(name, moment.clouds[name], moment.T_map_forward)
        for name in names
        if painter.visible(name)
    ]


def _outlined(
    moment: Moment, objects: FilmedObjects | None, painter: Painter
) -> tuple[Outlines, list[PointCloud]]:
    """The objects of a frame: their lines, and their points where these are drawn too."""
    if objects is None:
        return NO_OUTLINES, []
    scene, T = objects.scenes(moment), moment.T_map_forward
    points = points_of(scene, objects.parts)
    things = [] if points is None else [painter.cloud(THINGS, points, T)]
    return Outlines.of(scene, objects.parts, painter.pose(T)), things
