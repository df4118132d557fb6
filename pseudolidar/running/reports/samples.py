"""Small pictures of a few frames, kept with the outputs so that a report can always be made.

As many as fit on a page, spread evenly over the sequence, however long that is; committed like any
other file of a frame, so a continued run has them all.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

import numpy as np
import numpy.typing as npt

from pseudolidar.geometry.grey import shift_to_8_bits
from pseudolidar.running.folder import inside
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.structures.arrays import Image, UInt8
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import DepthFrame, Frame, RecordedCloud

SAMPLES_FOLDER = ".report"
MAX_SAMPLES = 12
# Longest side of a sample's picture, px: a third of a wide screen.
MAX_SIDE_PX = 640
# Top view: as far ahead as the smallest of these that holds this share of the points ahead, half of
# it to each side, in so many squares each way.
TOP_REACHES_M = (2.5, 5.0, 10.0, 20.0, 40.0, 80.0)
TOP_SHARE, TOP_SQUARES = 0.99, 160

Float16 = npt.NDArray[np.float16]
UInt16 = npt.NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class FrameSample:
    """A frame in small.

    Args:
        photo: (h, w, 3) or (h, w) uint8, the left image; (0, 0) where there is none.
        disparity: (h, w) float16 px of the full-size image, NaN where there is none.
        truth: (h, w) float16 px, ground truth; NaN everywhere where there is none.
        removed: (h, w) uint8 why cleaning removed a pixel, 0 where it did not.
        top: (160, 160) uint16 points in each square: rows from far (`ahead_m`) to near, columns
            from left (half of it) to right.
        ahead_m: how far the view from above reaches.
    """

    photo: UInt8
    disparity: Float16
    truth: Float16
    removed: UInt8
    top: UInt16
    ahead_m: float = TOP_REACHES_M[-1]

    @classmethod
    def of(
        cls,
        frame: Frame,
        disparity: DisparityMap | None,
        forward_cloud: PointCloud,
        *,
        removed: UInt8 | None = None,
    ) -> Self:
        """Reduced by taking every n-th pixel: nothing is smeared, nothing invented.

        Args:
            frame: the frame.
            disparity: of its left image, where it is a pair.
            forward_cloud: points in a frame with x forward, y left.
            removed: (H, W) why a pixel of the left image was removed.
        """
        photo = photo_of(frame)
        unknown = np.full(photo.shape[:2], np.nan, np.float32)
        truth = frame.truth if isinstance(frame, StereoFrame) else None
        step = max(1, -(-max(photo.shape) // MAX_SIDE_PX))
        disparities, true = (
            np.ascontiguousarray((unknown if m is None else m.values)[::step, ::step], np.float16)
            for m in (disparity, truth)
        )
        small = np.ascontiguousarray(photo[::step, ::step])
        whole = np.zeros(photo.shape[:2], np.uint8) if removed is None else removed
        gone = np.ascontiguousarray(whole[::step, ::step])
        ahead_m = top_reach_m(forward_cloud)
        return cls(small, disparities, true, gone, top_view(forward_cloud, ahead_m), ahead_m)

    def encode(self) -> bytes:
        """The sample as the bytes of an NPZ; the same bytes for the same sample."""
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **asdict(self))
        return buffer.getvalue()

    @classmethod
    def read(cls, path: Path) -> Self:
        """A sample that `encode` has made."""
        with np.load(path) as arrays:
            found = {name: arrays[name] for name in cls.__dataclass_fields__ if name in arrays}
        ahead_m = float(found.pop("ahead_m", TOP_REACHES_M[-1]))  # earlier runs had one reach
        return cls(**found, ahead_m=ahead_m)


def photo_of(frame: Frame) -> UInt8:
    """The left or only image in 8 bits, (0, 0) where there is none."""
    images: tuple[Image, ...]
    match frame:
        case StereoFrame():
            images = (frame.left, frame.right)
        case DepthFrame():
            images = (frame.image,)
        case RecordedCloud():
            return np.empty((0, 0), np.uint8)
    if images[0].dtype == np.uint8:
        return np.asarray(images[0], np.uint8)
    return (images[0] >> shift_to_8_bits(*images)).astype(np.uint8)


def top_reach_m(cloud: PointCloud) -> float:
    """How far the view from above reaches, so that a room fills it as well as a street does."""
    x_m, y_m = cloud.xyz[:, 0], np.abs(cloud.xyz[:, 1])
    needed_m = np.maximum(x_m, 2 * y_m)[x_m >= 0]
    for reach_m in TOP_REACHES_M[:-1]:
        if len(needed_m) and np.mean(needed_m < reach_m) >= TOP_SHARE:
            return reach_m
    return TOP_REACHES_M[-1]


def top_view(cloud: PointCloud, ahead_m: float) -> UInt16:
    """(160, 160) points in each square, seen from above; see `FrameSample`."""
    x_m, y_m = cloud.xyz[:, 0], cloud.xyz[:, 1]
    aside_m, square_m, count = ahead_m / 2, ahead_m / TOP_SQUARES, TOP_SQUARES
    near = (x_m >= 0) & (x_m < ahead_m) & (np.abs(y_m) < aside_m)  # False for NaN
    rows = ((ahead_m - x_m[near]) / square_m).astype(np.int64)
    columns = ((aside_m - y_m[near]) / square_m).astype(np.int64)
    squares = np.minimum(rows, count - 1) * count + np.minimum(columns, count - 1)
    counts = np.bincount(squares, minlength=count * count).reshape(count, count)
    return np.minimum(counts, np.iinfo(np.uint16).max).astype(np.uint16)


def sampled_frames(ids: Sequence[str], most: int = MAX_SAMPLES) -> frozenset[str]:
    """The frames of a source that are sampled: at most so many, first and last among them."""
    count = min(most, len(ids))
    return (
        frozenset(ids[round(i)] for i in np.linspace(0, len(ids) - 1, count))
        if ids
        else frozenset()
    )


def sample_name(frame_id: str) -> str:
    """Name of a sample in the output folder."""
    return f"{SAMPLES_FOLDER}/{frame_id}.npz"


def read_samples(folder: Path, records: Iterable[FrameRecord]) -> dict[str, FrameSample]:
    """The samples that a run has left, by frame id, in order of the source."""
    names = {record.id: sample_name(record.id) for record in records}
    paths = {frame_id: inside(folder, name) for frame_id, name in names.items()}
    return {frame_id: FrameSample.read(path) for frame_id, path in paths.items() if path.exists()}
