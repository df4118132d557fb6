"""An object as it is drawn and told: places in the scene, colour, words."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.formats.obstacle_words import distance_text, moves, name_text, unseen_text
from pseudolidar.formats.obstacle_words import speed_text as sure_speed_text
from pseudolidar.geometry.box_in_view import nearest_depth_m
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Label
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.viewer.colouring import object_colours

Colour = tuple[int, int, int]
# Colours of classes of things that are not followed; others have those of their numbers.
CLASS_COLOURS: dict[str, Colour] = {
    "car": (79, 172, 254),
    "van": (120, 130, 255),
    "truck": (180, 120, 255),
    "bus": (200, 100, 230),
    "tram": (230, 110, 200),
    "pedestrian": (255, 110, 110),
    "person": (255, 110, 110),
    "person_sitting": (255, 140, 140),
    "cyclist": (255, 190, 60),
    "bicycle": (255, 190, 60),
    "motorcycle": (255, 160, 60),
}
OTHER_COLOUR: Colour = (120, 220, 150)
# Of what the data set labels.
TRUTH_COLOUR: Colour = (235, 235, 235)
# Below this confidence a box is drawn as one that nobody is sure of.
SURE = 0.5
# An arrow reaches as far as a thing comes in this time, s.
ARROW_S = 1.0


@dataclass(frozen=True)
class Band:
    """What is shown of what was found.

    Args:
        near_m: nearest distance.
        far_m: farthest distance.
        least_m: smallest thing, the larger of its width and its height.
    """

    near_m: float = 0.0
    far_m: float = math.inf
    least_m: float = 0.0

    def holds(self, obstacle: Obstacle) -> bool:
        """Whether an object is shown."""
        box = obstacle.box
        size_m = max(box.width_m, box.height_m)
        return self.near_m <= obstacle.distance_m <= self.far_m and size_m >= self.least_m


@dataclass(frozen=True, eq=False)
class ShownObject:
    """One object of a frame.

    Args:
        key: the same for the same thing as long as it is followed, and of no other; of a thing that
            is not followed its place in its frame.
        obstacle: all that is known.
        colour: red, green, blue.
        corners_m: (8, 3) of its box, in the frame of the clouds.
        arrow_m: (2, 3) from its middle to where it is a second later; None where it stands.
    """

    key: str
    obstacle: Obstacle
    colour: Colour
    corners_m: Float64
    arrow_m: Float64 | None

    @classmethod
    def of(
        cls, number: int, obstacle: Obstacle, T_forward_camera: Float64, *, of_round: int = 0
    ) -> Self:
        """An object as it is drawn.

        Args:
            number: in its frame, from 1.
            obstacle: in `camera_left`.
            T_forward_camera: (4, 4) into the frame of the clouds.
            of_round: in which numbers of tracks mean the same thing.
        """
        track, R, t = obstacle.track, T_forward_camera[:3, :3], T_forward_camera[:3, 3]
        corners = obstacle.box.corners_m() @ R.T + t
        arrow = None
        if track is not None and moves(obstacle):
            middle = corners.mean(axis=0)
            arrow = np.stack([middle, middle + ARROW_S * (R @ track.velocity_m_s)])
        key = f"object {number}" if track is None else f"track {of_round}.{track.track_id}"
        return cls(key, obstacle, colour_of(obstacle), corners, arrow)

    @property
    def sure(self) -> bool:
        """Whether it was seen, and measured by its points."""
        one = self.obstacle
        return not one.coasts and one.measured_by != "size" and one.confidence >= SURE

    @property
    def middle_m(self) -> Float64:
        """(3,) of its box, in the frame of the clouds."""
        return np.asarray(self.corners_m.mean(axis=0))

    @property
    def label(self) -> str:
        """For the scene: what, how far, how fast."""
        one = self.obstacle
        lines = (name_text(one), self.distance, sure_speed_text(one), unseen_text(one))
        return "\n".join(line for line in lines if line)

    @property
    def name(self) -> str:
        """Class, and identity where it is followed."""
        return name_text(self.obstacle)

    @property
    def distance(self) -> str:
        """Of its nearest face, with one standard deviation."""
        return distance_text(self.obstacle).replace("+-", "±")

    @property
    def row(self) -> dict[str, object]:
        """For a list: words, and what they are found by."""
        one, box = self.obstacle, self.obstacle.box
        return {
            "key": self.key,
            "name": self.name,
            "colour": hexadecimal(self.colour),
            "sure": self.sure,
            "distance": self.distance.removesuffix(" m"),
            "size": f"{box.length_m:.1f}×{box.width_m:.1f}×{box.height_m:.1f}",
            "speed": speed_text(one),
            "contact": contact_text(one),
            "state": state_text(one),
        }


@dataclass(frozen=True, eq=False)
class ShownTruth:
    """A labelled object.

    Args:
        corners_m: (8, 3) of its box, in the frame of the clouds.
        label: what it is, and how far.
        box_px: left, top, right, bottom in the left picture, as labelled.
        distance_m: of its nearest face; None where nobody knows.
    """

    corners_m: Float64
    label: str
    box_px: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    distance_m: float | None = None

    @classmethod
    def of(cls, label: Label, camera: Camera, T_forward_camera: Float64) -> Self | None:
        """A label as it is drawn; None where it has no box in space, or is to be ignored."""
        if label.box is None or label.ignore:
            return None
        distance_m = nearest_depth_m(label.box, camera)
        far = "" if distance_m is None else f"\n{distance_m:.1f} m"
        corners = label.box.corners_m() @ T_forward_camera[:3, :3].T + T_forward_camera[:3, 3]
        detection = label.detection
        return cls(corners, f"{detection.name}{far}", detection.box_px, distance_m)


def colour_of(obstacle: Obstacle) -> Colour:
    """By its identity where it is followed, as points are by the number of their object."""
    if obstacle.track is None:
        return CLASS_COLOURS.get(obstacle.detection.name.lower(), OTHER_COLOUR)
    red, green, blue = object_colours(np.array([obstacle.track.track_id]))[0]
    return int(red), int(green), int(blue)


def hexadecimal(colour: Colour) -> str:
    """A colour as pages have it: `#rrggbb`."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def speed_text(obstacle: Obstacle) -> str:
    """Speed, m/s, with one standard deviation; nothing where nobody knows, or believes it yet."""
    track = obstacle.track
    if track is None or track.state == "tentative" or not math.isfinite(track.speed_m_s):
        return ""
    return f"{track.speed_m_s:.1f} ± {track.sigma_speed_m_s:.1f}"


def contact_text(obstacle: Obstacle) -> str:
    """In how many seconds it is here; nothing where it surely does not come nearer."""
    track = obstacle.track
    if track is None or track.contact is None or track.state == "tentative":
        return ""
    return f"{track.contact.time_s:.1f} ± {track.contact.sigma_time_s:.1f}"


def state_text(obstacle: Obstacle) -> str:
    """What is odd about it, in words."""
    said = [
        unseen_text(obstacle),
        "hidden in part" if obstacle.occluded else "",
        "cut by the border" if obstacle.truncated else "",
        "by its size alone" if obstacle.measured_by == "size" else "",
        "may be nearer" if obstacle.bound else "",
        "" if obstacle.coasts else f"confidence {obstacle.confidence:.2f}",
    ]
    return ", ".join(one for one in said if one)
