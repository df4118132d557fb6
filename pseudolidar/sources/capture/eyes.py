"""Pictures of cameras to the pair that a frame is made of: colours, halves, order, size."""

from __future__ import annotations

from dataclasses import dataclass, field

from pseudolidar.errors import CalibrationSizeMismatch, UsageError
from pseudolidar.sources.aligned_rows import aligned
from pseudolidar.sources.bare_pairs import BarePair
from pseudolidar.sources.capture.live_pairs import Taken
from pseudolidar.sources.capture.shots import Shot, ShotPair
from pseudolidar.sources.rectified import Rectify, rectified
from pseudolidar.sources.video.packing import AXES, Layout, halved_px, split_eyes
from pseudolidar.structures.arrays import Image
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import RawPair, StereoFrame


@dataclass(frozen=True)
class Eyes:
    """How the pictures of cameras become left and right.

    Args:
        layout: how one camera's pictures hold both eyes; None for two cameras.
        swap: exchange left and right.
        scale: size of the pair, of that of the pictures.
    """

    layout: Layout | None = None
    swap: bool = False
    scale: float = 1.0

    def pair(self, shots: ShotPair) -> tuple[Image, Image, tuple[str, ...]]:
        """Left and right (H, W, 3) RGB or (H, W) grey, and what was odd about them."""
        from pseudolidar.formats.video.pixels import to_pixels

        pictures = [
            to_pixels(shot.picture, rotated=True, smaller_px=self._smaller_px(shot))
            for shot in shots.shots
        ]
        notes = tuple(dict.fromkeys(note for one in pictures for note in one.notes))
        if self.layout is None:
            left, right = (picture.pixels for picture in pictures)
        else:
            left, right = split_eyes(pictures[0].pixels, self.layout)
        return (right, left, notes) if self.swap else (left, right, notes)

    def size_of(self, full_px: tuple[int, int]) -> tuple[int, int]:
        """(width, height) of the pair where an eye has `full_px`."""
        return max(1, round(full_px[0] * self.scale)), max(1, round(full_px[1] * self.scale))

    def _smaller_px(self, shot: Shot) -> tuple[int, int] | None:
        """(width, height) of a whole picture whose eyes have the size wanted; None as it is."""
        if self.scale == 1:
            return None
        if self.layout is None:
            return self.size_of(shot.size_px)
        width, height = self.size_of(halved_px(shot.size_px, self.layout))
        return (2 * width, height) if AXES[self.layout] else (width, 2 * height)


@dataclass(frozen=True)
class Calibrated:
    """Makes frames of cameras whose calibration is known.

    Args:
        eyes: how left and right are found.
        rig: of their size: of rectified pictures, or of pictures as the cameras take them.
        rectify: how the latter are rectified.
    """

    eyes: Eyes
    rig: StereoRig = field(repr=False)
    rectify: Rectify

    def __call__(self, taken: Taken) -> StereoFrame:
        """The rectified frame, its rows put right where the rig says how.

        Raises:
            CalibrationSizeMismatch, PairMismatch: a picture of another size.
        """
        left, right, notes = self.eyes.pair(taken.shots)
        found = (left, right, self.rig, taken.id, taken.index, taken.shots.time_ns)
        if self.rig.is_rectified:
            frame: StereoFrame = aligned(StereoFrame(*found, notes=notes))
        else:
            frame = aligned(rectified(RawPair(*found, notes=notes), self.rectify))
        return frame


@dataclass(frozen=True)
class Bare:
    """Makes pairs as they are, to calibrate the cameras with.

    Args:
        eyes: how left and right are found.
    """

    eyes: Eyes

    def __call__(self, taken: Taken) -> BarePair:
        """The pair."""
        left, right, _ = self.eyes.pair(taken.shots)
        return BarePair(left, right, taken.id, taken.index)


def layout_by_size(picture_px: tuple[int, int], eye_px: tuple[int, int]) -> Layout:
    """How one camera's pictures hold both eyes, by the size of an eye in its rig.

    Raises:
        UsageError: they hold one eye, or something else.
    """
    wide, high = (a / b for a, b in zip(picture_px, eye_px, strict=True))
    if (wide, high) == (2, 1):
        return "side-by-side"
    if (wide, high) == (1, 2):
        return "top-bottom"
    raise UsageError(
        "one camera, with pictures of {}x{}, and a rig for eyes of {}x{}".format(
            *picture_px, *eye_px
        ),
        want="two cameras, or one whose pictures hold both eyes",
        fix="Name the other camera, or how both are packed: `live CAM side-by-side OUT`.",
    )


def fitting(rig: StereoRig, eye_px: tuple[int, int], *, scale_calibration: bool) -> StereoRig:
    """The rig for eyes of (width, height) `eye_px`.

    Raises:
        CalibrationSizeMismatch: it is for another size, and not to be scaled.
    """
    if rig.left.size_px == eye_px or scale_calibration:
        return rig if rig.left.size_px == eye_px else rig.scaled_to(*eye_px)
    raise CalibrationSizeMismatch(
        "cameras that give {}x{}".format(*eye_px),
        want="{}x{}, the size of the calibration".format(*rig.left.size_px),
        fix="Ask the cameras for that size with --camera.size, or pass --scale-calibration.",
    )
