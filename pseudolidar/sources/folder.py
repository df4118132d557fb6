"""Pictures of two eyes in folders, with a rig file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pseudolidar.errors import PseudolidarError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.image import read_size
from pseudolidar.formats.pictures.pair_mask import read_pair_mask
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_folder import find_rig
from pseudolidar.formats.rigs.rig_json import missing_rig, rig_notes
from pseudolidar.formats.rigs.rig_reading import Pictures, RigReading, RigUnit
from pseudolidar.formats.time_table import read_time_table
from pseudolidar.sources.asked_layout import TOLERANCE_S, asked_layout
from pseudolidar.sources.folder_frames import FolderSource
from pseudolidar.sources.folder_layout import Layout, find_layout
from pseudolidar.sources.names import safe_id
from pseudolidar.sources.pairing import Pairing
from pseudolidar.sources.picture_times import times_by_name
from pseudolidar.sources.source import SourceSummary
from pseudolidar.sources.stamps import (
    TIMES_FILES,
    FrameTimes,
    read_frame_times,
    synthetic_times,
)

RIG_FILE = "rig.json"
# Pictures that are looked at for their size before a rig without one is refused.
PICTURES_TRIED = 20


@dataclass(frozen=True)
class Folders:
    """Pictures in two folders, in one, or in a folder for each scene.

    Pairs are found by name: folders `left` and `right`, `image_0` and `image_1`, `cam0` and
    `cam1`; in one folder `left*` and `right*`, `*_l` and `*_r`, `im0` and `im1`; names that are
    times are paired by time. The rule found is said.

    Args:
        path: folder of both eyes, or of the left one if `right` is given.
        right: folder of the right pictures.
        rig: calibration of any known form; else the one in the folder: `rig.json`, `K.txt`,
            `calib.txt`, OpenCV's or ROS's YAML.
        left_pattern: names of left pictures, such as `cam_a_*.png`.
        right_pattern: names of right pictures, such as `cam_b_*.png`.
        times: file of times, of seconds, dates or nanoseconds: a line for each left picture, or
            times with names of pictures; else `times.txt` and the like in the folder.
        rate_hz: frames a second, where no times are known.
        tolerance_s: names that are times are paired up to this difference.
        scale_calibration: scale the rig where pictures have another size.
        rig_unit: unit of lengths in calibrations that do not say it.
        pictures: raw or rectified, where a calibration knows both.
        limits: caps on the files.
    """

    path: str
    right: str | None = None
    rig: str | None = None
    left_pattern: str | None = None
    right_pattern: str | None = None
    times: str | None = None
    rate_hz: float = 10.0
    tolerance_s: float = TOLERANCE_S
    scale_calibration: bool = False
    rig_unit: RigUnit | None = None
    pictures: Pictures = "auto"
    limits: Limits = DEFAULT_LIMITS

    def open(self) -> FolderSource:
        """List and pair the pictures, read the rig.

        Raises:
            SourceUnknown: no folder, or no pairs in it.
            SourceEmpty: pictures, and not one pair.
            CalibrationMissing: no rig file.
            NotRectified: the rig is that of unrectified cameras, and pictures are said not to be.
            CalibrationSizeMismatch: all pictures have another size than the rig.
            SequenceTime: the file of times does not fit.
        """
        layout = asked_layout(
            self.path,
            self.right,
            (self.left_pattern, self.right_pattern),
            tolerance_s=self.tolerance_s,
        )
        pairing, times = _times(self, layout)
        layout = replace(layout, pairing=pairing)
        readings = _read_rigs(self, layout)
        rigs = tuple(reading.of_pictures for reading in readings)
        source = FolderSource(
            summary=_summary(self, layout, readings, times),
            ids=tuple(safe_id(pair.key) for pair in pairing.pairs),
            timestamps_ns=times.timestamps_ns,
            refused=pairing.unpaired,
            lefts=tuple(pair.left for pair in pairing.pairs),
            rights=tuple(pair.right for pair in pairing.pairs),
            rigs=rigs,
            scale_calibration=self.scale_calibration,
            limits=self.limits,
            mask=read_pair_mask(layout.left.parent, limits=self.limits),
        )
        if not self.scale_calibration:
            source.check_sizes()
        return source

    @classmethod
    def looks_like(cls, path: Path) -> bool:
        """Whether `path` holds pairs of pictures."""
        return find_layout(path, tolerance_s=cls.tolerance_s) is not None


def _read_rigs(settings: Folders, layout: Layout) -> tuple[RigReading, ...]:
    """The rig of all pairs, or, where each scene has its own, of each."""
    common = _common_rig_file(settings, layout)
    pairs = layout.pairing.pairs
    if settings.rig is None and layout.scenes:
        files = [find_rig(pair.left.parent) for pair in pairs]
        if any(file is not None for file in files):
            chosen = [common if file is None else file for file in files]
            return tuple(
                _reading(file, settings, [pair.left])
                for file, pair in zip(chosen, pairs, strict=True)
            )
    return (_reading(common, settings, [pair.left for pair in pairs]),)


def _common_rig_file(settings: Folders, layout: Layout) -> Path | None:
    if settings.rig is not None:
        return Path(settings.rig)
    folder = Path(settings.path)
    places = (folder, layout.left, layout.left.parent)
    return next((file for place in places if (file := find_rig(place)) is not None), None)


def _reading(file: Path | None, settings: Folders, pictures: Sequence[Path]) -> RigReading:
    if file is None:
        raise missing_rig(Path(settings.path) / RIG_FILE)
    size_px = _first_size(pictures, settings.limits)
    reading = read_any_rig(file, size_px=size_px, unit=settings.rig_unit, limits=settings.limits)
    return reading.taken_for(settings.pictures)


def _first_size(pictures: Sequence[Path], limits: Limits) -> tuple[int, int] | None:
    """(width, height) of the first picture that has a header; for rig files that do not say it."""
    for picture in pictures[:PICTURES_TRIED]:
        try:
            return read_size(picture, limits=limits)
        except PseudolidarError:
            continue  # its frame is refused when it is loaded
    return None


def _times(settings: Folders, layout: Layout) -> tuple[Pairing, FrameTimes]:
    """Times of the pairs: of a file, by their names, or made up; a list may order them anew."""
    pairing = layout.pairing
    stated = [pair.time_ns for pair in pairing.pairs]
    if None not in stated and settings.times is None:
        times = read_frame_times(layout.left, stated, range(len(stated)))
        notes = ("time: from the names of the pictures", *times.notes)
        return pairing, replace(times, notes=notes)
    place = {key: number for number, key in enumerate(pairing.left_keys)}
    numbers = [place[pair.key] for pair in pairing.pairs]
    file = _times_file(settings, layout)
    if file is None:
        return pairing, synthetic_times(numbers, settings.rate_hz)
    table = read_time_table(file, limits=settings.limits)
    if table.names is not None:
        pairing, times = times_by_name(pairing, table)
    else:
        times = read_frame_times(file, table.stamps_ns, numbers)
        times = replace(times, notes=(table.note, *times.notes))
    return pairing, times if times.timestamps_ns[0] > 0 else times.after_zero()


def _times_file(settings: Folders, layout: Layout) -> Path | None:
    if settings.times is not None:
        return Path(settings.times)
    places = (Path(settings.path), layout.left, layout.left.parent)
    files = (place / name for place in places for name in TIMES_FILES)
    return next((file for file in files if file.is_file()), None)


def _summary(
    settings: Folders, layout: Layout, readings: Sequence[RigReading], times: FrameTimes
) -> SourceSummary:
    pairing = layout.pairing
    warnings: Mapping[str, None] = dict.fromkeys(
        note for reading in readings for note in (*reading.notes, *rig_notes(reading.of_pictures))
    )
    nearest_m = [reading.min_depth_m for reading in readings if reading.min_depth_m is not None]
    alone = len(pairing.unpaired)
    unpaired = (f"{alone} pictures without a partner left out",) if alone else ()
    return SourceSummary(
        kind="folders",
        path=settings.path,
        line=f"{layout.line}: {len(pairing.pairs)} pairs by {pairing.rule}",
        notes=(
            f"pairs: {pairing.rule}",
            *pairing.notes,
            *layout.notes,
            *unpaired,
            *times.notes,
            *warnings,
        ),
        nearest_m=min(nearest_m, default=None),
    )
