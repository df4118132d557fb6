"""KITTI's Velodyne `.bin`: x, y, z, reflectance as little-endian float32, nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.errors import (
    PointFileCorrupt,
    PointFileMissing,
    PointFileTruncated,
    PseudolidarError,
    StructureError,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.points.point_file import (
    CloudFacts,
    check_point_limit,
    read_point_bytes,
    refuse_other_content,
)
from pseudolidar.structures.arrays import AnyArray, Bool, Float32
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import LidarScan

POINT_BYTES = 16
# Records of other tools that add a value, such as the ring (nuScenes).
_LARGER_RECORD_BYTES = 20
# A coordinate beyond is no LiDAR's: the catalogue of faults, row 31.
LARGEST_COORDINATE_M = 1e4
# More implausible points than this share: the file is something else (row 31).
LARGEST_DROPPED_SHARE = 0.1
# Reflectance of points that have none, as the pseudo-LiDAR write-up sets it.
UNKNOWN_REFLECTANCE = 1.0


def write_velodyne_bin(path: Path, points: PointCloud | LidarScan) -> None:
    """Write points in a frame with x forward.

    Raises:
        StructureError: the points are in a camera's optical frame.
        OutputError: the file cannot be written.
    """
    write_atomic(path, encode_velodyne_bin(points))


def read_velodyne_bin(
    path: Path,
    *,
    timestamp_ns: int = 0,
    frame: str = "velodyne",
    record_bytes: int = POINT_BYTES,
    salvage: bool = False,
    limits: Limits = DEFAULT_LIMITS,
) -> LidarScan:
    """Read a scan; points that no LiDAR can have measured are left out and counted.

    Args:
        path: the file; 0 bytes are a scan without points.
        timestamp_ns: time of the scan, which the format does not hold.
        frame: frame of the points.
        record_bytes: bytes of a point where values follow the four, which are not read.
        salvage: leave out a fraction of a point at the end, instead of refusing the file.
        limits: cap on the points.

    Raises:
        PointFileMissing: no such file.
        PointFileTruncated: the length is no multiple of a record.
        PointFileCorrupt: more than 10 % of the points are not plausible.
        LimitError: more points than `limits.points`.
    """
    try:
        data = read_point_bytes(path)
        if salvage:
            data = data[: len(data) - len(data) % max(1, record_bytes)]
        values = _values(data, record_bytes, limits)
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__
    hint = "Is it a Velodyne file of 16 bytes a point? " + _record_hint(len(values) * 16)
    return scan_of_values(values, path, hint=hint, timestamp_ns=timestamp_ns, frame=frame)


def scan_of_values(
    values: Float32, path: Path, *, hint: str, timestamp_ns: int, frame: str
) -> LidarScan:
    """The scan in x, y, z and reflectance as a file has them, without what no LiDAR can measure.

    Args:
        values: (N, 4).
        path: the file, for errors.
        hint: what to do where it holds something else.
        timestamp_ns: time of the scan.
        frame: frame of the points.

    Raises:
        PointFileCorrupt: more than 10 % of the points are not plausible.
    """
    good = _plausible(values[:, :3]) & np.isfinite(values[:, 3])
    dropped = len(values) - int(np.count_nonzero(good))
    if dropped > LARGEST_DROPPED_SHARE * len(values):
        raise PointFileCorrupt(
            f"{dropped} of {len(values)} points not finite or beyond {LARGEST_COORDINATE_M:g} m",
            want=f"at most {LARGEST_DROPPED_SHARE:.0%}",
            fix=hint,
            path=path,
        )
    if dropped:
        values = _rows(values, good)
    xyz, reflectance = values[:, :3].copy(), values[:, 3].copy()
    return LidarScan(xyz, reflectance, timestamp_ns, frame, dropped=dropped)


def velodyne_bin_facts(path: Path) -> CloudFacts:
    """What the size of a `.bin` says: it has no header.

    Raises:
        PointFileMissing: no such file.
        PointFileTruncated: a fraction of a point.
    """
    try:
        size = path.stat().st_size
    except OSError as error:
        raise PointFileMissing(error.strerror or str(error), want="a .bin", path=path) from error
    if size % POINT_BYTES:
        raise _no_whole_points(size, POINT_BYTES).located(path)
    columns = tuple((name, "float32") for name in ("x", "y", "z", "intensity"))
    return CloudFacts(size // POINT_BYTES, columns, "binary", "velodyne")


def encode_velodyne_bin(points: PointCloud | LidarScan) -> bytes:
    """The bytes of a `.bin`.

    Left out: points that are not finite or beyond 10 km and, of a stereo cloud, those with x < 0,
    which it cannot have seen. A scan keeps its whole turn. Reflectance is the intensity
    (grey / 255), or 1 where there is none. Other columns, frame and time are lost.

    Raises:
        StructureError: the points are in a camera's optical frame.
    """
    if points.frame.startswith("cam") or points.frame.endswith("optical"):
        raise StructureError(
            f"points in frame {points.frame!r}, where z is forward",
            want="a frame with x forward, y left, z up",
            fix="Transform them to 'velodyne' or 'base_link' first.",
            where="encode_velodyne_bin",
        )
    if isinstance(points, LidarScan):
        brightness, good = points.reflectance, _plausible(points.xyz)
    else:
        brightness, good = points.intensity, _plausible(points.xyz) & (points.xyz[:, 0] >= 0)
    records = np.empty((len(points), 4), "<f4")
    records[:, :3] = points.xyz
    records[:, 3] = UNKNOWN_REFLECTANCE if brightness is None else brightness
    if not good.all():
        records = _rows(records, good)
    np.nan_to_num(records[:, 3], copy=False, nan=UNKNOWN_REFLECTANCE)
    return records.tobytes()


def _plausible(xyz: AnyArray) -> Bool:
    """(N,) points that are finite (a comparison with NaN fails) and near enough."""
    near = np.abs(xyz) <= LARGEST_COORDINATE_M
    return np.asarray(near[:, 0] & near[:, 1] & near[:, 2])


def _rows(values: Float32, good: Bool) -> Float32:
    """The good rows; by their positions, which is ten times faster than by the mask."""
    return values.take(np.flatnonzero(good), axis=0)


def _values(data: bytes, record_bytes: int, limits: Limits) -> Float32:
    """(N, 4) float32."""
    if data:
        refuse_other_content(data, want="Velodyne", kinds=())
    if record_bytes < POINT_BYTES or record_bytes % 4:
        raise StructureError(
            f"records of {record_bytes} bytes", want="16 or more, a multiple of 4", where=".bin"
        )
    count, rest = divmod(len(data), record_bytes)
    if rest:
        raise _no_whole_points(len(data), record_bytes)
    check_point_limit(count, limits)
    return np.frombuffer(data, "<f4").reshape(count, record_bytes // 4)[:, :4]


def _no_whole_points(size: int, record_bytes: int) -> PointFileTruncated:
    count, rest = divmod(size, record_bytes)
    return PointFileTruncated(
        f"{size} bytes: {count} points and {rest} bytes",
        want=f"a multiple of {record_bytes}",
        fix="Copy the file again. " + _record_hint(size),
        where=f"byte {count * record_bytes}",
    )


def _record_hint(size: int) -> str:
    if size % _LARGER_RECORD_BYTES:
        return ""
    return f"Its length fits records of {_LARGER_RECORD_BYTES} bytes: try --record-size 20."
