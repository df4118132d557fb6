"""Scenes in every layout of Middlebury and ETH3D, made of a known scene or of real data."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from pseudolidar.formats.pictures.pfm import write_pfm
from pseudolidar.structures.disparity import DisparityMap

MOTORCYCLE_CALIB = (
    "cam0=[994.978 0 311.193; 0 994.978 254.877; 0 0 1]\n"
    "cam1=[994.978 0 342.279; 0 994.978 254.877; 0 0 1]\n"
    "doffs=31.086\nbaseline=193.001\nwidth=741\nheight=500\nndisp=70\n"
)


def motorcycle(data: Path, folder: Path) -> Path:
    """The real motorcycle in the layout of 2014."""
    source = (data / "middlebury" / "motorcycle").resolve()
    folder.mkdir(parents=True)
    (folder / "im0.png").symlink_to(source / "motorcycle_left.png")
    (folder / "im1.png").symlink_to(source / "motorcycle_right.png")
    (folder / "calib.txt").write_text(MOTORCYCLE_CALIB)
    with np.load(source / "motorcycle_disp.npz") as arrays:
        values = arrays[arrays.files[0]].astype(np.float32)
    write_pfm(folder / "disp0.pfm", DisparityMap(np.where(np.isfinite(values), values, np.nan)))
    return folder


# Rows of its halves; both have the principal point (row 254.9), as a camera must. The upper one has
# no truth in the two rows that they share.
HALVES = {"upper": (0, 256), "lower": (254, 500)}


def motorcycle_half(data: Path, folder: Path, half: str) -> Path:
    """Its `upper` or `lower` half, as a scene of its own: rows cut off leave stereo as it is."""
    source = (data / "middlebury" / "motorcycle").resolve()
    with np.load(source / "motorcycle_disp.npz") as arrays:
        values = arrays[arrays.files[0]].astype(np.float32)
    values = np.where(np.isfinite(values), values, np.float32(np.nan))
    begin, end = HALVES[half]
    if half == "upper":
        values[HALVES["lower"][0] :] = np.nan
    folder.mkdir(parents=True)
    for eye, name in (("left", "im0.png"), ("right", "im1.png")):
        picture = cv2.imread(str(source / f"motorcycle_{eye}.png"), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(folder / name), picture[begin:end])
    calib = MOTORCYCLE_CALIB.replace("254.877", f"{254.877 - begin:.3f}")
    (folder / "calib.txt").write_text(calib.replace("height=500", f"height={end - begin}"))
    write_pfm(folder / "disp0.pfm", DisparityMap(values[begin:end]))
    return folder


def steps(width: int, height: int, stored: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) texture and stored disparities in as many bands from the top as there are values."""
    rng = np.random.default_rng(4)
    texture = rng.integers(0, 256, (height, 2 * width, 3), np.uint8)
    rows = np.minimum(np.arange(height) * len(stored) // height, len(stored) - 1)
    return texture, np.tile(np.array(stored)[rows][:, None], (1, width)).astype(np.uint8)


def write_steps(folder: Path, left: str, right: str, size: tuple[int, int], px: np.ndarray) -> None:
    """A pair whose left pixel x is the right pixel x - px, px whole numbers by row."""
    width, height = size
    texture, _ = steps(width, height, (1,))
    folder.mkdir(parents=True, exist_ok=True)
    eye = texture[:, :width]
    other = np.stack([texture[y, int(px[y]) : int(px[y]) + width] for y in range(height)])
    cv2.imwrite(str(folder / left), eye)
    cv2.imwrite(str(folder / right), other)


def views(folder: Path, *, size: tuple[int, int], factor: int, dmin: str = "270\n") -> np.ndarray:
    """A scene as of 2005 and 2006; returns the true disparity, NaN where unknown."""
    _, stored = steps(*size, (30 * factor, 12 * factor, 0))
    write_steps(folder, "view1.png", "view5.png", size, stored[:, 0] // factor)
    cv2.imwrite(str(folder / "disp1.png"), stored)
    cv2.imwrite(str(folder / "disp5.png"), stored)
    (folder / "dmin.txt").write_text(dmin)
    return np.where(stored == 0, np.nan, stored / factor)


def rows(folder: Path, *, size: tuple[int, int], factor: int, kind: str = "png") -> np.ndarray:
    """A scene as of 2001 (PPM and PGM) or 2003; returns the true disparity, NaN where unknown."""
    _, stored = steps(*size, (20 * factor, 8 * factor, 0))
    colour, grey = ("png", "png") if kind == "png" else ("ppm", "pgm")
    write_steps(folder, f"im2.{colour}", f"im6.{colour}", size, stored[:, 0] // factor)
    cv2.imwrite(str(folder / f"disp2.{grey}"), stored)
    cv2.imwrite(str(folder / f"disp6.{grey}"), stored)
    return np.where(stored == 0, np.nan, stored / factor)
