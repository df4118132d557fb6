"""Files of ready-made clouds, whatever their format: which there are, and what reads them."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from pseudolidar.errors import PointFileMissing, PointFileTruncated, PseudolidarError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.image_kinds import SNIFFED_BYTES, content_kind
from pseudolidar.formats.points.columns import Notes
from pseudolidar.formats.points.npz import npz_facts, read_npz, read_npz_time
from pseudolidar.formats.points.pcd import pcd_facts, pcd_header, read_pcd, salvage_pcd
from pseudolidar.formats.points.ply import ply_facts, ply_header, read_ply, salvage_ply
from pseudolidar.formats.points.point_file import (
    MAX_HEADER_BYTES,
    CloudFacts,
    Salvaged,
    read_point_bytes,
)
from pseudolidar.formats.points.velodyne_bin import (
    POINT_BYTES,
    read_velodyne_bin,
    velodyne_bin_facts,
)
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import LidarScan


class CloudReader(Protocol):
    """Reads a cloud from a file; raises a `PseudolidarError` that names it."""

    def __call__(self, path: Path, *, limits: Limits) -> PointCloud:
        """The cloud in the file."""


class CloudSalvage(Protocol):
    """Takes what is whole of a file that ends early."""

    def __call__(self, data: bytes, *, limits: Limits) -> Salvaged:
        """The whole points."""


@dataclass(frozen=True)
class CloudFormat:
    """A format of cloud files.

    Args:
        name: for people.
        read: file to cloud.
        facts: what the header of a file says.
        time_ns: the time that a file notes, read without its points; 0 where it notes none.
        salvage: bytes of a file that ends early to its whole points; None where that has none.
    """

    name: str
    read: CloudReader
    facts: Callable[[Path], CloudFacts]
    time_ns: Callable[[Path], int]
    salvage: CloudSalvage | None = None


@dataclass(frozen=True)
class CloudReading:
    """How files of clouds are read.

    Args:
        sniff: go by the content of a file, not by its extension.
        salvage: of a file that ends early take the whole points.
        record_bytes: bytes of a point of a `.bin`.
    """

    sniff: bool = False
    salvage: bool = False
    record_bytes: int = POINT_BYTES

    def format_of(self, path: Path) -> CloudFormat:
        """Format of a file.

        Raises:
            PointFileMissing: there is none, or no such file.
        """
        return (self.sniff and _format_within(path)) or format_of(path)

    def read(self, path: Path, *, limits: Limits = DEFAULT_LIMITS) -> tuple[PointCloud, list[str]]:
        """A cloud with all its columns, and what was odd about its file.

        Raises:
            PointFileMissing: no such file, or no format of that extension.
            PseudolidarError: what the reader of the format raises.
        """
        kind = self.format_of(path)
        if kind is FORMATS[".bin"]:
            return self._read_bin(path, limits)
        other = [f"read as {kind.name}"] if kind is not FORMATS.get(path.suffix.lower()) else []
        try:
            return kind.read(path, limits=limits), other
        except PointFileTruncated:
            if not self.salvage or kind.salvage is None:
                raise
        try:
            saved = kind.salvage(read_point_bytes(path), limits=limits)
        except PseudolidarError as error:
            raise error.located(path) from error.__cause__
        return saved.cloud, [*other, f"salvaged: {len(saved.cloud)} of {saved.claimed} points"]

    def _read_bin(self, path: Path, limits: Limits) -> tuple[PointCloud, list[str]]:
        size, salvage = self.record_bytes, self.salvage
        scan = read_velodyne_bin(path, record_bytes=size, salvage=salvage, limits=limits)
        rest = path.stat().st_size % size
        notes = [f"salvaged: {rest} bytes at the end left out"] if rest else []
        notes += ["empty"] if path.stat().st_size == 0 else []
        notes += [f"{scan.dropped} implausible points left out"] if scan.dropped else []
        return _cloud_of(scan), notes


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


def _format_within(path: Path) -> CloudFormat | None:
    """Format of a file by its first bytes, where they tell."""
    try:
        with path.open("rb") as file:
            start = file.read(SNIFFED_BYTES)
    except OSError:
        return None  # the reader says so better
    if start.lstrip().startswith((b"VERSION", b"# .PCD")):
        return FORMATS[".pcd"]
    return {"PLY cloud": FORMATS[".ply"], "ZIP archive": FORMATS[".npz"]}.get(content_kind(start))


def _read_bin(path: Path, *, limits: Limits) -> PointCloud:
    """A Velodyne scan as a cloud: x forward; reflectances beyond 0-1 are an extra column."""
    return _cloud_of(read_velodyne_bin(path, limits=limits))


def _cloud_of(scan: LidarScan) -> PointCloud:
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


# An archive begins with 30 bytes and the name of its first array.
_FIRST_NAME_ENDS = 30 + len("xyz.npy")


def _holds_points(path: Path) -> bool:
    """Whether an archive has points, or had them: other programs keep other things in archives."""
    try:
        with zipfile.ZipFile(path) as archive:
            return "xyz.npy" in archive.namelist()
    except OSError:
        return False
    except zipfile.BadZipFile:
        with path.open("rb") as file:  # cut before its directory
            start = file.read(SNIFFED_BYTES)
        return len(start) < _FIRST_NAME_ENDS or b"xyz.npy" in start


def is_cloud_file(path: Path) -> bool:
    """Whether a file is one of clouds: by its extension, archives by what they hold."""
    suffix = path.suffix.lower()
    return suffix in FORMATS and (suffix != ".npz" or _holds_points(path))


# The one that keeps most first: of files that differ by extension only, the first is read.
FORMATS: Mapping[str, CloudFormat] = {
    ".npz": CloudFormat("NPZ", read_npz, npz_facts, read_npz_time),
    ".pcd": CloudFormat(
        "PCD", read_pcd, pcd_facts, _header_time(lambda data: pcd_header(data).notes), salvage_pcd
    ),
    ".ply": CloudFormat(
        "PLY", read_ply, ply_facts, _header_time(lambda data: ply_header(data).notes), salvage_ply
    ),
    ".bin": CloudFormat("Velodyne .bin", _read_bin, velodyne_bin_facts, lambda _: 0),
}
