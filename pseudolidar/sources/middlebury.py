"""Middlebury stereo of all years, and ETH3D two-view: pairs with ground-truth disparity."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

from pseudolidar.errors import PseudolidarError, SourceEmpty, SourceUnknown
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.formats.rigs.rig_json import rig_notes
from pseudolidar.formats.rigs.rig_reading import RigReading
from pseudolidar.sources.folder_layout import list_folders
from pseudolidar.sources.middlebury_scenes import YEARS, Scene, find_scene, read_truth, rig_of
from pseudolidar.sources.names import safe_id
from pseudolidar.sources.source import SourceSummary
from pseudolidar.sources.stamps import synthetic_times
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import StereoFrame


@dataclass(frozen=True)
class Middlebury:
    """Middlebury stereo 2001 to 2021 and ETH3D two-view: a scene, or a folder of scenes.

    2014, 2021 and ETH3D: `im0 im1 calib.txt`, `disp0.pfm` or `disp0GT.pfm`. 2005 and 2006: `view1
    view5 disp1 dmin.txt` in full, half or third size. 2001 and 2003: `im2 im6 disp2`.

    Args:
        path: folder of a scene, or of several.
        truth: ground truth with occluded pixels, or without (where `mask0nocc.png` tells them).
        stored_scale: factor that 8-bit disparities are stored with; by default by picture size.
        lighting: pictures to take of 2005 and 2006 data with all lights and exposures.
        rate_hz: frames a second: there are no time stamps.
        limits: caps on the files.
    """

    path: str
    truth: Literal["occ", "noc"] = "occ"
    stored_scale: int | None = None
    lighting: str = "Illum1/Exp1"
    rate_hz: float = 10.0
    limits: Limits = DEFAULT_LIMITS

    @classmethod
    def looks_like(cls, path: Path) -> bool:
        """Whether `path` is a scene or holds scenes, by content."""
        return bool(_scenes(path, cls.lighting))

    def open(self) -> MiddleburyScenes:
        """List the scenes and read their calibrations.

        Raises:
            SourceUnknown: no scene.
            SourceEmpty: no scene has a good calibration, with the first reason.
        """
        scenes = _scenes(Path(self.path), self.lighting)
        if not scenes:
            raise SourceUnknown(
                "no scene",
                want="im0, im1 and calib.txt; view1, view5 and disp1; or im2, im6 and disp2",
                path=self.path,
            )
        usable: list[tuple[Scene, RigReading]] = []
        refused: list[tuple[str, PseudolidarError]] = []
        for scene in scenes:
            try:
                usable.append((scene, rig_of(scene, self.stored_scale, self.limits)))
            except PseudolidarError as error:
                refused.append((safe_id(scene.name), error))
        if not usable:
            raise (
                refused[0][1]
                if len(refused) == 1
                else SourceEmpty(
                    f"{len(refused)} scenes, none usable: {refused[0][1]}",
                    want="scenes with a calibration",
                    path=self.path,
                )
            )
        times = synthetic_times(range(len(usable)), self.rate_hz)
        return MiddleburyScenes(
            summary=_summary(self.path, usable, times.notes),
            scenes=tuple(scene for scene, _ in usable),
            rigs=tuple(reading.of_rectified for _, reading in usable),
            timestamps_ns=times.timestamps_ns,
            refused=tuple(refused),
            settings=self,
        )


@dataclass(frozen=True, eq=False)
class MiddleburyScenes:
    """Opened scenes; pictures and truth are read by `load`.

    Args:
        summary: what it is.
        scenes: the files by frame.
        rigs: the cameras by frame.
        timestamps_ns: made-up times of the frames.
        refused: scenes without a good calibration.
        settings: what was asked for.
    """

    summary: SourceSummary
    scenes: tuple[Scene, ...]
    rigs: tuple[StereoRig, ...] = field(repr=False)
    timestamps_ns: tuple[int, ...]
    refused: tuple[tuple[str, PseudolidarError], ...]
    settings: Middlebury
    yields: ClassVar = StereoFrame

    @property
    def rig(self) -> StereoRig:
        """Rig of the first scene."""
        return self.rigs[0]

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the scenes."""
        return tuple(safe_id(scene.name) for scene in self.scenes)

    def load(self, index: int) -> StereoFrame:
        """Read and decode a scene.

        Raises:
            ImageMissing, ImageUnreadable, ImageTruncated, ImageFormat, PairMismatch,
            CalibrationSizeMismatch, StructureError: as they say, with the file.
        """
        scene, settings = self.scenes[index], self.settings
        left = read_image(scene.left, limits=settings.limits)
        right = read_image(scene.right, limits=settings.limits)
        truth = read_truth(scene, settings.truth, settings.stored_scale, settings.limits)
        try:
            return StereoFrame(
                left.pixels,
                right.pixels,
                self.rigs[index],
                safe_id(scene.name),
                index,
                self.timestamps_ns[index],
                truth=truth,
                notes=tuple(dict.fromkeys(left.notes + right.notes)),
            )
        except PseudolidarError as error:
            raise error.located(scene.left) from None


def _scenes(path: Path, lighting: str) -> list[Scene]:
    own = find_scene(path, lighting=lighting)
    if own is not None:
        return [own]
    found = (find_scene(folder, lighting=lighting) for folder in list_folders(path))
    return [scene for scene in found if scene is not None]


def _summary(
    path: str, usable: list[tuple[Scene, RigReading]], time_notes: tuple[str, ...]
) -> SourceSummary:
    first, reading = usable[0]
    rig = reading.of_rectified
    years = " and ".join(dict.fromkeys(YEARS[scene.layout] for scene, _ in usable))
    without = sum(scene.truth is None for scene, _ in usable)
    size = f"{rig.left.width_px}x{rig.left.height_px} px"
    scenes = f"{len(usable)} scenes" if len(usable) > 1 else f"scene {first.name}"
    notes = [note for _, other in usable for note in other.notes]
    notes += [note for _, other in usable for note in rig_notes(other.of_rectified)]
    nearest = [other.min_depth_m for _, other in usable if other.min_depth_m is not None]
    return SourceSummary(
        kind="middlebury",
        path=path,
        line=f"Middlebury ({years}): {scenes}, {size}, baseline {rig.baseline_m:.5f} m"
        + ("" if without == len(usable) else ", ground-truth disparity"),
        absent=(f"ground-truth disparity of {without} of {len(usable)} scenes",) if without else (),
        notes=(*time_notes, *notes),
        nearest_m=min(nearest, default=None),
    )
