"""What a world is: where the body goes, what stands around it, what moves, what light falls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.sources.worlds.meshes import Colour, Mesh, body_pose
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose


@dataclass(frozen=True)
class Light:
    """Light of a world.

    Args:
        towards: direction of the sun, or the place of the lamp where `lamp`.
        sun: its strength (linear, on a white surface that faces it).
        ambient: light from everywhere.
        lamp: `towards` is a place in the world, metres.
        haze_m: distance at which haze takes 63 % of the contrast; 0 for none.
        haze: colour of the haze.
        sky_seed: which clouds.
    """

    towards: tuple[float, float, float]
    sun: Colour
    ambient: Colour
    lamp: bool = False
    haze_m: float = 0.0
    haze: Colour = (0.7, 0.78, 0.85)
    sky_seed: int = 0


@dataclass(frozen=True)
class RigDesign:
    """The cameras that a world is seen with, at their full size.

    Args:
        width_px: image width.
        height_px: image height.
        focal_px: focal length at that width.
        centre: principal point as shares of width and height.
        baseline_m: distance of the eyes.
        left_in_base_m: place of the left eye in `base_link` (which is the Velodyne).
        pitch_deg: how far the cameras look down.
        yaw_deg: how far they look left.
    """

    width_px: int
    height_px: int
    focal_px: float
    centre: tuple[float, float]
    baseline_m: float
    left_in_base_m: tuple[float, float, float]
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0

    def rig(self, width_px: int, height_px: int, *, origin: str) -> StereoRig:
        """Rig for images of another size: the horizontal field of view stays, square pixels."""
        focal = self.focal_px * width_px / self.width_px
        K = np.array(
            [
                [focal, 0.0, self.centre[0] * width_px - 0.5],
                [0.0, focal, self.centre[1] * height_px - 0.5],
                [0.0, 0.0, 1.0],
            ]
        )
        shift = np.array([-self.baseline_m, 0.0, 0.0])
        return StereoRig(
            left=Camera(K, width_px, height_px, frame="camera_left"),
            right=Camera(K, width_px, height_px, frame="camera_right"),
            T_right_left=Pose.from_rotation("camera_right", "camera_left", np.eye(3), shift),
            T_left_velodyne=self.T_left_velodyne,
            origin=origin,
        )

    @property
    def T_left_velodyne(self) -> Pose:
        """Pose of the Velodyne in the left camera."""
        pitch, yaw = np.deg2rad([self.pitch_deg, self.yaw_deg])
        turned = body_pose(np.zeros(3), yaw_rad=yaw, pitch_rad=pitch, roll_rad=0.0)
        R = (turned[:3, :3] @ R_BODY_OPTICAL).T
        return Pose.from_rotation("camera_left", "velodyne", R, -R @ np.array(self.left_in_base_m))


@dataclass(frozen=True, eq=False)
class Thing:
    """A labelled object.

    Args:
        number: identity over time, > 0, unique in a frame.
        name: class, as KITTI names it.
        T_world_box: (4, 4) its box; axes x forward, y left, z up, origin at the centre.
        size_m: length, width, height.
    """

    number: int
    name: str
    T_world_box: Float64
    size_m: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Actor:
    """A thing that moves, with its triangles where it is now."""

    thing: Thing
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What stands still around the body for a while.

    Args:
        meshes: all of it but what is thin, piece by piece, world coordinates.
        thin: wires: too thin to throw a shadow that one could see (the sun is half a degree wide).
        things: labelled objects in it (parked cars).
        origin_m: (3,) a place near the body: single precision is counted from there.
    """

    meshes: tuple[Mesh, ...]
    thin: Mesh
    things: tuple[Thing, ...]
    origin_m: Float64


class World(Protocol):
    """A world; a frozen, picklable dataclass. Everything is a pure function of time."""

    def __hash__(self) -> int:
        """Equal worlds share what is built of them."""

    @property
    def design(self) -> RigDesign:
        """Cameras it is made to be seen with."""

    @property
    def light(self) -> Light:
        """Its light."""

    def T_world_base(self, t_s: float) -> Float64:
        """(4, 4) pose of the body at `t_s` seconds."""

    def region(self, t_s: float) -> int:
        """Number of the surroundings that the body is in."""

    def surroundings(self, region: int) -> Surroundings:
        """What stands still there."""

    def actors(self, t_s: float) -> tuple[Actor, ...]:
        """What moves there, where it is now."""
