"""`--to colmap`: cameras, poses and points as a COLMAP model, for splatting tools.

    colmap/images/{left,right}/ID.png
    colmap/sparse/0/{cameras,images,points3D}.txt
    colmap/parts/ID.npz, ID.json             what each frame adds; the model is joined from them

COLMAP's pixel coordinates have the centre of the first pixel at (0.5, 0.5), ours at (0, 0).
Source: COLMAP documentation, Output Format.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import PoseMissing, UsageError
from pseudolidar.formats.atomic import atomic_file
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.points.npz import encode_npz, read_npz
from pseudolidar.geometry.cloud_frames import left_in
from pseudolidar.geometry.frames import MAP, left_in_base_link
from pseudolidar.geometry.quaternion import quaternion_wxyz
from pseudolidar.running.journal.record import FrameRecord, OutputFile
from pseudolidar.structures.arrays import AnyArray, Bool, Float32, Float64, Int64
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose

ROOT = "colmap"
MODEL_FILES = ("cameras.txt", "images.txt", "points3D.txt")
PRODUCTS = tuple(f"{ROOT}/sparse/0/{name}" for name in MODEL_FILES)
PIXEL_CENTRE = 0.5
# Points whose range is less sure than this are no help to a splatting tool.
LARGEST_SIGMA_REL = 0.05
SIDES = ("left", "right")


@dataclass(frozen=True)
class ColmapModel:
    """The model of `--to colmap`.

    Args:
        points: of all frames together; of each the surest in every cell of a grid.
    """

    points: int = 200_000

    def __post_init__(self) -> None:
        if self.points < 1:
            raise UsageError(f"{self.points} points", want="at least 1", where="points")


def model_files(frame: StereoFrame, cloud: PointCloud, *, points: int) -> list[OutputFile]:
    """Pictures and part of a frame.

    Args:
        frame: with its pose.
        cloud: of it, with source pixels, in `velodyne`, `base_link` or the left camera's frame.
        points: at most so many of them.

    Raises:
        PoseMissing: nobody knows where the frame was taken.
    """
    if frame.pose is None:
        raise PoseMissing(
            "a frame without a pose",
            want="where each picture was taken",
            fix="Leave colmap out of --to, or take a source with poses (KITTI raw, odometry).",
            where=f"frame {frame.id}",
        )
    T_map_left = frame.pose @ left_in_base_link(frame.rig)
    T_left_map = T_map_left.inverse()
    poses = {"left": T_left_map, "right": frame.rig.T_right_left @ T_left_map}
    cameras = {"left": frame.rig.left, "right": frame.rig.right}
    eyes = {side: _eye(cameras[side], poses[side]) for side in SIDES}
    part = _part(cloud, frame.rig, T_map_left, points)
    name = f"{ROOT}/parts/{frame.id}"
    pictures = {"left": frame.left, "right": frame.right}
    return [
        *(
            OutputFile.of(f"{ROOT}/images/{side}/{frame.id}.png", encode_png(pictures[side]))
            for side in SIDES
        ),
        OutputFile.of(f"{name}.npz", encode_npz(part)),
        OutputFile.of(f"{name}.json", json.dumps(eyes, indent=1).encode() + b"\n"),
    ]


def finish_model(folder: Path, records: Sequence[FrameRecord]) -> None:
    """Join the parts of the committed frames into the model.

    Args:
        folder: output folder of the run.
        records: of its frames.
    """
    done = [record.id for record in records if record.skipped is None]
    parts = [_Part(folder, name, index) for index, name in enumerate(done)]
    cameras: dict[str, int] = {}
    for part in parts:
        for eye in part.eyes.values():
            cameras.setdefault(eye["camera"], len(cameras) + 1)
    place = folder / ROOT / "sparse" / "0"
    texts = (
        (f"{number} {camera}\n" for camera, number in cameras.items()),
        (line for part in parts for line in part.image_lines(cameras)),
        (line for part in parts for line in part.point_lines()),
    )
    first_ids = np.cumsum([1, *(part.count for part in parts)])
    for part, first in zip(parts, first_ids, strict=False):
        part.first_point = int(first)
    for name, lines in zip(MODEL_FILES, texts, strict=True):
        with atomic_file(place / name) as file:
            file.write(f"# {_HEADS[name]}\n".encode())
            for line in lines:
                file.write(line.encode())


_HEADS = {
    "cameras.txt": "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]: fx fy cx cy",
    "images.txt": "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, world to camera; "
    "then POINTS2D[] as X Y POINT3D_ID",
    "points3D.txt": "POINT3D_ID X Y Z R G B ERROR TRACK[] as IMAGE_ID POINT2D_IDX",
}


def _eye(camera: Camera, T_camera_map: Pose) -> dict[str, Any]:
    K = camera.K
    values = (K[0, 0], K[1, 1], K[0, 2] + PIXEL_CENTRE, K[1, 2] + PIXEL_CENTRE)
    parameters = " ".join(repr(float(value)) for value in values)
    rotation = quaternion_wxyz(T_camera_map.matrix[:3, :3])
    pose = " ".join(repr(float(v)) for v in (*rotation, *T_camera_map.translation_m))
    return {
        "camera": f"PINHOLE {camera.width_px} {camera.height_px} {parameters}",
        "pose": pose,
    }


def _part(cloud: PointCloud, rig: StereoRig, T_map_left: Pose, points: int) -> PointCloud:
    """The surest points in `map`, with their pixels in both images and sigma in pixels."""
    left = cloud
    if cloud.frame != rig.left.frame:
        left = cloud.transformed(left_in(rig, cloud.frame).inverse())
    assert left.uv is not None  # every reprojected cloud has them
    rows = _surest(left, rig.left.size_px, points)
    left = left[rows]
    xyz = left.xyz.astype(np.float64)
    uv_right = _projected(rig.P_right, xyz)
    sigma_px = np.zeros(len(xyz))
    if left.sigma_m is not None:
        range_m = np.linalg.norm(xyz, axis=1)
        sigma_px = left.sigma_m * rig.fB_px_m / (xyz[:, 2] * range_m)
    rgb = left.rgb
    if rgb is None:
        brightness = np.zeros(len(xyz)) if left.intensity is None else left.intensity
        grey = np.clip(np.rint(255 * brightness), 0, 255).astype(np.uint8)
        rgb = np.repeat(grey[:, None], 3, axis=1)
    width, height = rig.right.size_px
    beyond = np.array([width, height]) - PIXEL_CENTRE
    inside = (uv_right >= -PIXEL_CENTRE) & (uv_right < beyond)
    uv_right[~inside.all(axis=1)] = np.nan
    return PointCloud(
        xyz=T_map_left.apply(xyz),
        frame=MAP,
        timestamp_ns=left.timestamp_ns,
        rgb=rgb,
        uv=left.uv,
        extra={
            "u_right": uv_right[:, 0].astype(np.float32),
            "v_right": uv_right[:, 1].astype(np.float32),
            "sigma_px": sigma_px.astype(np.float32),
        },
    )


def _surest(cloud: PointCloud, size_px: tuple[int, int], points: int) -> Int64:
    """Rows of the point with the smallest relative error in each cell of a grid, increasing."""
    assert cloud.uv is not None
    valid = cloud.valid if cloud.shape is not None else np.isfinite(cloud.xyz).all(axis=1)
    range_m = np.linalg.norm(cloud.xyz, axis=1)
    unsure = range_m if cloud.sigma_m is None else cloud.sigma_m / range_m
    if cloud.sigma_m is not None:
        valid = valid & (unsure <= LARGEST_SIGMA_REL)
    rows = np.flatnonzero(valid)
    cell_px = max(1, math.ceil(math.sqrt(size_px[0] * size_px[1] / points)))
    columns = -(-size_px[0] // cell_px)
    at = (cloud.uv[rows] // cell_px).astype(np.int64)
    cell = at[:, 1] * columns + at[:, 0]
    order = np.lexsort((rows, unsure[rows], cell))
    _cells, first = np.unique(cell[order], return_index=True)
    return np.sort(rows[order[first]])


def _projected(P: Float64, xyz: AnyArray) -> Float64:
    """(N, 2) pixels, column by column: BLAS may round differently by its number of threads."""
    x, y, z = xyz.T
    u, v, w = (x * row[0] + y * row[1] + z * row[2] + row[3] for row in P)
    return np.stack([u / w, v / w], axis=1)


class _Part:
    """A frame's part of the model, read back."""

    def __init__(self, folder: Path, name: str, index: int) -> None:
        place = folder / ROOT / "parts"
        self.name, self.index, self.first_point = name, index, 1
        self._path = place / f"{name}.npz"
        self.eyes: dict[str, dict[str, str]] = json.loads((place / f"{name}.json").read_bytes())
        self.count = len(self.cloud)

    @property
    def cloud(self) -> PointCloud:
        """Read anew each time, so that only one is in memory."""
        return read_npz(self._path)

    def image_lines(self, cameras: dict[str, int]) -> Iterator[str]:
        cloud = self.cloud
        points = self.first_point + np.arange(len(cloud))
        for side, eye in self.eyes.items():
            number = self._image(side)
            yield f"{number} {eye['pose']} {cameras[eye['camera']]} {side}/{self.name}.png\n"
            uv, seen = _pixels(cloud, side)
            yield (
                " ".join(
                    f"{u + PIXEL_CENTRE:.3f} {v + PIXEL_CENTRE:.3f} {point}"
                    for (u, v), point in zip(uv[seen].tolist(), points[seen].tolist(), strict=True)
                )
                + "\n"
            )

    def point_lines(self) -> Iterator[str]:
        cloud = self.cloud
        assert cloud.rgb is not None
        tracks = np.full((len(SIDES), len(cloud)), -1)
        for row, side in enumerate(SIDES):
            seen = _pixels(cloud, side)[1]
            tracks[row, seen] = np.arange(np.count_nonzero(seen))
        values = zip(
            cloud.xyz.tolist(),
            cloud.rgb.tolist(),
            cloud.extra["sigma_px"].tolist(),
            tracks.T.tolist(),
            strict=True,
        )
        for i, ((x, y, z), (r, g, b), error, track) in enumerate(values):
            seen_in = " ".join(
                f"{self._image(side)} {at}"
                for side, at in zip(SIDES, track, strict=True)
                if at >= 0
            )
            place = f"{x:.6f} {y:.6f} {z:.6f} {r} {g} {b} {error:.4f}"
            yield f"{self.first_point + i} {place} {seen_in}\n"

    def _image(self, side: str) -> int:
        return len(SIDES) * self.index + SIDES.index(side) + 1


def _pixels(cloud: PointCloud, side: str) -> tuple[Float32, Bool]:
    """(N, 2) pixels in an image, and which points are in it."""
    assert cloud.uv is not None
    uv = cloud.uv
    if side == "right":
        uv = np.stack([cloud.extra["u_right"], cloud.extra["v_right"]], axis=1)
    return uv, np.isfinite(uv[:, 0]) & np.isfinite(uv[:, 1])
