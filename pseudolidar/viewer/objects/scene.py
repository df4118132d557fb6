"""All objects of a frame as they are drawn and told."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from pseudolidar.obstacles.approach import Approach
from pseudolidar.structures.arrays import Float32, Float64, UInt8
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.viewer.moment import Moment, Sight
from pseudolidar.viewer.objects.in_order import Told
from pseudolidar.viewer.objects.lines import cross, edges_of
from pseudolidar.viewer.objects.objects import WatchedCorridor
from pseudolidar.viewer.objects.shown import (
    TRUTH_COLOUR,
    Band,
    Colour,
    ShownObject,
    ShownTruth,
    colour_of,
)

# Of a corridor in which nothing is seen, and of one with a thing in it.
FREE_COLOUR: Colour = (70, 200, 110)
THING_COLOUR: Colour = (255, 90, 60)


@dataclass(frozen=True)
class Parts:
    """What of objects is drawn.

    Args:
        boxes: with their arrows.
        labels: words at so many of the nearest.
        points: in the colours of their boxes.
        truth: what the data set labels.
    """

    boxes: bool = True
    labels: int = 10
    points: bool = False
    truth: bool = True


@dataclass(frozen=True, eq=False)
class ShownWords:
    """What is written at a box.

    Args:
        text: lines of it.
        corners_m: (8, 3) of the box, in the frame of the clouds.
        colour: of the box.
    """

    text: str
    corners_m: Float64
    colour: Colour


@dataclass(frozen=True, eq=False)
class ShownCorridor:
    """A corridor.

    Args:
        corners_m: (8, 3), in the frame of the clouds.
        nearest_m: (3,) the nearest thing in it; None where nothing is seen.
        text: what is told of it.
    """

    corners_m: Float64
    nearest_m: Float64 | None
    text: str

    @property
    def colour(self) -> Colour:
        """Tells whether anything is in it."""
        return FREE_COLOUR if self.nearest_m is None else THING_COLOUR

    def lines(self) -> Float32:
        """(N, 2, 3) its edges, and a cross where the nearest thing is."""
        edges = edges_of([self.corners_m])
        return edges if self.nearest_m is None else np.concatenate([edges, cross(self.nearest_m)])


@dataclass(frozen=True, eq=False)
class ObjectScene:
    """What is drawn of a frame.

    Args:
        objects: the nearest first.
        truths: what the data set labels, the nearest first.
        corridor: where one is watched.
        xyz: (N, 3) points of the objects, in the frame of the clouds.
        colours: (N, 3) of their objects.
        chosen: key of the object that somebody chose.
        text: what is said of all.
        hindered: whether that is why nothing could be looked for.
    """

    objects: tuple[ShownObject, ...] = ()
    truths: tuple[ShownTruth, ...] = ()
    corridor: ShownCorridor | None = None
    xyz: Float32 = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    colours: UInt8 = field(default_factory=lambda: np.zeros((0, 3), np.uint8))
    chosen: str = ""
    text: str = ""
    hindered: bool = False

    @property
    def chosen_one(self) -> ShownObject | None:
        """The object that somebody chose, where it is in this frame."""
        return next((one for one in self.objects if one.key == self.chosen), None)

    def only(self, parts: Parts) -> ObjectScene:
        """What is left where parts of it are not drawn; `words` are of the whole scene."""
        nothing = ObjectScene()
        points = self if parts.points else nothing
        return replace(
            self,
            objects=self.objects if parts.boxes else (),
            truths=self.truths if parts.truth else (),
            xyz=points.xyz,
            colours=points.colours,
        )

    def words(self, parts: Parts) -> list[ShownWords]:
        """Words at all boxes that are drawn, the nearest first: of labels where nothing was found.

        Whoever writes them leaves out those without room, and writes `parts.labels` of the others.
        """
        drawn = self.only(parts)
        if self.objects:
            return [ShownWords(one.label, one.corners_m, one.colour) for one in drawn.objects]
        return [ShownWords(one.label, one.corners_m, TRUTH_COLOUR) for one in drawn.truths]


def shown_objects(told: Told, band: Band, T_forward_camera: Float64) -> tuple[ShownObject, ...]:
    """Those in a band, the nearest first."""
    every = [
        ShownObject.of(number, obstacle, T_forward_camera, of_round=told.round)
        for number, obstacle in enumerate(told.obstacles, start=1)
        if band.holds(obstacle)
    ]
    return tuple(sorted(every, key=lambda one: one.obstacle.distance_m))


def shown_truths(moment: Moment, sight: Sight) -> tuple[ShownTruth, ...]:
    """The labels of a frame, the nearest first."""
    frame = None if moment.converted is None else moment.converted.frame
    labels = frame.labels if isinstance(frame, StereoFrame) else None
    every = (ShownTruth.of(one, sight.camera, sight.T_forward_camera) for one in labels or ())
    found = [one for one in every if one is not None]
    return tuple(sorted(found, key=lambda one: float(one.corners_m[:, 0].min())))


def shown_points(told: Told, band: Band, T_forward_camera: Float64) -> tuple[Float32, UInt8]:
    """(N, 3) points of the objects in a band, and (N, 3) their colours."""
    objects = told.objects
    seen = told.obstacles[: len(objects.obstacles)]
    if not seen:
        return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8)
    kept = np.array([band.holds(one) for one in seen])[objects.numbers]
    palette = np.array([colour_of(one) for one in seen], np.uint8)
    xyz = objects.xyz[kept] @ T_forward_camera[:3, :3].T + T_forward_camera[:3, 3]
    return np.asarray(xyz, np.float32), palette[objects.numbers[kept]]


def shown_corridor(
    corridor: WatchedCorridor, approach: Approach | None, T_forward_camera: Float64
) -> ShownCorridor:
    """A corridor with the nearest thing in it, and when it is reached."""
    R, t = T_forward_camera[:3, :3], T_forward_camera[:3, 3]
    ahead, nearest = corridor.view.ahead, None
    if ahead is not None:
        # Axes of the corridor: where its corners differ in one of them alone.
        origin, along = corridor.corners_m[0], corridor.corners_m[1] - corridor.corners_m[0]
        up = corridor.corners_m[2] - origin
        axes = np.stack([corridor.corners_m[4] - origin, up, along])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        nearest = (
            ahead.across_m * axes[0] + ahead.up_m * axes[1] + ahead.distance_m * axes[2]
        ) @ R.T + t
    return ShownCorridor(corridor.corners_m @ R.T + t, nearest, corridor_text(corridor, approach))


def corridor_text(corridor: WatchedCorridor, approach: Approach | None) -> str:
    """The nearest thing in a corridor in words."""
    view = corridor.view
    if view.ahead is None:
        said = "nothing in it" if view.state == "free" else "too little of it is seen to tell"
        return f"Corridor: {said} ({view.seen:.0%} seen)"
    ahead = view.ahead
    far = f"{ahead.distance_m:.2f} ± {ahead.sigma_m:.2f} m"
    if ahead.bound:
        far = f"{ahead.distance_m:.2f} m or nearer"
    if approach is None:
        return f"Corridor: nearest thing {far}"
    if approach.contact_s is None or approach.sigma_contact_s is None:
        return f"Corridor: nearest thing {far}, not coming nearer"
    when = f"{approach.contact_s:.1f} ± {approach.sigma_contact_s:.1f} s"
    return f"Corridor: nearest thing {far}, reached in {when}"
