"""Disparity or depth that somebody else made, read from files in place of a matcher."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

import numpy as np

from pseudolidar.errors import (
    ImageMissing,
    MapEmpty,
    MapScale,
    PseudolidarError,
    SourceEmpty,
    StructureError,
    UsageError,
)
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.map_pixels import READERS, MapPixels, read_map_pixels
from pseudolidar.formats.text import NUMBER
from pseudolidar.geometry.triangulation import disparity_from_depth, measured_disparity
from pseudolidar.structures.arrays import Float32
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame

MapKind = Literal["disparity", "depth"]
UNITS: dict[MapKind, str] = {"disparity": "px", "depth": "m"}
# Steps of 16-bit PNG: KITTI's of both kinds.
PNG_STEPS = 256.0
_NUMBERS = re.compile(r"[0-9]+")


@dataclass(frozen=True)
class StoredSteps:
    """Steps of stored numbers a pixel of disparity or a metre of depth, `auto` or a number.

    KITTI's PNG have 256, OpenCV's disparities 16, millimetres 1000, TUM's depth 5000. `auto` is
    256 for PNG and 1 for numbers with a decimal point.

    Args:
        steps: how many, None for `auto`.
    """

    steps: float | None = None

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `auto`, `256`, `0.001`.

        Raises:
            UsageError: neither `auto` nor a number above 0.
        """
        if text == "auto":
            return cls()
        if not NUMBER.fullmatch(text) or not 0 < float(text) < np.inf:
            raise UsageError(f"{text!r}", want="auto, or a number above 0 such as 256, 16 or 1000")
        return cls(float(text))

    def __str__(self) -> str:
        return "auto" if self.steps is None else f"{self.steps:g}"


@dataclass(frozen=True)
class GivenMaps:
    """Reads the map of a frame: a `StereoMatcher` whose work was done before.

    Args:
        files: map by frame id.
        place: where they are, for errors.
        kind: what they hold.
        stored: steps of stored numbers.
        sigma_px: error (68 %) of the disparities; unknown where None.
        limits: caps on the files.
    """

    files: Mapping[str, Path]
    place: Path
    kind: MapKind
    stored: StoredSteps
    sigma_px: float | None = None
    limits: Limits = DEFAULT_LIMITS

    @classmethod
    def of(
        cls,
        place: Path,
        ids: Sequence[str],
        *,
        kind: MapKind,
        stored: StoredSteps,
        sigma_px: float | None = None,
    ) -> GivenMaps:
        """The maps of a folder for the frames `ids`, by name; or one file for one frame.

        Raises:
            SourceEmpty: no map, or none that belongs to a frame.
            UsageError: a sigma that is none.
        """
        if sigma_px is not None and not 0 <= sigma_px < np.inf:
            raise UsageError(f"sigma_px {sigma_px:g}", want="0 or more", where="--sigma-px")
        return cls(files_of(place, ids), place, kind, stored, sigma_px)

    def __call__(self, frame: StereoFrame) -> DisparityMap:
        """The disparity that the rig would have measured.

        Given disparities are the rig's: its correction is taken off later, as of a matcher's.
        Given depth is true: the correction is put on here, so that taking it off gives that depth.

        Raises:
            ImageMissing: the frame has no map.
            ImageFormat, ImageUnreadable, ImageTruncated, LimitError: as the reader says.
            StructureError: the map has another size than the picture.
            MapScale: integers whose unit nobody knows.
            MapEmpty: no pixel has a value.
        """
        stored = self.read(frame)
        values = self.disparities(frame, stored, self.steps(stored, self.path_of(frame)))
        sigma = None
        if self.sigma_px is not None:
            sigma = np.where(np.isfinite(values), np.float32(self.sigma_px), np.float32(np.nan))
        return DisparityMap(values, sigma)

    def path_of(self, frame: StereoFrame) -> Path:
        """File of a frame.

        Raises:
            ImageMissing: it has none.
        """
        if frame.id not in self.files:
            raise ImageMissing(
                f"no {self.kind} map of frame {frame.id}",
                want=f"a file named {frame.id} with one of {', '.join(READERS)}",
                path=self.place,
                where=f"frame {frame.id}",
            )
        return self.files[frame.id]

    def read(self, frame: StereoFrame) -> MapPixels:
        """The map of a frame as it is stored; raises as a call does."""
        path = self.path_of(frame)
        stored = read_map_pixels(path, limits=self.limits)
        if stored.values.shape != frame.left.shape[:2]:
            height, width = stored.values.shape
            raise StructureError(
                f"a map of {width}x{height}",
                want=f"{frame.size_px[0]}x{frame.size_px[1]}, the picture's size",
                fix="Disparities of resized pictures have another unit: make them at full size.",
                where=f"{path}",
            )
        if not np.isfinite(stored.values).any():
            raise MapEmpty(f"no pixel has a {self.kind}", want="at least one", path=path)
        return stored

    def steps(self, stored: MapPixels, path: Path) -> float:
        """Steps of stored numbers a pixel or a metre.

        Raises:
            MapScale: integers of a format that says nothing about their unit.
        """
        if self.stored.steps is not None:
            return self.stored.steps
        if not stored.whole:
            return 1.0
        if path.suffix.lower() == ".png":
            return PNG_STEPS
        largest = float(np.nanmax(stored.values))
        raise MapScale(
            f"whole numbers up to {largest:g}, in a unit that the file does not say",
            want=f"{UNITS[self.kind]} as numbers with a decimal point",
            fix="Say how many steps they have: --map-scale 16 (OpenCV), 256, 1000 (mm) or 1.",
            path=path,
        )

    def disparities(self, frame: StereoFrame, stored: MapPixels, steps: float) -> Float32:
        """(H, W) px of stored numbers read with `steps`, NaN where there is none."""
        values = stored.values / np.float32(steps)
        if self.kind == "disparity":
            return values
        height, width = values.shape
        u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
        true_px = disparity_from_depth(values.astype(np.float64), u, frame.rig)
        return measured_disparity(true_px, u, v, frame.rig).astype(np.float32)


def files_of(place: Path, ids: Sequence[str]) -> dict[str, Path]:
    """Map by frame id: equal names, else equal numbers in the names; never by position.

    Raises:
        SourceEmpty: no map, or none that belongs to a frame.
    """
    if place.is_file() and len(ids) == 1:
        return {ids[0]: place}
    try:
        listed = sorted(place.iterdir()) if place.is_dir() else []
    except OSError:
        listed = []
    maps = {file.stem: file for file in listed if file.suffix.lower() in READERS}
    if not maps:
        raise SourceEmpty(
            "no map" if place.exists() else "no such folder",
            want=f"a folder with {', '.join(READERS)} files named as the frames",
            path=place,
        )
    found = {name: maps[name] for name in ids if name in maps}
    if not found:
        found = _by_numbers(maps, ids)
    if not found:
        raise SourceEmpty(
            f"{len(maps)} maps such as {next(iter(maps.values())).name}, none of a frame",
            want=f"names as those of the frames, such as {ids[0]}" if ids else "frames",
            fix="Rename them: they are never paired by position.",
            path=place,
        )
    return found


def _by_numbers(maps: Mapping[str, Path], ids: Sequence[str]) -> dict[str, Path]:
    """By the numbers in the names, where all names have some and no two have the same."""
    of_maps = {_numbers(stem): file for stem, file in maps.items()}
    of_ids = {_numbers(name): name for name in ids}
    distinct = len(of_maps) == len(maps) and len(of_ids) == len(ids)
    if not distinct or () in of_maps or () in of_ids:
        return {}
    return {name: of_maps[key] for key, name in of_ids.items() if key in of_maps}


def _numbers(name: str) -> tuple[int, ...]:
    return tuple(int(part) for part in _NUMBERS.findall(name))


def readable(maps: GivenMaps, frame: StereoFrame) -> MapPixels | None:
    """The map of a frame, None where it cannot be read: its frame is refused in its turn."""
    try:
        return maps.read(frame)
    except PseudolidarError:
        return None
