"""Makes the pictures of the README from rendered worlds: `python docs/make_pictures.py`.

Each shows one frame: photo and disparity, the cloud of that one pair in perspective, and from
above. Only rendered worlds: pictures of recorded data sets have licences of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pseudolidar import PointCloud, Pose
from pseudolidar.evaluation.pictures import NOTHING, disparity_picture
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.pictures.image import encode_jpeg
from pseudolidar.geometry.cloud_frames import left_in
from pseudolidar.geometry.projection import project
from pseudolidar.running.reports.removed import removed_picture
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.clean import Clean
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.structures.arrays import Float64, UInt8

FOLDER = Path(__file__).parent
WIDTH_PX = 1200
# Drawn larger and shrunk, so that points have soft edges.
OVERSAMPLING = 2
GAP_PX = 6
JPEG_QUALITY = 84
# Points whose sigma is a larger share of their range blur a picture more than they add.
SURE_REL = 0.08


@dataclass(frozen=True)
class View:
    """What is drawn.

    Args:
        world: street, room or flight.
        frame: which frame.
        eye_m: where the cloud is seen from, in the left camera's axes (x right, y down, z forward).
        down_deg: how far that eye looks down.
        ahead_m: nearest and farthest x of the top view.
        aside_m: largest y of the top view.
        max_range_m: points beyond are left out.
    """

    world: str
    frame: int
    eye_m: tuple[float, float, float]
    down_deg: float
    ahead_m: tuple[float, float]
    aside_m: float
    max_range_m: float


VIEWS = (View("street", 9, (-2.5, -2.2, -2.5), 4.0, (5.0, 50.0), 8.5, 60.0),)
# Before and after cleaning: from beside and above, where trails and the sky show.
CLEANED = View("street", 25, (-5.0, -6.0, -2.0), 14.0, (3.0, 60.0), 13.0, 80.0)


def main() -> None:
    """Write every picture beside this file."""
    for view in VIEWS:
        picture = sheet(view)
        write_atomic(FOLDER / f"{view.world}.jpg", encode_jpeg(picture, quality=JPEG_QUALITY))
    picture = before_and_after(CLEANED)
    write_atomic(FOLDER / "cleaned.jpg", encode_jpeg(picture, quality=JPEG_QUALITY))


def sheet(view: View) -> UInt8:
    """Photo beside disparity, then the cloud in perspective, then from above."""
    frame = Synthetic(view.world, frames=view.frame + 1).open().load(view.frame)
    disparity = Census(quality="fast").load()(frame)
    settings = Reproject(max_range_m=view.max_range_m, max_sigma_rel=SURE_REL)
    cloud = settings.load()(frame, disparity)
    near_px = float(np.nanquantile(disparity.values, 0.99))
    half = (WIDTH_PX - GAP_PX) // 2
    pair = [scaled(p, half) for p in (frame.left, disparity_picture(disparity.values, near_px))]
    gap = np.full((pair[0].shape[0], GAP_PX, 3), 255, np.uint8)
    rows = [
        np.hstack([pair[0], gap, pair[1]]),
        perspective(cloud, frame.rig.P_left, frame.size_px, view),
        from_above(cloud.transformed(left_in(frame.rig, "velodyne")), view),
    ]
    between = np.full((GAP_PX, WIDTH_PX, 3), 255, np.uint8)
    return np.vstack([rows[0], between, rows[1], between, rows[2]])


def before_and_after(view: View) -> UInt8:
    """What cleaning removes, by reason, then the cloud before (left) and after (right)."""
    frame = Synthetic(view.world, frames=view.frame + 1).open().load(view.frame)
    disparity = Census(quality="fast").load()(frame)
    cleaned = Clean().load()(frame, disparity)
    half = (WIDTH_PX - GAP_PX) // 2
    columns = []
    for found, shown in (
        (disparity, frame.left),
        (cleaned.disparity, removed_picture(frame.left, cleaned.reason)),
    ):
        cloud = Reproject(max_range_m=view.max_range_m).load()(frame, found)
        above = from_above(cloud.transformed(left_in(frame.rig, "velodyne")), view)
        seen = perspective(cloud, frame.rig.P_left, frame.size_px, view)
        columns.append([scaled(picture, half) for picture in (shown, seen, above)])
    across = [
        np.hstack([left, np.full((len(left), GAP_PX, 3), 255, np.uint8), right])
        for left, right in zip(*columns, strict=True)
    ]
    between = np.full((GAP_PX, across[0].shape[1], 3), 255, np.uint8)
    return np.vstack([across[0], between, across[1], between, across[2]])


def perspective(cloud: PointCloud, P_left: Float64, size_px: tuple[int, int], view: View) -> UInt8:
    """The cloud as a camera like the left one would see it from `view.eye_m`."""
    sine, cosine = np.sin(np.deg2rad(view.down_deg)), np.cos(np.deg2rad(view.down_deg))
    R = np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
    T_eye_left = Pose.from_rotation("eye", cloud.frame, R, -R @ np.array(view.eye_m))
    uv, depth_m = project(T_eye_left.apply(cloud.xyz.astype(np.float64)), P_left)
    far_first = np.argsort(-depth_m)
    scale = WIDTH_PX / size_px[0]
    size = WIDTH_PX, round(size_px[1] * scale)
    return drawn(uv[far_first] * scale, cloud.rgb[far_first], size, dot_px=4)


def from_above(cloud: PointCloud, view: View) -> UInt8:
    """The cloud seen from above, x to the right, y up; higher points hide lower ones."""
    near, far = view.ahead_m
    scale = WIDTH_PX / (far - near)
    low_first = np.argsort(cloud.xyz[:, 2])
    x, y, _ = cloud.xyz[low_first].T
    uv = np.stack([(x - near) * scale, (view.aside_m - y) * scale], axis=1)
    size = WIDTH_PX, round(2 * view.aside_m * scale)
    return drawn(uv, cloud.rgb[low_first], size, dot_px=5)


def drawn(uv: Float64, rgb: UInt8, size_px: tuple[int, int], *, dot_px: int) -> UInt8:
    """Squares of `dot_px` (oversampled) at `uv`, later ones over earlier ones."""
    width, height = (OVERSAMPLING * side for side in size_px)
    canvas = np.full((height, width, 3), NOTHING, np.uint8)
    at = np.rint(np.nan_to_num(uv * OVERSAMPLING, nan=-1e6)).astype(np.int64)
    offsets = np.stack(np.meshgrid(np.arange(dot_px), np.arange(dot_px)), axis=-1).reshape(-1, 2)
    dots = (at[:, None] + offsets).reshape(-1, 2)
    colours = np.repeat(rgb, len(offsets), axis=0)
    inside = ((dots >= 0) & (dots < (width, height))).all(axis=1)
    canvas[dots[inside, 1], dots[inside, 0]] = colours[inside]
    return np.asarray(cv2.resize(canvas, size_px, interpolation=cv2.INTER_AREA), np.uint8)


def scaled(picture: UInt8, width_px: int) -> UInt8:
    """The picture at another width."""
    height = round(picture.shape[0] * width_px / picture.shape[1])
    size = width_px, height
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


if __name__ == "__main__":
    main()
