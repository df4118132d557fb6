"""A street as three pairs on one body see it, rendered, with exact places and depths."""

from __future__ import annotations

import functools
from pathlib import Path

import cv2
import numpy as np

from pseudolidar.formats.rigs.body_json import write_body
from pseudolidar.geometry.frames import BASE_LINK, R_BODY_OPTICAL
from pseudolidar.sources.synthetic import WORLDS
from pseudolidar.sources.worlds.photometry import Photometry
from pseudolidar.sources.worlds.render import render
from pseudolidar.sources.worlds.scene import scene_at
from pseudolidar.structures.body import BodyRig, MountedPair
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

WIDTH_PX, HEIGHT_PX, FOCAL_PX, BASELINE_M = 320, 200, 160.0, 0.4
# Name: yaw to the left in degrees, and place on the body in metres.
MOUNTS = {
    "front": (0.0, (0.5, 0.2, 0.0)),
    "left": (55.0, (0.2, 0.6, 0.05)),
    "right": (-55.0, (0.1, -0.5, 0.1)),
}


def yawed(deg: float) -> np.ndarray:
    """A rotation about the body's z axis, to the left."""
    return cv2.Rodrigues(np.array([0.0, 0.0, np.radians(deg)]))[0]


def rig(scale: int = 1) -> StereoRig:
    """One of the equal pairs; pictures `scale` times as large."""
    width, height, f = WIDTH_PX * scale, HEIGHT_PX * scale, FOCAL_PX * scale
    K = np.array([[f, 0, (width - 1) / 2], [0, f, 90.0 * scale], [0, 0, 1]])
    pose = Pose.from_rotation(
        "camera_right", "camera_left", np.eye(3), np.array([-BASELINE_M, 0.0, 0.0])
    )
    return StereoRig(Camera(K, width, height), Camera(K, width, height, frame="camera_right"), pose)


def body_rig(scale: int = 1) -> BodyRig:
    """The three pairs where they are."""
    pairs = []
    for name, (yaw_deg, place_m) in MOUNTS.items():
        R = yawed(yaw_deg) @ R_BODY_OPTICAL
        pose = Pose.from_rotation(BASE_LINK, "camera_left", R, np.array(place_m))
        pairs.append(MountedPair(name, rig(scale), pose))
    return BodyRig(tuple(pairs), "rendered street")


@functools.cache
def views(frame: int, name: str, scale: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pictures of both eyes and exact depth of the left one, of a pair at a frame (1 s apart)."""
    world = WORLDS["street"](seed=3)
    scene = scene_at(world, float(frame))
    T_world_left = world.T_world_base(float(frame)) @ body_rig()[name].T_base_link_left.matrix
    own = rig(scale)
    left = render(scene, own.left, T_world_left)
    right = render(scene, own.right, T_world_left @ own.T_right_left.inverse().matrix)
    exposure, rng = Photometry(), np.random.default_rng([frame, len(name)])
    pictures = [
        exposure.expose(view.light, right=is_right, rng=rng)
        for view, is_right in ((left, False), (right, True))
    ]
    return pictures[0], pictures[1], left.depth


def write_pairs(folder: Path, frames: int, *, body: BodyRig | None = None, scale: int = 1) -> None:
    """The body as a user has it: rig.json, and folders front/left, front/right, ..."""
    for name in MOUNTS:
        for eye in ("left", "right"):
            (folder / name / eye).mkdir(parents=True, exist_ok=True)
        for frame in range(frames):
            left, right, _ = views(frame, name, scale)
            for eye, picture in (("left", left), ("right", right)):
                path = folder / name / eye / f"{frame:06d}.png"
                cv2.imwrite(str(path), np.ascontiguousarray(picture[..., ::-1]))
    write_body(folder / "rig.json", body or body_rig(scale))


def exact_cloud(frame: int, name: str, *, step: int = 1, most_m: float = 40.0) -> PointCloud:
    """What a pair sees, in its left camera, by the exact depth."""
    depth = views(frame, name)[2][::step, ::step]
    v, u = np.nonzero(np.isfinite(depth) & (depth < most_m))
    z = depth[v, u]
    K = rig().left.K
    rays = np.linalg.inv(K) @ np.stack([u * step, v * step, np.ones(len(u))])
    uv = np.stack([u * step, v * step], axis=1).astype(np.float32)
    sigma_m = (z * z / (FOCAL_PX * BASELINE_M) * 0.2).astype(np.float32)
    return PointCloud((rays * z).T.astype(np.float32), "camera_left", sigma_m=sigma_m, uv=uv)


def perturbed(body: BodyRig, *, turn_deg: float, shift_m: float, seed: int = 0) -> BodyRig:
    """The body with all places but the first wrong by so much, in directions of their own."""
    rng = np.random.default_rng(seed)
    pairs = [body.pairs[0]]
    for pair in body.pairs[1:]:
        axis, shift = rng.normal(size=(2, 3))
        matrix = pair.T_base_link_left.matrix.copy()
        turn = cv2.Rodrigues(np.radians(turn_deg) * axis / np.linalg.norm(axis))[0]
        matrix[:3, :3] = turn @ matrix[:3, :3]
        matrix[:3, 3] += shift_m * shift / np.linalg.norm(shift)
        pairs.append(pair.placed(Pose(BASE_LINK, "camera_left", matrix)))
    return BodyRig(tuple(pairs), "measured by hand")


def off_by(found: BodyRig, name: str) -> tuple[float, float]:
    """By how many metres and degrees a pair is off its true place."""
    got, want = found[name].T_base_link_left, body_rig()[name].T_base_link_left
    turn = cv2.Rodrigues(got.matrix[:3, :3] @ want.matrix[:3, :3].T)[0]
    shift = got.translation_m - want.translation_m
    return float(np.linalg.norm(shift)), float(np.degrees(np.linalg.norm(turn)))
