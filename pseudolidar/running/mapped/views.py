"""The pictures that a scene is made of: of a folder, or both eyes of pairs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from pseudolidar.errors import CalibrationSizeMismatch, PseudolidarError, SourceEmpty, UsageError
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.running.reports.samples import photo_of
from pseudolidar.sources.names import natural_key
from pseudolidar.sources.source import FrameSource
from pseudolidar.structures.arrays import UInt8
from pseudolidar.structures.camera import Camera

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
# A model of many more views is the work of other programs.
MOST_VIEWS = 200
_DISTANCE = re.compile(r"(.+),(.+)=([0-9]*\.?[0-9]+)")


@dataclass(frozen=True, eq=False)
class Views:
    """Pictures with their cameras.

    Args:
        pictures: (H, W) or (H, W, 3) uint8, by name.
        cameras: by name; None where nobody knows them.
        pairs: names of left and right, by the frame's id; none of single pictures.
        baseline_m: between the eyes of a pair.
    """

    pictures: Mapping[str, UInt8]
    cameras: Mapping[str, Camera] | None
    pairs: Mapping[str, tuple[str, str]]
    baseline_m: float | None = None


@dataclass(frozen=True)
class CameraDistance:
    """How far two pictures were taken from one another, written `a.jpg,b.jpg=0.35`.

    Args:
        first: name of a picture.
        second: name of another.
        metres: how far.
    """

    first: str
    second: str
    metres: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `a.jpg,b.jpg=0.35`.

        Raises:
            UsageError: something else.
        """
        match = _DISTANCE.fullmatch(text)
        if match is None or not float(match[3]) > 0 or match[1] == match[2]:
            raise UsageError(
                f"{text!r}", want="two pictures and metres, as a.jpg,b.jpg=0.35", where="--distance"
            )
        return cls(match[1], match[2], float(match[3]))

    def __str__(self) -> str:
        return f"{self.first},{self.second}={self.metres:g}"


def pictures_in(folder: Path) -> list[Path]:
    """Files of pictures in a folder, in natural order."""
    found = [file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES]
    return sorted(found, key=lambda file: natural_key(file.name))


def views_of_folder(folder: Path, camera: Camera | None) -> tuple[Views, tuple[str, ...]]:
    """The pictures of a folder.

    Args:
        folder: with pictures.
        camera: of all of them; None where nobody knows it.

    Returns:
        The views, and what cannot be read.

    Raises:
        SourceEmpty: no picture, or too many.
        CalibrationSizeMismatch: the camera is of another size.
    """
    files = pictures_in(folder)
    if not 0 < len(files) <= MOST_VIEWS:
        raise SourceEmpty(
            f"{len(files)} pictures",
            want=f"2 to {MOST_VIEWS} files named {', '.join(SUFFIXES)}",
            path=folder,
        )
    pictures, bad = dict[str, UInt8](), list[str]()
    for file in files:
        try:
            pictures[file.name] = _8_bits(read_image(file).pixels)
        except PseudolidarError as error:
            bad.append(str(error))
    if camera is None:
        return Views(pictures, None, {}), tuple(bad)
    for name, picture in pictures.items():
        if picture.shape[1::-1] != camera.size_px:
            raise CalibrationSizeMismatch(
                f"{picture.shape[1]}x{picture.shape[0]} px",
                want=f"{camera.width_px}x{camera.height_px}, the camera's",
                path=folder / name,
            )
    return Views(pictures, dict.fromkeys(pictures, camera), {}), tuple(bad)


def views_of_pairs(source: FrameSource) -> Views:
    """Both eyes of every pair.

    Raises:
        SourceEmpty: too many.
        PseudolidarError: a frame that cannot be read.
    """
    if 2 * len(source.ids) > MOST_VIEWS:
        raise SourceEmpty(
            f"{len(source.ids)} pairs",
            want=f"at most {MOST_VIEWS // 2}",
            fix="Choose some with --frames 0::10, or take `map` for sequences.",
        )
    pictures, cameras = dict[str, UInt8](), dict[str, Camera]()
    pairs = dict[str, tuple[str, str]]()
    for index, name in enumerate(source.ids):
        frame = source.load(index)
        left, right = f"{name} left", f"{name} right"
        pictures[left], pictures[right] = photo_of(frame), _8_bits(frame.right)
        cameras[left], cameras[right] = frame.rig.left, frame.rig.right
        pairs[name] = left, right
    return Views(pictures, cameras, pairs, source.rig.baseline_m)


def _8_bits(pixels: np.ndarray) -> UInt8:
    return np.asarray(pixels if pixels.dtype == np.uint8 else pixels >> 8, np.uint8)
