"""Scenes of Middlebury and ETH3D on the disk: what their layouts say about cameras and truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pseudolidar.errors import CalibrationField, ImageFormat, ImageMissing, StructureError
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.pictures.image import read_image, read_size
from pseudolidar.formats.pictures.pfm import read_pfm
from pseudolidar.formats.rigs.middlebury import (
    RANGE_MARGIN_PX,
    is_middlebury_calib,
    read_middlebury_calib,
)
from pseudolidar.formats.rigs.rig_reading import RigReading
from pseudolidar.formats.text import read_lines
from pseudolidar.sources.folder_layout import list_pictures
from pseudolidar.structures.arrays import Float32
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.pose import Pose

# Focal length at full size and baseline of the 2005 and 2006 data, as the data's page states them.
FOCAL_PX, BASELINE_M = 3740.0, 0.160
# Heights of the pictures of 2005 and 2006, by the factor that their disparities are stored with.
HEIGHTS_2005_PX = {1110: 1, 555: 2, 370: 3}
# Sizes of 2003 by that factor; all of 2001 has 8.
SIZES_2003_PX = {(1800, 1500): 1, (900, 750): 2, (450, 375): 4}
WIDTH_2003_PX = 1800
SCALE_2001 = 8
LARGEST_STORED = 255
# Bytes in which a calib.txt shows what it is.
SNIFFED_BYTES = 2048
# Value of the mask of pixels that both eyes see.
SEEN_BY_BOTH = 255

Layout = Literal["calib", "views", "rows"]
# Names of the left and the right picture, and what must be there too.
PICTURES: dict[Layout, tuple[str, str]] = {
    "calib": ("im0", "im1"),
    "views": ("view1", "view5"),
    "rows": ("im2", "im6"),
}
YEARS: dict[Layout, str] = {"calib": "2014, 2021 or ETH3D", "views": "2005-2006", "rows": "2001-03"}


@dataclass(frozen=True)
class Scene:
    """The files of one pair.

    Args:
        folder: where it is.
        layout: which year's.
        left: left picture.
        right: right picture.
        truth: ground-truth disparity of the left picture.
        mask: which pixels both eyes see.
    """

    folder: Path
    layout: Layout
    left: Path
    right: Path
    truth: Path | None
    mask: Path | None = None

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.folder.resolve().name


def find_scene(folder: Path, *, lighting: str) -> Scene | None:
    """The scene in `folder`, None if there is none.

    Args:
        folder: to look into.
        lighting: where the 2005 and 2006 data with all lights have the pictures to take.
    """
    pair = _pair(folder, "calib")
    if pair is not None and _has_calib(folder / "calib.txt"):
        truths = [folder, _beside(folder)]
        truth = _first(truths, "disp0GT.pfm", "disp0.pfm")
        return Scene(folder, "calib", *pair, truth, _first(truths, "mask0nocc.png"))
    pair = _pair(folder, "views") or _pair(folder / lighting, "views")
    truth = _named(folder, "disp1")
    if pair is not None and (truth is not None or (folder / "dmin.txt").is_file()):
        return Scene(folder, "views", *pair, truth)
    pair, truth = _pair(folder, "rows"), _named(folder, "disp2")
    if pair is not None and truth is not None:
        return Scene(folder, "rows", *pair, truth)
    return None


def _has_calib(path: Path) -> bool:
    """Whether there is a calibration of this kind; others are called `calib.txt`, too."""
    try:
        with path.open("rb") as file:
            return is_middlebury_calib(file.read(SNIFFED_BYTES).decode("latin-1"))
    except OSError:
        return False


def _beside(folder: Path) -> Path:
    """Where ETH3D's truth lies if it was unpacked beside the pictures."""
    place = folder.resolve()
    return place.parent.with_name(f"{place.parent.name}_gt") / place.name


def _first(folders: list[Path], *names: str) -> Path | None:
    files = (folder / name for folder in folders for name in names)
    return next((file for file in files if file.is_file()), None)


def _pair(folder: Path, layout: Layout) -> tuple[Path, Path] | None:
    left, right = (_named(folder, name) for name in PICTURES[layout])
    return None if left is None or right is None else (left, right)


def _named(folder: Path, stem: str) -> Path | None:
    return next((file for file in list_pictures(folder) if file.stem == stem), None)


def rig_of(scene: Scene, scale: int | None, limits: Limits) -> RigReading:
    """The cameras of a scene: its calibration, or what its year's page says.

    Args:
        scene: the scene.
        scale: factor that disparities are stored with, where the pictures' size does not tell it.
        limits: caps on the files.

    Raises:
        CalibrationMissing, CalibrationField, CalibrationSyntax, CalibrationValue: as they say.
        ImageUnreadable, ImageTruncated, LimitError: the picture has no legal header.
    """
    if scene.layout == "calib":
        return read_middlebury_calib(scene.folder / "calib.txt", limits=limits)
    size_px = read_size(scene.left, limits=limits)
    factor = stored_scale(scene, size_px, scale)
    if scene.layout == "views":
        focal_px = FOCAL_PX / factor
        dmin = _dmin(scene.folder / "dmin.txt", limits)
        doffs_px = dmin / factor
        notes = [
            f"{scene.name}: f {FOCAL_PX:g} px at full size and baseline {BASELINE_M:g} m, as "
            "published for 2005 and 2006; the principal point is taken in the middle",
            f"{scene.name}: dmin {dmin:g} px of full size: Z = f B / (d + {doffs_px:.6g})",
        ]
    else:
        focal_px, doffs_px = FOCAL_PX * size_px[0] / WIDTH_2003_PX, 0.0
        notes = [
            f"{scene.name}: warning: no calibration was published with the 2001 and 2003 data; "
            f"f {focal_px:g} px and baseline {BASELINE_M:g} m stand in, so that disparities count "
            "and metres do not; give the true ones by --rig"
        ]
    rig = _centred_rig(size_px, focal_px, doffs_px)
    # Stored in 8 bits, so that no disparity is larger.
    nearest_m = rig.fB_px_m / (LARGEST_STORED / factor + RANGE_MARGIN_PX + doffs_px)
    return RigReading(scene.folder, f"Middlebury {YEARS[scene.layout]}", rig, rig, tuple(notes),
                      nearest_m)  # fmt: skip


def _centred_rig(size_px: tuple[int, int], focal_px: float, doffs_px: float) -> StereoRig:
    cx, cy = (size_px[0] - 1) / 2, (size_px[1] - 1) / 2
    left, right = (
        np.array([[focal_px, 0, x], [0, focal_px, cy], [0, 0, 1.0]]) for x in (cx, cx + doffs_px)
    )
    t_m = np.array([-BASELINE_M, 0.0, 0.0])
    return StereoRig(
        Camera(left, *size_px, frame="camera_left"),
        Camera(right, *size_px, frame="camera_right"),
        Pose.from_rotation("camera_right", "camera_left", np.eye(3), t_m),
        origin="Middlebury",
    )


def stored_scale(scene: Scene, size_px: tuple[int, int], scale: int | None) -> int:
    """How many steps of a stored disparity are a pixel.

    Raises:
        CalibrationField: the size of the pictures is none of the published ones.
    """
    if scale is not None:
        return scale
    if scene.layout == "rows":
        return SIZES_2003_PX.get(size_px, SCALE_2001)
    found = HEIGHTS_2005_PX.get(size_px[1])
    if found is None:
        raise CalibrationField(
            f"pictures {size_px[1]} px high",
            want=", ".join(f"{height} (x {n})" for height, n in HEIGHTS_2005_PX.items()),
            fix="Say by which factor the disparities are stored: --source.stored-scale 2.",
            path=scene.left,
            where="stored_scale",
        )
    return found


def _dmin(path: Path, limits: Limits) -> float:
    """Pixels of full size that were cropped between the eyes, 0 < dmin."""
    lines = read_lines(path, error=CalibrationField, limits=limits)
    words = [(line, word) for line in lines for word in line.words()]
    if len(words) != 1:
        raise CalibrationField(
            f"{len(words)} numbers", want="dmin, one number", path=path, where="dmin"
        )
    line, word = words[0]
    value = line.number_of(word)
    if value < 0:
        raise line.refusal(f"dmin {value:g}", want="0 or more", column=word.column)
    return value


def read_truth(
    scene: Scene, seen: Literal["occ", "noc"], scale: int | None, limits: Limits
) -> DisparityMap | None:
    """Ground truth of the left picture; infinite or 0 is none.

    Args:
        scene: the scene.
        seen: with occluded pixels, or those alone that both eyes see.
        scale: see `rig_of`.
        limits: caps on the files.

    Raises:
        ImageMissing, ImageUnreadable, ImageTruncated, ImageFormat, LimitError: as its reader says.
        ImageMissing: `noc` where there is no mask.
    """
    if scene.truth is None:
        return None
    if scene.truth.suffix.lower() == ".pfm":
        truth = read_pfm(scene.truth, limits=limits)
        return truth if seen == "occ" else _masked(truth, scene, limits)
    if seen == "noc":
        raise _no_mask(scene)
    stored = read_image(scene.truth, limits=limits).pixels
    if stored.ndim != 2 or stored.dtype != np.uint8:
        raise ImageFormat(
            f"a disparity picture of shape {stored.shape}, {stored.dtype}",
            want="one channel of 8 bits",
            path=scene.truth,
        )
    factor = stored_scale(scene, (stored.shape[1], stored.shape[0]), scale)
    values = stored.astype(np.float32) / np.float32(factor)
    values[stored == 0] = np.nan
    return DisparityMap(values)


def _masked(truth: DisparityMap, scene: Scene, limits: Limits) -> DisparityMap:
    if scene.mask is None:
        raise _no_mask(scene)
    mask = read_image(scene.mask, limits=limits).pixels
    if mask.shape != truth.values.shape:
        raise StructureError(
            f"a mask of shape {mask.shape}", want=f"{truth.values.shape}", where=str(scene.mask)
        )
    values: Float32 = np.where(mask == SEEN_BY_BOTH, truth.values, np.float32(np.nan))
    return DisparityMap(values)


def _no_mask(scene: Scene) -> ImageMissing:
    return ImageMissing(
        "no mask of the pixels that both eyes see",
        want="mask0nocc.png",
        fix="Leave out --source.truth noc.",
        path=scene.folder / "mask0nocc.png",
    )
