"""A converted frame as the bytes of its files and of its part of the recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from pseudolidar.errors import NoPairs, StructureError
from pseudolidar.formats.mcap.content import McapContent
from pseudolidar.formats.pictures.depth_png import encode_depth_png
from pseudolidar.formats.pictures.disparity_png import encode_disparity_png
from pseudolidar.formats.points.npz import encode_npz
from pseudolidar.formats.points.pcd import encode_pcd
from pseudolidar.formats.points.ply import encode_ply
from pseudolidar.formats.points.velodyne_bin import LARGEST_COORDINATE_M, encode_velodyne_bin
from pseudolidar.running.journal.record import OutputFile
from pseudolidar.running.live.newest import Newest
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.products.outputs import Outputs, file_name
from pseudolidar.running.products.preview import PreviewArtist, preview_name
from pseudolidar.running.products.product import Product
from pseudolidar.running.products.trees import Trees
from pseudolidar.running.reports.samples import FrameSample, sample_name
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DepthMap, DisparityMap
from pseudolidar.structures.frame import LidarScan
from pseudolidar.structures.recorded import RecordedCloud

if TYPE_CHECKING:
    from pseudolidar.formats.mcap.frame import FramePart

# Bins of the depth histogram, m; the last one holds all beyond.
DEPTH_BIN_M, DEPTH_BINS = 10.0, 9
# The median of sigma is that of every n-th point: sorting all of them takes longer than it tells.
SIGMA_STEP = 16

KnownMap = TypeVar("KnownMap", DisparityMap, DepthMap)


ENCODERS: Mapping[str, Callable[[Converted], bytes]] = {
    "pcd": lambda converted: encode_pcd(converted.cloud),
    "pcd:compressed": lambda converted: encode_pcd(converted.cloud, encoding="binary_compressed"),
    "pcd:ascii": lambda converted: encode_pcd(converted.cloud, encoding="ascii"),
    "ply": lambda converted: encode_ply(converted.cloud),
    "ply:ascii": lambda converted: encode_ply(converted.cloud, encoding="ascii"),
    "bin": lambda converted: encode_velodyne_bin(_scan_points(converted)),
    "npz": lambda converted: encode_npz(converted.cloud),
    "disparity": lambda converted: encode_disparity_png(
        _known(converted, converted.disparity, "disparity")
    ),
    "depth": lambda converted: encode_depth_png(_known(converted, converted.depth, "depth")),
}


@dataclass(frozen=True)
class FrameEncoder:
    """Encodes everything that will be written of a frame: pure, picklable where nobody looks on.

    Args:
        outputs: which files, and whether a recording.
        content: what the recording holds.
        trees: layouts of other tools.
        sampled: ids of the frames that the report shows.
        artist: draws frames for the preview, where there is to be one.
        onlookers: are shown each frame that was encoded.
    """

    outputs: Outputs
    content: McapContent
    trees: Trees
    sampled: frozenset[str]
    artist: PreviewArtist | None = None
    onlookers: tuple[Newest[Converted], ...] = ()

    def __call__(self, converted: Converted) -> Product:
        """Bytes of files and of the recording's parts, and figures for the report."""
        frame = converted.frame
        files = [
            OutputFile.of(file_name(kind, frame.id), ENCODERS[kind](converted))
            for kind in self.outputs.files
        ]
        files += self.trees.files(frame, converted.cloud)
        if frame.id in self.sampled:
            sample = FrameSample.of(
                frame, converted.disparity, converted.forward_cloud, removed=converted.removed
            )
            files.append(OutputFile.of(sample_name(frame.id), sample.encode()))
        if self.artist is not None:
            files.append(OutputFile.of(preview_name(frame.id), self.artist.draw(converted)))
        parts = packed(converted, self.content) if self.outputs.recording else {}
        notes = losses_in_bin(converted) if "bin" in self.outputs.files else ()
        product = Product(tuple(files), parts, figures(converted, notes))
        for onlooker in self.onlookers:
            onlooker.show(frame.index, converted)
        return product


def packed(converted: Converted, content: McapContent) -> dict[str, FramePart]:
    """The frame's parts of the recording, by the ending of the file's name."""
    from pseudolidar.formats.mcap.frame import pack_frame
    from pseudolidar.formats.mcap.messages import frame_messages
    from pseudolidar.formats.mcap.split import split_messages

    frame = converted.frame
    messages = frame_messages(
        frame,
        disparity=converted.disparity,
        depth=converted.depth,
        cloud=converted.cloud,
        content=content,
    )
    return {
        ending: pack_frame(part, index=frame.index, compression=content.compression)
        for ending, part in split_messages(messages, content.split).items()
    }


def _scan_points(converted: Converted) -> PointCloud | LidarScan:
    """What a `.bin` is made of: of a stereo cloud what is ahead, of a ready-made one all points.

    Raises:
        StructureError: not one point is near enough for the format.
    """
    cloud = converted.forward_cloud
    if not isinstance(converted.frame, RecordedCloud):
        return cloud
    reflectance = cloud.intensity
    if reflectance is None and "intensity" in cloud.extra:
        reflectance = cloud.extra["intensity"].astype(np.float32)
    near = (np.abs(cloud.xyz) <= LARGEST_COORDINATE_M).all(axis=1)  # False for NaN
    if cloud.valid.any() and not near.any():
        raise StructureError(
            f"{len(cloud)} points, each beyond {LARGEST_COORDINATE_M:g} m",
            want="coordinates of a sensor",
            fix="Write ply or npz: they keep coordinates of maps (float64).",
            where=f"frame {converted.frame.id}, .bin",
        )
    return LidarScan(cloud.xyz.astype(np.float32, copy=False), reflectance)


def losses_in_bin(converted: Converted) -> tuple[str, ...]:
    """What a `.bin` of a ready-made cloud cannot hold, for the report."""
    if not isinstance(converted.frame, RecordedCloud):
        return ()
    cloud = converted.cloud
    own = ("rgb", "sigma_m", "uv")
    lost = [name for name in own if getattr(cloud, name) is not None]
    lost += [name for name in cloud.extra if name != "intensity" or cloud.intensity is not None]
    notes = [f".bin without the columns {', '.join(lost)}"] if lost else []
    if cloud.xyz.dtype == np.float64:
        notes.append(".bin with coordinates rounded to float32")
    far = np.count_nonzero(cloud.valid & (np.abs(cloud.xyz) > LARGEST_COORDINATE_M).any(axis=1))
    if far:
        notes.append(f".bin without {far} points beyond {LARGEST_COORDINATE_M:g} m")
    return tuple(notes)


def figures(converted: Converted, notes: Sequence[str] = ()) -> dict[str, Any]:
    """Statistics of a frame for the report, plain JSON values; `notes` besides the frame's own."""
    cloud = converted.cloud
    found: dict[str, Any] = {
        "points": len(cloud) if cloud.shape is None else int(np.count_nonzero(cloud.valid)),
        "depth_histogram": _histogram(converted),
        **converted.counts,
    }
    if converted.depth is not None:
        known = converted.depth.valid if converted.disparity is None else converted.disparity.valid
        matched = known if converted.removed is None else known | (converted.removed > 0)
        found["density"] = float(matched.mean())
        found["pixels_without_disparity"] = int(known.size - np.count_nonzero(known))
    sigma_m = None if cloud.sigma_m is None else cloud.sigma_m[::SIGMA_STEP]
    if sigma_m is not None and np.isfinite(sigma_m).any():
        found["sigma_m_median"] = float(np.nanmedian(sigma_m))
    if converted.frame.notes or notes:
        found["notes"] = [*converted.frame.notes, *notes]
    return found


def _histogram(converted: Converted) -> list[int]:
    """Pixels by depth, of a frame without pictures points by distance ahead."""
    if converted.depth is not None:
        depths = converted.depth.values[converted.depth.valid]
    else:
        ahead_m = converted.forward_cloud.xyz[:, 0]
        depths = ahead_m[ahead_m > 0].astype(np.float32)  # False for NaN
    bins = np.minimum(depths / np.float32(DEPTH_BIN_M), DEPTH_BINS - 1).astype(np.uint8)
    counts: list[int] = np.bincount(bins, minlength=DEPTH_BINS).tolist()
    return counts


def _known(converted: Converted, values: KnownMap | None, name: str) -> KnownMap:
    """A map of the frame.

    Raises:
        NoPairs: the frame is of a kind that has none.
    """
    if values is None:
        raise NoPairs(
            f"a frame without one {name} map",
            want=f"pairs of pictures, in one view each, for --to {name}",
            fix=f"Leave {name} out of --to, and --rectify.views if it is there.",
            where=f"frame {converted.frame.id}",
        )
    return values
