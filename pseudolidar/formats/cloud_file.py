"""Files of ready-made clouds, whatever their format: which there are, and what reads them."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from pseudolidar.errors import PointFileMissing, PseudolidarError
from pseudolidar.formats import pcd_header, ply_header
from pseudolidar.formats.columns import Notes
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.npz import read_npz, read_npz_time
from pseudolidar.formats.pcd import read_pcd
from pseudolidar.formats.ply import read_ply
from pseudolidar.formats.point_file import MAX_HEADER_BYTES
from pseudolidar.formats.velodyne_bin import read_velodyne_bin
from pseudolidar.structures.cloud import PointCloud


class CloudReader(Protocol):
    """Reads a cloud from a file; raises a `PseudolidarError` that names it."""

    def __call__(self, path: Path, *, limits: Limits) -> PointCloud:
        """The cloud in the file."""


@dataclass(frozen=True)
class CloudFormat:
    """A format of cloud files.

    Args:
        name: for people.
        read: file to cloud.
        time_ns: the time that a file notes, read without its points; 0 where it notes none.
    """

    name: str
    read: CloudReader
    time_ns: Callable[[Path], int]


def read_cloud(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> PointCloud:
    """Read a cloud with all its columns, by the extension of its file.

    Raises:
        PointFileMissing: no such file, or no format of that extension.
        PseudolidarError: what the reader of the format raises.
    """
    return format_of(path).read(path, limits=limits)


def format_of(path: Path) -> CloudFormat:
    """The format that a file's extension names.

    Raises:
        PointFileMissing: none.
    """
    known = FORMATS.get(path.suffix.lower())
    if known is None:
        raise PointFileMissing(
            f"a file named {path.suffix or 'without extension'}",
            want=", ".join(FORMATS),
            path=path,
        )
    return known


def _read_bin(path: Path, *, limits: Limits) -> PointCloud:
    """A Velodyne scan as a cloud: x forward; reflectances beyond 0-1 are an extra column."""
    scan = read_velodyne_bin(path, limits=limits)
    cloud = PointCloud(scan.xyz, scan.frame)
    if scan.reflectance is None:
        return cloud
    if np.any(np.abs(scan.reflectance - 0.5) > 0.5):
        return replace(cloud, extra={"intensity": scan.reflectance})
    return replace(cloud, intensity=scan.reflectance)


def _header_time(parse: Callable[[bytes], Notes]) -> Callable[[Path], int]:
    def time_ns(path: Path) -> int:
        try:
            with path.open("rb") as file:
                return parse(file.read(MAX_HEADER_BYTES)).timestamp_ns
        except OSError as error:
            raise PointFileMissing(
                error.strerror or str(error), want="a readable point file", path=path
            ) from error
        except PseudolidarError as error:
            raise error.located(path) from error.__cause__

    return time_ns


def _holds_points(path: Path) -> bool:
    """Whether an archive has points; many tools keep other things in archives."""
    try:
        with zipfile.ZipFile(path) as archive:
            return "xyz.npy" in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def is_cloud_file(path: Path) -> bool:
    """Whether a file is one of clouds: by its extension, archives by what they hold."""
    suffix = path.suffix.lower()
    return suffix in FORMATS and (suffix != ".npz" or _holds_points(path))


# The one that keeps most first: of files that differ by extension only, the first is read.
FORMATS: Mapping[str, CloudFormat] = {
    ".npz": CloudFormat("NPZ", read_npz, read_npz_time),
    ".pcd": CloudFormat("PCD", read_pcd, _header_time(lambda d: pcd_header.parse_header(d).notes)),
    ".ply": CloudFormat("PLY", read_ply, _header_time(lambda d: ply_header.parse_header(d).notes)),
    ".bin": CloudFormat("Velodyne .bin", _read_bin, lambda _: 0),
}
