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
# Top view: 80 m ahead and 40 m to each side in squares of 0.5 m.
TOP_AHEAD_M, TOP_ASIDE_M, TOP_SQUARE_M = 80.0, 40.0, 0.5

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
        top: (160, 160) uint16 points in each square of 0.5 m: rows from far (80 m) to near,
            columns from left (40 m) to right.
    """

    photo: UInt8
    disparity: Float16
    truth: Float16
    removed: UInt8
    top: UInt16

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
        return cls(small, disparities, true, gone, top_view(forward_cloud))

    def encode(self) -> bytes:
        """The sample as the bytes of an NPZ; the same bytes for the same sample."""
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **asdict(self))
        return buffer.getvalue()

    @classmethod
    def read(cls, path: Path) -> Self:
        """A sample that `encode` has made."""
        with np.load(path) as arrays:
            return cls(**{name: arrays[name] for name in cls.__dataclass_fields__})


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


def top_view(cloud: PointCloud) -> UInt16:
    """(160, 160) points in each square, seen from above; see `FrameSample`."""
    x_m, y_m = cloud.xyz[:, 0], cloud.xyz[:, 1]
    near = (x_m >= 0) & (x_m < TOP_AHEAD_M) & (np.abs(y_m) < TOP_ASIDE_M)  # False for NaN
    rows = ((TOP_AHEAD_M - x_m[near]) / TOP_SQUARE_M).astype(np.int64)
    columns = ((TOP_ASIDE_M - y_m[near]) / TOP_SQUARE_M).astype(np.int64)
    height, width = round(TOP_AHEAD_M / TOP_SQUARE_M), round(2 * TOP_ASIDE_M / TOP_SQUARE_M)
    squares = np.minimum(rows, height - 1) * width + np.minimum(columns, width - 1)
    counts = np.bincount(squares, minlength=height * width).reshape(height, width)
    return np.minimum(counts, np.iinfo(np.uint16).max).astype(np.uint16)


def sampled_frames(ids: Sequence[str]) -> frozenset[str]:
    """The frames of a source that are sampled: at most 12, first and last among them."""
    count = min(MAX_SAMPLES, len(ids))
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
