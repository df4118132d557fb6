"""The cameras of a live run: opened, looked at, and fitted with their calibration."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol, cast, get_args

from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_folder import find_rig
from pseudolidar.formats.rigs.rig_json import missing_rig
from pseudolidar.formats.rigs.rig_reading import RigReading, RigUnit
from pseudolidar.sources.aligned_rows import with_rows_aligned
from pseudolidar.sources.bare_pairs import BarePair
from pseudolidar.sources.capture.cameras import Cameras, CameraSettings, Capture
from pseudolidar.sources.capture.eyes import (
    Bare,
    Calibrated,
    Eyes,
    fitting,
    layout_by_size,
)
from pseudolidar.sources.capture.live_pairs import LivePairs, Wanted
from pseudolidar.sources.rectified import Rectify, with_pairs_rectified
from pseudolidar.sources.source import SourceSummary
from pseudolidar.sources.video.packing import Layout, halved_px
from pseudolidar.structures.frame import RawPair, StereoFrame

KIND = "cameras"


class LiveSettings(Protocol):
    """What the settings of a live run say about its cameras."""

    @property
    def left(self) -> str:
        """Camera of the left eye, or of both."""

    @property
    def right(self) -> str | None:
        """Camera of the right eye, or how one camera's pictures hold both."""

    @property
    def realtime(self) -> bool:
        """Videos are played as if live."""

    @property
    def camera(self) -> CameraSettings:
        """How they are opened."""

    @property
    def rig(self) -> Path | None:
        """Their calibration."""

    @property
    def rig_unit(self) -> RigUnit | None:
        """Its unit, where it does not say it."""

    @property
    def scale_calibration(self) -> bool:
        """It may be scaled to the pictures."""

    @property
    def scale(self) -> float:
        """Size at which pairs are matched."""

    @property
    def rectify(self) -> Rectify:
        """How unrectified pairs become rectified ones."""

    @property
    def swap(self) -> bool:
        """Left and right are exchanged."""

    @property
    def frames_count(self) -> int | None:
        """Frames to take."""


def opened_cameras(job: LiveSettings) -> Capture:
    """The cameras, being read.

    Raises:
        CameraUnavailable, UsageError: as `Cameras.open`.
    """
    right = None if _layout(job) else job.right
    return Cameras(job.left, right, job.realtime, job.camera).open()


def bare_eyes(job: LiveSettings) -> Eyes:
    """How left and right are found in pictures that are kept as they are."""
    return Eyes(_layout(job), job.swap)


def opened_bare(job: LiveSettings, cameras: Capture, wanted: Wanted) -> LivePairs[Any]:
    """The pairs of cameras that nobody has calibrated yet.

    Raises:
        CameraFault: one of them gives no picture.
    """
    sizes = {"{}x{}".format(*shot.size_px) for shot in cameras.seen().shots}
    line = f"cameras: {_names(cameras)}, {' and '.join(sorted(sizes))}"
    return LivePairs(
        cameras,
        Bare(bare_eyes(job)),
        yields=BarePair,
        summary=SourceSummary(KIND, job.left, line),
        rig=None,
        most=job.frames_count,
        wanted=wanted,
    )


def opened_pairs(job: LiveSettings, cameras: Capture) -> LivePairs[Any]:
    """The pairs of the cameras as a source, once they have shown a first picture.

    Raises:
        CalibrationMissing: no rig.
        CalibrationSizeMismatch: the cameras give another size.
        CameraFault: one of them gives none.
    """
    reading = read_rig(job)
    first = cameras.seen()
    picture_px = first.shots[0].size_px
    layout = _layout(job)
    if layout is None and len(first.shots) == 1:
        layout = layout_by_size(picture_px, reading.of_pictures.left.size_px)
    eye_px = picture_px if layout is None else halved_px(picture_px, layout)
    eyes = Eyes(layout, job.swap, job.scale)
    size_px = eyes.size_of(eye_px)
    packed = "" if layout is None else f", {layout}"
    scaled = "" if size_px == eye_px else "; matched at {}x{}".format(*size_px)
    line = "{}, {}x{} each{}{}".format(_names(cameras), *eye_px, packed, scaled)
    rig = fitting(reading.of_pictures, eye_px, scale_calibration=job.scale_calibration)
    rig = rig if size_px == eye_px else rig.scaled_to(*size_px)
    as_they_are: LivePairs[Any] = LivePairs(
        cameras,
        Calibrated(eyes, rig, job.rectify),
        yields=StereoFrame if rig.is_rectified else RawPair,
        summary=SourceSummary(KIND, job.left, f"cameras: {line}", notes=reading.notes),
        rig=rig,
        most=job.frames_count,
    )
    source = with_rows_aligned(with_pairs_rectified(as_they_are, job.rectify))
    return as_they_are.called(source.summary, StereoFrame, source.rig)


def read_rig(job: LiveSettings) -> RigReading:
    """The calibration that is given, or that lies beside a video or where the command is called.

    Raises:
        CalibrationMissing: there is none; and what else `read_any_rig` raises.
    """
    folder = Path(job.left).parent if job.realtime else Path()
    file = job.rig or find_rig(folder)
    if file is None:
        raise missing_rig(folder / "rig.json")
    return read_any_rig(file, unit=job.rig_unit).taken_for(job.rectify.pictures)


def _layout(job: LiveSettings) -> Layout | None:
    return cast("Layout | None", job.right if job.right in get_args(Layout) else None)


def _names(cameras: Capture) -> str:
    return " and ".join(address.place for address in cameras.addresses)
