"""Ready-made clouds in a folder, one file a frame: PCD, PLY, NPZ and Velodyne `.bin`."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from pseudolidar.errors import PointFileMissing, PseudolidarError, SourceEmpty
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.points.cloud_file import FORMATS, CloudReading, format_of, is_cloud_file
from pseudolidar.formats.points.velodyne_bin import POINT_BYTES
from pseudolidar.formats.timestamps import read_times, read_timestamps
from pseudolidar.sources.names import natural_key, safe_id, stamp_unit_ns, time_of_name_ns
from pseudolidar.sources.source import SourceSummary
from pseudolidar.sources.stamps import FrameTimes, read_frame_times, synthetic_times
from pseudolidar.structures.recorded import RecordedCloud

TIMES_FILE, TIMESTAMPS_FILE = "times.txt", "timestamps.txt"


@dataclass(frozen=True)
class CloudFiles:
    """Clouds in the files of one folder, or in one file; all their columns are kept.

    Frames are in natural order of the names. Files that differ by extension only are one frame: the
    one that keeps most is read (npz, pcd, ply, bin). A folder without clouds whose subfolders have
    the names of these formats, as `convert` writes, is read the same way. Times are those that all
    files note, else those that all names state, else those of `times.txt` (seconds) or
    `timestamps.txt` (dates).

    Args:
        path: folder or file.
        rate_hz: frames a second, where no times are known.
        synthetic_times: number the frames by the rate, whatever times are known.
        sniff: go by the content of the files where it and the extension disagree.
        salvage: of a file that ends early take the whole points, and say so.
        record_size: bytes of a point of a .bin: 20 where a value follows the four.
        limits: caps on the files.
    """

    path: str
    rate_hz: float = 10.0
    synthetic_times: bool = False
    sniff: bool = False
    salvage: bool = False
    record_size: int = POINT_BYTES
    limits: Limits = DEFAULT_LIMITS

    @property
    def reading(self) -> CloudReading:
        """How the files are read."""
        return CloudReading(self.sniff, self.salvage, self.record_size)

    def open(self) -> CloudFileSource:
        """List the files and read their times.

        Raises:
            SourceEmpty: no file of clouds.
            SequenceTime: times do not increase.
        """
        listing = _listing(Path(self.path))
        if not listing.files and not listing.refused:
            raise SourceEmpty(
                "no file of clouds", want=f"files named {', '.join(FORMATS)}", path=self.path
            )
        times, noted, broken = _times(self, listing.files)
        files = [file for file in listing.files if file not in broken]
        refused = [*listing.refused, *((safe_id(f.stem), error) for f, error in broken.items())]
        return CloudFileSource(
            summary=_summary(self, listing, times, len(files)),
            ids=tuple(safe_id(file.stem) for file in files),
            timestamps_ns=times.timestamps_ns,
            refused=tuple(refused),
            files=tuple(files),
            times_known=noted,
            reading=self.reading,
            limits=self.limits,
        )

    @classmethod
    def looks_like(cls, path: Path) -> bool:
        """Whether `path` is a file of clouds, or a folder that has such files."""
        if path.is_file():
            return is_cloud_file(path)
        return any(is_cloud_file(file) for file in _listing(path).files[:1])


@dataclass(frozen=True, eq=False)
class CloudFileSource:
    """An opened folder of clouds.

    Args:
        summary: what it is.
        ids: names of the frames.
        timestamps_ns: times of the frames.
        refused: files that cannot be read, with the reason.
        files: by frame.
        times_known: whether the times are of the data; made up ones do not go into clouds.
        reading: how the files are read.
        limits: caps on the files.
    """

    summary: SourceSummary
    ids: tuple[str, ...]
    timestamps_ns: tuple[int, ...]
    refused: tuple[tuple[str, PseudolidarError], ...]
    files: tuple[Path, ...]
    times_known: bool
    reading: CloudReading = CloudReading()
    limits: Limits = DEFAULT_LIMITS
    rig: ClassVar[None] = None
    yields: ClassVar = RecordedCloud

    def load(self, index: int) -> RecordedCloud:
        """Read a cloud.

        Raises:
            PointFileMissing, PointFileTruncated, PointFileCorrupt, PointFileField, LimitError: as
                the reader of its format.
        """
        cloud, notes = self.reading.read(self.files[index], limits=self.limits)
        if self.times_known and not cloud.timestamp_ns:
            cloud = replace(cloud, timestamp_ns=self.timestamps_ns[index])
        return RecordedCloud(
            cloud, self.ids[index], index, self.timestamps_ns[index], notes=tuple(notes)
        )


def cloud_files_of(path: Path) -> tuple[Path, ...]:
    """The files that the clouds of a folder come from, or the one file that `path` is."""
    return _listing(path).files


@dataclass(frozen=True)
class _Listing:
    """Files of clouds in natural order, links that lead nowhere, and what was odd."""

    files: tuple[Path, ...]
    refused: tuple[tuple[str, PseudolidarError], ...] = ()
    notes: tuple[str, ...] = ()


def _listing(path: Path) -> _Listing:
    """The one file that `path` is, or those of the folder; links are followed, loops refused."""
    if not path.is_dir():
        return _Listing((path,) if path.is_file() else ())
    folders = [path]
    found, refused = _files_of(path)
    if not found:
        folders = [path / suffix[1:] for suffix in FORMATS if (path / suffix[1:]).is_dir()]
        parts = [_files_of(folder) for folder in folders]
        found = [file for files, _ in parts for file in files]
        refused = [entry for _, entries in parts for entry in entries]
    by_stem: dict[str, list[Path]] = {}
    for file in found:
        by_stem.setdefault(file.stem, []).append(file)
    order = list(FORMATS)
    files = [
        min(by_stem[stem], key=lambda file: order.index(file.suffix.lower()))
        for stem in sorted(by_stem, key=natural_key)
    ]
    left = len(found) - len(files)
    twice = f"{left} files left out: the same frame in a format that keeps less"
    return _Listing(tuple(files), tuple(refused), (twice,) if left else ())


def _files_of(folder: Path) -> tuple[list[Path], list[tuple[str, PseudolidarError]]]:
    found: list[Path] = []
    refused: list[tuple[str, PseudolidarError]] = []
    with os.scandir(folder) as entries:
        for entry in sorted(entries, key=lambda entry: natural_key(entry.name)):
            path = folder / entry.name
            if path.suffix.lower() not in FORMATS:
                continue
            try:
                if path.stat() and path.is_file():
                    found.append(path)
            except OSError as error:  # a link to nothing, or to itself
                reason = PointFileMissing(
                    error.strerror or str(error), want="a file", fix="Mend the link.", path=path
                )
                refused.append((safe_id(path.stem), reason))
    return found, refused


def _times(
    settings: CloudFiles, files: Sequence[Path]
) -> tuple[FrameTimes, bool, Mapping[Path, PseudolidarError]]:
    """Times of the readable files, whether they are known, and the unreadable ones."""
    broken: dict[Path, PseudolidarError] = {}
    stated: list[int] = []
    for file in files:
        try:
            stated.append(settings.reading.format_of(file).time_ns(file))
        except PseudolidarError as error:
            broken[file] = error
    good = [number for number, file in enumerate(files) if file not in broken]
    names = [files[number].stem for number in good]
    folder = Path(settings.path)
    if settings.synthetic_times or not good:
        return synthetic_times(good, settings.rate_hz), False, broken
    if all(stated):
        times = read_frame_times(folder, stated, range(len(stated)))
        return replace(times, notes=("time: noted in the files", *times.notes)), True, broken
    unit_ns = stamp_unit_ns(names)
    if unit_ns is not None:
        stamps = [time_of_name_ns(name, unit_ns) for name in names]
        times = read_frame_times(folder, stamps, range(len(stamps)))
        return (
            replace(times, notes=("time: from the names of the files", *times.notes)),
            True,
            broken,
        )
    in_file = _times_of_file(settings, names, good)
    if in_file is not None:
        return in_file, True, broken
    return synthetic_times(good, settings.rate_hz), False, broken


def _times_of_file(
    settings: CloudFiles, names: Sequence[str], places: Sequence[int]
) -> FrameTimes | None:
    """Times by the number of the file where all names are numbers, else by its place."""
    folder = Path(settings.path)
    folder = folder if folder.is_dir() else folder.parent
    for place in (folder, folder.parent):
        for name, read in ((TIMES_FILE, read_times), (TIMESTAMPS_FILE, read_timestamps)):
            file = place / name
            if not file.is_file():
                continue
            stamps = read(file, limits=settings.limits)
            numbered = all(n.isascii() and n.isdigit() and len(n) < 19 for n in names)
            numbers = [int(n) for n in names] if numbered else list(places)
            times = read_frame_times(file, stamps, numbers)
            times = times if times.timestamps_ns[0] > 0 else times.after_zero()
            return replace(times, notes=(f"time: {name}", *times.notes))
    return None


def _summary(
    settings: CloudFiles, listing: _Listing, times: FrameTimes, frames: int
) -> SourceSummary:
    kinds = Counter(format_of(file).name for file in listing.files)
    count = "1 frame" if frames == 1 else f"{frames} frames"
    named = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
    return SourceSummary(
        kind="cloud-files",
        path=settings.path,
        line=f"clouds in files: {count} ({named or 'none readable'})",
        notes=(*listing.notes, *times.notes),
    )
