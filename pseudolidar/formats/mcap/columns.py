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
# 2^53: see `LOW_BITS`).
WIDENED = {"bool": "<u1", "float16": "<f4", "int64": "<f8", "uint64": "<f8"}
# Larger integers, such as times in ns, are rounded there; a column of this name holds what was
# lost: their last 32 bits.
LOW_BITS = ".low32"
EXACT_TO = 2**53


def cloud_columns(
    cloud: PointCloud, *, pixels: bool = True, holes: bool = False, exact: bool = True
) -> dict[str, AnyArray]:
    """The columns of a cloud.

    Args:
        cloud: columns x, y, z, then red, green, blue, alpha (uint8), intensity, sigma_m, u, v and
            its extra columns, as far as it has them.
        pixels: with u and v.
        holes: with the points of an organised cloud that have no coordinates.
        exact: with the last bits of integers that are too large for float64.

    Raises:
        StructureError: an extra column has the name of another.
    """
    if cloud.shape is not None and not holes:
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
    for name, column in cloud.extra.items():
        columns[name] = column
        if exact and _is_rounded(column) and name + LOW_BITS not in cloud.extra:
            columns[name + LOW_BITS] = column.astype(np.uint64).astype(np.uint32)
    return columns


def joined(rounded: AnyArray, low: AnyArray, dtype: str) -> AnyArray | None:
    """The integers that were stored as float64 and their last 32 bits; None if they disagree."""
    if rounded.dtype != np.float64 or low.dtype != np.uint32:
        return None
    with np.errstate(invalid="ignore"):
        high = np.rint((rounded - low) / 2.0**32).astype(np.int64)
        whole = ((high.astype(np.uint64) << np.uint64(32)) | low.astype(np.uint64)).astype(dtype)
    return whole if np.array_equal(whole.astype(np.float64), rounded) else None


def _is_rounded(column: AnyArray) -> bool:
    """Whether float64 loses bits of a column."""
    if column.dtype.kind not in "iu" or column.dtype.itemsize < 8:
        return False
    return bool(np.any((column > EXACT_TO) | (column < -EXACT_TO)))


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
