"""How both eyes are packed in the pictures of one video, and the rig that fits an eye of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from pseudolidar.errors import PairMismatch, SourceUnknown
from pseudolidar.sources.rig_size import fitting_rig
from pseudolidar.structures.arrays import Image, size_of
from pseudolidar.structures.camera import StereoRig

if TYPE_CHECKING:
    from pseudolidar.formats.video.file import VideoFile

Layout = Literal["side-by-side", "top-bottom"]
# What Matroska calls the packing of two eyes: layout, and whether the right eye comes first.
STEREO_MODES: dict[str, tuple[Layout, bool]] = {
    "left_right": ("side-by-side", False),
    "right_left": ("side-by-side", True),
    "top_bottom": ("top-bottom", False),
    "bottom_top": ("top-bottom", True),
}
# How far the ratio of width to height may be off where the calibration is to be scaled.
ASPECT_TOLERANCE = 0.02
# Axis along which two eyes are packed.
AXES: dict[Layout, int] = {"side-by-side": 1, "top-bottom": 0}


@dataclass(frozen=True, eq=False)
class Packing:
    """Where the eyes are in a picture, and the rig that fits them.

    Args:
        layout: None for a video of one eye.
        swapped: the right eye comes first.
        rig: of one eye's size.
        notes: what was assumed.
    """

    layout: Layout | None
    swapped: bool
    rig: StereoRig = field(repr=False)
    notes: tuple[str, ...] = ()

    def split(self, pixels: Image) -> tuple[Image, Image]:
        """Left and right eye of a picture that holds both."""
        assert self.layout is not None
        first, second = split_eyes(pixels, self.layout)
        return (second, first) if self.swapped else (first, second)


def split_eyes(pixels: Image, layout: Layout) -> tuple[Image, Image]:
    """First (left, upper) and second eye of a picture that holds both.

    Raises:
        PairMismatch: an odd number of columns or rows cannot be halved.
    """
    halved_px(size_of(pixels), layout)
    halves = np.split(pixels, 2, axis=AXES[layout])
    first, second = (np.ascontiguousarray(half) for half in halves)
    return first, second


def halved_px(size_px: tuple[int, int], layout: Layout) -> tuple[int, int]:
    """(width, height) of an eye in a picture of (width, height) that holds both.

    Raises:
        PairMismatch: an odd number of columns or rows cannot be halved.
    """
    width, height = size_px
    if size_px[1 - AXES[layout]] % 2:
        raise PairMismatch(
            f"a picture of {width}x{height} cannot be halved {layout}", want="an even size"
        )
    return (width // 2, height) if AXES[layout] else (width, height // 2)


def find_packing(
    video: VideoFile,
    rig: StereoRig,
    *,
    layout: Layout | None,
    swap: bool,
    scale_calibration: bool,
) -> Packing:
    """How both eyes are packed: as told, as the file says, or as the rig's size tells.

    Args:
        video: with both eyes.
        rig: of one eye.
        layout: as told.
        swap: the right eye comes first, other than the file says.
        scale_calibration: scale the rig to the eyes.

    Raises:
        SourceUnknown: none of these; or a packing that is not known here.
        CalibrationSizeMismatch: an eye has another size than the rig.
    """
    told = (layout, False) if layout else STEREO_MODES.get(video.stereo)
    if told is None and video.stereo not in ("", "mono"):
        raise SourceUnknown(
            f"a video packed as {video.stereo!r}",
            want=", ".join(STEREO_MODES),
            fix="Unpack it into two videos.",
            path=video.path,
        )
    why = "as told" if layout else "as the file says" if told else "by the rig's size"
    layout, swapped = told or (_layout_by_size(video, rig, scale_calibration), False)
    width, height = video.size_px
    if video.size_px[1 - AXES[layout]] % 2:
        raise SourceUnknown(
            f"a video of {size_text(video)} cannot be halved {layout}",
            want="an even size",
            fix="Name the other layout by --layout, or give two videos.",
            path=video.path,
        )
    eye_px = (width // 2, height) if layout == "side-by-side" else (width, height // 2)
    fitting = fitting_rig(rig, eye_px, scale_calibration=scale_calibration, path=video.path)
    notes = [f"eyes: {layout} ({why}), each {eye_px[0]}x{eye_px[1]} px"]
    stretch = (eye_px[0] / rig.left.width_px) / (eye_px[1] / rig.left.height_px)
    if abs(stretch - 1) > ASPECT_TOLERANCE:
        notes.append(
            f"squeezed: an eye is {stretch:.3g} times as wide as its rig says; the pictures are "
            "used as they are and the calibration is scaled with them"
        )
    return Packing(layout, swapped != swap, fitting, tuple(notes))


def _layout_by_size(video: VideoFile, rig: StereoRig, scale_calibration: bool) -> Layout:
    wide, high = (a / b for a, b in zip(video.size_px, rig.left.size_px, strict=True))
    if (wide, high) == (2, 1) or (scale_calibration and _is_near(wide / high, 2)):
        return "side-by-side"
    if (wide, high) == (1, 2) or (scale_calibration and _is_near(wide / high, 0.5)):
        return "top-bottom"
    eye = "x".join(map(str, rig.left.size_px))
    raise SourceUnknown(
        f"a video of {size_text(video)} and a rig for eyes of {eye}",
        want=f"both eyes in one picture, {2 * rig.left.width_px}x{rig.left.height_px} or "
        f"{rig.left.width_px}x{2 * rig.left.height_px}, or a second video",
        fix="Give the right eye's video by --right; or name the packing, --layout side-by-side or "
        "top-bottom, and if the eyes are squeezed into the picture --scale-calibration too.",
        path=video.path,
    )


def _is_near(ratio: float, wanted: float) -> bool:
    return abs(ratio / wanted - 1) < ASPECT_TOLERANCE


def size_text(video: VideoFile) -> str:
    """Size of its pictures, for people."""
    return f"{video.size_px[0]}x{video.size_px[1]} px"
