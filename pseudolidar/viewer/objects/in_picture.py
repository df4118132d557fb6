"""Objects as they are seen in the pictures of a frame: boxes around them, their edges in space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.geometry.lines_in_view import lines_px
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import DepthFrame
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.objects.lines import edges_of
from pseudolidar.viewer.objects.scene import ObjectScene
from pseudolidar.viewer.objects.shown import (
    TRUTH_COLOUR,
    Colour,
    ShownObject,
    ShownTruth,
    hexadecimal,
)

BoxPx = tuple[float, float, float, float]
# No coordinate is sent that is farther out, px, and digits after the point.
FARTHEST_PX, DIGITS = 30_000.0, 1


@dataclass(frozen=True, eq=False)
class PictureBox:
    """An object in a picture.

    Args:
        key: of the object; "" of what the data set labels.
        text: what it is, and how far.
        told: all that is told of it, a line each.
        colour: as in the scene.
        sure: whether it was seen, and measured by its points.
        box_px: left, top, right, bottom, px.
        edges_px: (N, 2, 2) of its box in space, px, as far as it is before the camera.
    """

    key: str
    text: str
    told: str
    colour: Colour
    sure: bool
    box_px: BoxPx
    edges_px: Float64

    @property
    def fields(self) -> dict[str, object]:
        """For a page."""
        edges = np.clip(self.edges_px.reshape(-1, 4), -FARTHEST_PX, FARTHEST_PX)
        return {
            "key": self.key,
            "text": self.text,
            "told": self.told,
            "colour": hexadecimal(self.colour),
            "sure": self.sure,
            "box": [round(float(side), DIGITS) for side in self.box_px],
            "edges": np.round(edges, DIGITS).tolist(),
        }


@dataclass(frozen=True, eq=False)
class PictureEye:
    """The camera of a picture.

    Args:
        P: (3, 4) projection of points in the left camera's frame.
        T_forward_camera: (4, 4) from there into the frame of the clouds.
        fB_px_m: disparity, px, of what is 1 m away, where it is the right one of a pair.
        doffs_px: what the disparity of everything is smaller by.
    """

    P: Float64
    T_forward_camera: Float64
    fB_px_m: float = 0.0
    doffs_px: float = 0.0

    @classmethod
    def of(cls, moment: Moment, *, right: bool) -> Self | None:
        """The left or the right one of a frame; None where there is none."""
        frame = None if moment.converted is None else moment.converted.frame
        if moment.sight is None or not isinstance(frame, StereoFrame | DepthFrame):
            return None
        T = moment.sight.T_forward_camera
        if not right:
            return cls(np.column_stack([moment.sight.camera.K, np.zeros(3)]), T)
        if isinstance(frame, DepthFrame):
            return None
        rig = frame.rig
        return cls(rig.P_right, T, rig.fB_px_m, rig.doffs_px)

    def edges_px(self, corners_m: Float64) -> Float64:
        """(N, 2, 2) edges of a box (8, 3) in the frame of the clouds."""
        R, t = self.T_forward_camera[:3, :3], self.T_forward_camera[:3, 3]
        return lines_px(edges_of([(corners_m - t) @ R]), self.P)

    def box_px(self, of_left: BoxPx, distance_m: float | None) -> BoxPx:
        """A box of the left picture: in the right one it stands where its nearest face does."""
        if not self.fB_px_m or distance_m is None:
            return of_left
        left, top, right, bottom = of_left
        disparity_px = self.fB_px_m / distance_m - self.doffs_px
        return left - disparity_px, top, right - disparity_px, bottom

    def object(self, one: ShownObject) -> PictureBox:
        """An object in this picture."""
        obstacle = one.obstacle
        return PictureBox(
            one.key,
            f"{one.name} {obstacle.distance_m:.1f} m",
            one.label,
            one.colour,
            one.sure,
            self.box_px(obstacle.detection.box_px, obstacle.distance_m),
            self.edges_px(one.corners_m),
        )

    def truth(self, one: ShownTruth, *, named: bool) -> PictureBox:
        """What the data set labels, in this picture; without words where objects have some."""
        return PictureBox(
            "",
            one.label.replace("\n", " ") if named else "",
            f"label: {one.label}",
            TRUTH_COLOUR,
            True,
            self.box_px(one.box_px, one.distance_m),
            self.edges_px(one.corners_m),
        )


def boxes_in_picture(scene: ObjectScene, moment: Moment, *, right: bool) -> tuple[PictureBox, ...]:
    """The objects of a frame in one of its pictures, the nearest first, then its labels.

    Args:
        scene: as it is drawn.
        moment: the frame; of one without pictures there is nothing.
        right: in the right one; else in the left one.
    """
    eye = PictureEye.of(moment, right=right)
    if eye is None:
        return ()
    truths = (eye.truth(one, named=not scene.objects) for one in scene.truths)
    return (*map(eye.object, scene.objects), *truths)
