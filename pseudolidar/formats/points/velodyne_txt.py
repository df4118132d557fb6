"""KITTI's Velodyne scans as text, as the unsynchronised raw data have them: x y z reflectance."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.points.ascii_table import (
    decode_table,
    encode_table,
    line_ends,
    without_blank_lines,
)
from pseudolidar.formats.points.point_file import (
    check_point_limit,
    read_point_bytes,
    refuse_other_content,
)
from pseudolidar.formats.points.velodyne_bin import scan_of_values
from pseudolidar.structures.frame import LidarScan

COLUMNS = 4
_TYPES = (np.dtype("<f4"),) * COLUMNS


def encode_velodyne_txt(scan: LidarScan) -> bytes:
    """The bytes of a scan, a line a point, with all digits; reflectance 0 where there is none."""
    reflectance = scan.reflectance
    if reflectance is None:
        reflectance = np.zeros(len(scan), np.float32)
    return encode_table([*np.ascontiguousarray(scan.xyz.T), reflectance])


def read_velodyne_txt(
    path: Path,
    *,
    timestamp_ns: int = 0,
    frame: str = "velodyne",
    limits: Limits = DEFAULT_LIMITS,
) -> LidarScan:
    """Read a scan; points that no LiDAR can have measured are left out and counted.

    Args:
        path: the file; 0 bytes are a scan without points.
        timestamp_ns: time of the scan, which the format does not hold.
        frame: frame of the points.
        limits: cap on the points.

    Raises:
        PointFileMissing: no such file.
        PointFileTruncated: the last line does not end: it may be cut.
        PointFileCorrupt: a line without four numbers, or more than 10 % of the points are not
            plausible.
        LimitError: more points than `limits.points`.
    """
    data = read_point_bytes(path)
    try:
        if data:
            refuse_other_content(data, want="Velodyne text", kinds=())
        body = without_blank_lines(data)
        count = len(line_ends(body))
        check_point_limit(count, limits)
        columns = decode_table(body, _TYPES, count)
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__
    values = np.ascontiguousarray(np.stack(columns, axis=1), np.float32)
    hint = "Is it a scan of a line a point: x y z reflectance?"
    return scan_of_values(values, path, hint=hint, timestamp_ns=timestamp_ns, frame=frame)
