"""Labels of the objects in a view, as a data set would have them."""

from __future__ import annotations

import numpy as np

from pseudolidar.sources.worlds.render import View
from pseudolidar.sources.worlds.scene import Scene
from pseudolidar.sources.worlds.world import Thing
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Box3D, Detection, Label
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.pose import Pose

# Objects that fewer pixels show than this, at KITTI's image width, have no label.
LEAST_PIXELS_AT_1242 = 60
# Visible share from which an object counts as fully visible, and as partly occluded (KITTI 0, 1;
# less is 2).
FULLY_VISIBLE, PARTLY_VISIBLE = 0.8, 0.4
# Part of an object nearer than this to the image plane does not project, metres.
NEAREST_M = 0.1
# Points along each edge of a box that judge how much of it is outside the image.
GRID = 9
# Rays that judge how much of an object is hidden.
SHARE_RAYS = 2000


def labels_of(
    scene: Scene, view: View, camera: Camera, T_world_camera: Float64
) -> tuple[Label, ...]:
    """Labels of what `view` shows, nearest first; 3D boxes are in the frame of `camera`.

    The 2D box holds the visible pixels; occlusion follows from the share of the object's pixels in
    the image that are visible, truncation is the share of its box outside the image.
    """
    numbers, counts = np.unique(view.objects, return_counts=True)
    least = max(4.0, LEAST_PIXELS_AT_1242 * (camera.width_px / 1242) ** 2)
    seen = {int(n) for n, c in zip(numbers, counts, strict=True) if n > 0 and c >= least}
    labels = [
        _label(scene, view, camera, T_world_camera, thing)
        for thing in scene.things
        if thing.number in seen
    ]
    return tuple(sorted(labels, key=_depth_m))


def _label(
    scene: Scene, view: View, camera: Camera, T_world_camera: Float64, thing: Thing
) -> Label:
    mask = view.objects == thing.number
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    box_px = (float(columns[0]), float(rows[0]), float(columns[-1]), float(rows[-1]))
    T_camera_box = np.linalg.inv(T_world_camera) @ thing.T_world_box
    box = Box3D(Pose(camera.frame, "box", T_camera_box), *thing.size_m)
    share = _visible_share(scene, view, camera, T_world_camera, thing, _outline_px(box, camera))
    occlusion = 0 if share >= FULLY_VISIBLE else (1 if share >= PARTLY_VISIBLE else 2)
    return Label(
        Detection(thing.name, box_px, mask=mask),
        box,
        truncation=1.0 - _share_in_view(box, camera),
        occlusion=occlusion,
        track_id=thing.number,
    )


def _depth_m(label: Label) -> float:
    return 0.0 if label.box is None else float(label.box.pose.translation_m[2])


def _share_in_view(box: Box3D, camera: Camera) -> float:
    """Share of a box that projects into the image, by a grid of its points."""
    at = np.linspace(-0.5, 0.5, GRID)
    grid = np.stack(np.meshgrid(at, at, at), axis=-1).reshape(-1, 3)
    points = box.pose.apply(grid * np.array([box.length_m, box.width_m, box.height_m]))
    ahead = points[:, 2] > NEAREST_M
    u, v, _ = (points[ahead] / points[ahead, 2:] @ camera.K.T).T
    inside = (np.abs(2 * u - camera.width_px + 1) <= camera.width_px) & (
        np.abs(2 * v - camera.height_px + 1) <= camera.height_px
    )
    return float(inside.sum() / len(points))


def _outline_px(box: Box3D, camera: Camera) -> tuple[float, float, float, float]:
    """Left, top, right, bottom of the projected corners, also outside the image."""
    corners = box.corners_m()
    corners[:, 2] = np.maximum(corners[:, 2], NEAREST_M)
    u, v, _ = ((corners / corners[:, 2:]) @ camera.K.T).T
    return float(u.min()), float(v.min()), float(u.max()), float(v.max())


def _visible_share(
    scene: Scene,
    view: View,
    camera: Camera,
    T_world_camera: Float64,
    thing: Thing,
    outline: tuple[float, float, float, float],
) -> float:
    """Visible pixels of an object over those it would have alone, on a grid of `SHARE_RAYS`."""
    left, top = (max(0, int(np.floor(x))) for x in outline[:2])
    right = min(camera.width_px - 1, int(np.ceil(outline[2])))
    bottom = min(camera.height_px - 1, int(np.ceil(outline[3])))
    stride = max(1, int(np.sqrt((right - left + 1) * (bottom - top + 1) / SHARE_RAYS)))
    v, u = np.mgrid[top : bottom + 1 : stride, left : right + 1 : stride]
    pixels = np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=1)
    directions = pixels @ (T_world_camera[:3, :3] @ np.linalg.inv(camera.K)).T
    eye = T_world_camera[:3, 3] - scene.origin_m
    alone = scene.alone(thing.number, eye, directions)
    visible = view.objects[v, u] == thing.number
    return float(visible.sum() / max(1, alone.sum()))
