"""Clouds and scans as columns of messages, and the types that messages have for them."""

from __future__ import annotations

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import AnyArray
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import LidarScan

OPAQUE = 255
COLOURS = ("red", "green", "blue")
ALPHA = "alpha"
# Seconds of a point from the scan's stamp.
POINT_TIME = "t_s"

NUMBERS = ("<u1", "<i1", "<u2", "<i2", "<u4", "<i4", "<f4", "<f8")
# Types that messages have no number for, and the one that holds their values (64-bit integers to
# 2^53).
WIDENED = {"bool": "<u1", "float16": "<f4", "int64": "<f8", "uint64": "<f8"}


def cloud_columns(cloud: PointCloud, *, pixels: bool = True) -> dict[str, AnyArray]:
    """The columns of a cloud; points without coordinates are left out.

    Args:
        cloud: columns x, y, z, then red, green, blue, alpha (uint8), intensity, sigma_m, u, v and
            its extra columns, as far as it has them.
        pixels: with u and v.

    Raises:
        StructureError: an extra column has the name of another.
    """
    if cloud.shape is not None:
        cloud = cloud[cloud.valid]
    columns: dict[str, AnyArray] = dict(zip("xyz", cloud.xyz.T, strict=True))
    if cloud.rgb is not None:
        columns |= dict(zip(COLOURS, cloud.rgb.T, strict=True))
        columns[ALPHA] = np.broadcast_to(np.uint8(OPAQUE), len(cloud))
    if cloud.intensity is not None:
        columns["intensity"] = cloud.intensity
    if cloud.sigma_m is not None:
        columns["sigma_m"] = cloud.sigma_m
    if pixels and cloud.uv is not None:
        columns |= dict(zip("uv", cloud.uv.T, strict=True))
    twice = columns.keys() & cloud.extra.keys()
    if twice:
        raise StructureError(
            f"extra columns {sorted(twice)}", want="other names", where="PointCloud.extra"
        )
    return columns | dict(cloud.extra)


def scan_columns(scan: LidarScan) -> dict[str, AnyArray]:
    """x, y, z, intensity (reflectance) and t_s (seconds from the scan's stamp) of a LiDAR scan."""
    columns: dict[str, AnyArray] = dict(zip("xyz", scan.xyz.T, strict=True))
    if scan.reflectance is not None:
        columns["intensity"] = scan.reflectance
    if scan.point_times_ns is not None:
        since_s = (scan.point_times_ns - scan.timestamp_ns) * 1e-9
        columns[POINT_TIME] = since_s.astype(np.float32)
    return columns


def stored_type(name: str, column: AnyArray) -> str:
    """The little-endian numpy type that a column is stored as.

    Raises:
        StructureError: it is not one number a point.
    """
    kind = column.dtype
    stored = WIDENED.get(kind.name, f"<{kind.kind}{kind.itemsize}")
    if column.ndim != 1 or stored not in NUMBERS:
        raise StructureError(
            f"{column.dtype} column of shape {column.shape}",
            want="one number a point",
            where=f"PointCloud.extra[{name!r}]",
        )
    return stored
