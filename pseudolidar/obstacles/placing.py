"""An obstacle as a measured place: its error is large along the ray and small across it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.obstacles.motion_filter import Place, summed
from pseudolidar.obstacles.movers import UNKNOWN, mover_of_class
from pseudolidar.obstacles.overlap import BoxPx
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import LEFT_FRAME
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose

# Where no poses are known, things are followed in the camera's own frame, its axes turned to x
# ahead, y left, z up.
RELATIVE = "camera_body"
# Nobody measures the middle of a thing better than this across the ray, m.
LEAST_SIGMA_M = 0.05
# Of the middle of a thing whose edges are seen: so much for what it is like, and 3 px of KITTI.
EDGES_SIGMA_M, EDGES_SIGMA_RAD = 0.1, 0.004
# The middle of a thing of which a part may be hidden may be off by this share of its longest side.
HIDDEN_SHARE = 0.1
# What has no usual size ends elsewhere in every frame: its middle is off by this share of it.
RAGGED_SHARE = 0.2
# Of what has no usual size, as walls and hedges, the middle is that of what is seen of it, which
# goes along with the camera where an end is not seen: nobody knows where it is along that, m.
ENDS_M = 10.0
# What has no usual size and is longer than this is mostly such a thing, m.
LONG_M = 5.0
# Boxes that are this close may hide a part of each other.
BESIDE_PX = 4.0
# No thing is matched better along the ray than this share of what the rig leaves.
OWN_SHARE = 0.4
# Weight of the rule that errors lie along the ray, against what the box's own axes tell of it:
# they tell nothing where the ray is diagonal to them.
ALONG_RAY_WEIGHT = 0.1


def relative_pose() -> Pose:
    """`T_camera_body_left`: axes turned, nothing else."""
    return Pose.from_rotation(RELATIVE, LEFT_FRAME, R_BODY_OPTICAL, np.zeros(3))


def all_placed(
    obstacles: Sequence[Obstacle], T_world_camera: Pose, persistent: tuple[float, float]
) -> list[Place]:
    """Where the obstacles of a frame are in the world."""
    return [
        placed(one, T_world_camera, persistent, edges_seen=_edges_seen(one, obstacles))
        for one in obstacles
    ]


def placed(
    obstacle: Obstacle, T_world_camera: Pose, persistent: tuple[float, float], *, edges_seen: bool
) -> Place:
    """Where the middle of an obstacle is in the world, with its error.

    The box has its sigma along its own axes. The covariance with that trace which lies along the
    ray and across it is taken. Where both its edges are seen, they tell where it is across.
    """
    R, centre = T_world_camera.matrix[:3, :3], obstacle.box.pose.translation_m
    ray = _unit(rotated(R, centre))
    across = np.array([-ray[1], ray[0], 0.0])
    length = math.hypot(float(across[0]), float(across[1]))
    # Straight above or below, any axis on the level is across.
    across = across / length if length > 1e-6 else np.array([0.0, 1.0, 0.0])
    upright = np.cross(ray, across)
    sigma = np.maximum(np.array(obstacle.box.sigma_m), LEAST_SIGMA_M)
    forward = rotated(R, obstacle.box.pose.matrix[:3, 0])
    along_m, aside_m = _along_ray(forward, ray, sigma)
    if edges_seen:
        total = along_m**2 + aside_m**2
        aside_m = min(aside_m, EDGES_SIGMA_M + EDGES_SIGMA_RAD * float(centre[2]))
        along_m = math.sqrt(total - aside_m**2)
    else:
        hidden_m = HIDDEN_SHARE * max(obstacle.box.length_m, obstacle.box.width_m)
        aside_m = math.hypot(aside_m, hidden_m)
    if mover_of_class(obstacle.detection.name) is UNKNOWN:
        ragged_m = RAGGED_SHARE * max(obstacle.box.length_m, obstacle.box.width_m)
        along_m, aside_m = math.hypot(along_m, ragged_m), math.hypot(aside_m, ragged_m)
    if goes_on(obstacle):
        longest = forward if obstacle.box.length_m > obstacle.box.width_m else _left_of(forward)
        turned = math.atan2(longest[1], longest[0]) - math.atan2(ray[1], ray[0])
        along_m = math.hypot(along_m, ENDS_M * math.cos(turned))
        aside_m = math.hypot(aside_m, ENDS_M * math.sin(turned))
    shared_m = obstacle.sigma_shared_m
    least_m = max(LEAST_SIGMA_M, OWN_SHARE * shared_m)
    own_m = math.sqrt(max(along_m**2 - shared_m**2, least_m**2))
    return Place(
        T_world_camera.apply(centre[None])[0],
        np.stack([ray, across, upright]),
        np.array([own_m, aside_m, sigma[2]]),
        persistent,
        shared_m,
    )


def goes_on(obstacle: Obstacle) -> bool:
    """Whether it has no usual size, and it is long, or an end of it is not seen."""
    long = max(obstacle.box.length_m, obstacle.box.width_m) > LONG_M
    endless = long or obstacle.truncated or obstacle.occluded
    return endless and mover_of_class(obstacle.detection.name) is UNKNOWN


def _edges_seen(one: Obstacle, others: Sequence[Obstacle]) -> bool:
    """Whether neither the picture's border nor anything nearer cuts it, or lies beside it."""
    if one.occluded or one.truncated or one.measured_by == "size":
        return False
    return not any(
        other.distance_m < one.distance_m and _beside(one.detection.box_px, other.detection.box_px)
        for other in others
    )


def _beside(a: BoxPx, b: BoxPx) -> bool:
    across = min(a[2], b[2]) - max(a[0], b[0])
    return min(across, min(a[3], b[3]) - max(a[1], b[1])) > -BESIDE_PX


def rotated(R: Float64, vector: Float64) -> Float64:
    """(3,) R times a vector, without BLAS."""
    return summed(R * vector)


def _along_ray(forward: Float64, ray: Float64, sigma: Float64) -> tuple[float, float]:
    """Sigma along the ray and across it, of those along the length and the width of a box.

    length^2 = along^2 c^2 + across^2 s^2 and width^2 = along^2 s^2 + across^2 c^2, with the angle
    between length and ray; the difference of both is known as far as cos 2a is not 0.
    """
    angle = math.atan2(forward[1], forward[0]) - math.atan2(ray[1], ray[0])
    double = math.cos(2.0 * angle)
    length, width = float(sigma[0]) ** 2, float(sigma[1]) ** 2
    most = length + width - 2.0 * LEAST_SIGMA_M**2
    told = double * (length - width) + ALONG_RAY_WEIGHT * most
    difference = min(max(told / (double**2 + ALONG_RAY_WEIGHT), -most), most)
    total = length + width
    return math.sqrt(0.5 * (total + difference)), math.sqrt(0.5 * (total - difference))


def _left_of(forward: Float64) -> Float64:
    return np.array([-forward[1], forward[0], 0.0])


def _unit(vector: Float64) -> Float64:
    return vector / math.sqrt(float(summed(vector * vector)))
