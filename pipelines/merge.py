"""The clouds of many frames as one, in one frame, in one file."""

from __future__ import annotations

import contextlib
import logging
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from pseudolidar.clouds.crop import Box, Range
from pseudolidar.clouds.merge import Joined, column_names
from pseudolidar.clouds.thin import Voxel
from pseudolidar.clouds.tool import CloudTools, count
from pseudolidar.errors import CalibrationField, SourceEmpty, UsageError
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.cloud_frames import CloudFrame, carried, common_frame
from pseudolidar.geometry.frame_chain import ancestors, chain
from pseudolidar.running.bad_frames import OnError, good_frames
from pseudolidar.running.crew.attempt import Skipped
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY, THIS_TIME, Recognised
from pseudolidar.running.memory import check_memory
from pseudolidar.running.one_cloud import check_apart, check_place, write_cloud
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.reports.merge_report import MergeReport, Part
from pseudolidar.running.stream import stream
from pseudolidar.sources.cloud_files import CloudFileSource
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.sources.selection import FrameSelection, select, whole
from pseudolidar.sources.source import FrameSequence, clouds_of, evenly_loaded
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.recorded import RecordedCloud

_log = logging.getLogger(__name__)

Origin = Literal["frame_index", "time_s", "none"]
# Frames that are looked at to find the frame that all of them reach.
LOOKED_AT = 16


@dataclass(frozen=True)
class Merge:
    """Join the clouds of SOURCE in one frame, by the poses that it knows, and write them to OUT.

    OUT is one file: .ply, .pcd, .bin or .npz. Points keep their columns and get one more: where
    they are from. Clouds of a moving sensor lie on one another only where the source knows poses:
    recordings do, files of clouds do not; what is known is said. What moves leaves a trail. A frame
    that cannot be used is left out and named (exit code 4).

        pseudolidar merge drive.mcap street.ply --voxel 0.1
        pseudolidar merge drive.mcap scans.pcd --topic /velodyne/points --frames 0::5
        pseudolidar merge drive.mcap near.ply --crop range:2:30
        pseudolidar merge drive.mcap part.npz --crop box --crop.frame map --crop.x 0:50

    Args:
        source: clouds: a recording, or a folder of pcd, ply, bin, npz files.
        out: the file.
        frame: the common frame; by default `map`, else the most fixed one that all frames reach:
            their own where the source knows no other.
        voxel: keep one point of each cube with this edge, m: the surest, else the first. The memory
            then holds what is kept, not what comes.
        crop: of each frame only the points in a box, of its own coordinate frame or another
            (--crop.frame), or at some distance from the sensor.
        origin: column that says where a point is from: index of its frame in SOURCE, or seconds
            since the first frame there.
        frames: only these: slices 100:400:2, ids 13,35, or @FILE with such items.
        exclude: not these.
        workers: frames worked on at the same time; by default one per core.
        on_error: skip a bad frame (and stop when they become many), or stop at the first.
        overwrite: replace OUT.
    """

    source: Annotated[Source, Recognised(recognise)]
    out: Annotated[Path, POSITIONAL]
    frame: CloudFrame | None = None
    voxel: float | None = None
    crop: Box | Range | None = None
    origin: Origin = "frame_index"
    frames: FrameSelection | None = None
    exclude: FrameSelection | None = None
    workers: Annotated[int | None, RUN_ONLY] = None
    on_error: Annotated[OnError, RUN_ONLY] = "skip"
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False

    def __post_init__(self) -> None:
        if self.voxel is not None and not 0 < self.voxel < math.inf:
            raise UsageError(f"cubes of {self.voxel:g} m", want="above 0", where="--voxel")


def run(job: Merge) -> MergeReport:
    """Bring every cloud into the common frame, join them in order, write the file.

    Raises:
        NoClouds: the source has something else.
        UsageError: OUT is there already, or not one point is left.
        MemoryLimit: the points do not fit into memory.
    """
    check_place(job.out, overwrite=job.overwrite)
    source = opened(job)
    per_frame = PrepareFrame.of(job, source)
    joined, parts, skipped = Joined(job.voxel), list[Part](), list[Skipped]()
    outcomes = stream(source, per_frame, crew=CrewPlan(job.workers))
    total = len(source.ids)
    with FrameProgress(total) as progress:

        def skip(frame: Skipped) -> None:
            skipped.append(frame)
            progress.skip()

        for frame in good_frames(outcomes, frames=total, on_error=job.on_error, skipped=skip):
            part, cloud = frame.value
            joined.add(cloud)
            parts.append(part)
            times_as_many = total / len(parts) if job.voxel is None else 1
            check_memory(round(joined.nbytes * times_as_many), held=joined.nbytes)
            progress.advance()
    cloud, lost = joined.taken()
    notes = [f"not in all frames, left out: {', '.join(lost)}"] if lost else []
    if any(part.replaced for part in parts):
        notes.append(f"the clouds' own column {job.origin} was replaced (--origin none keeps it)")
    notes += write_cloud(job.out, cloud)
    return MergeReport(
        job.out,
        cloud.frame,
        tuple(parts),
        tuple(skipped),
        len(cloud),
        column_names(cloud),
        tuple(notes),
    )


def opened(job: Merge) -> FrameSequence[RecordedCloud]:
    """The clouds that are asked for; of a recording that has pairs as well its clouds.

    Raises:
        NoClouds: the source has none.
        UsageError: OUT lies among them.
    """
    settings, source = job.source, job.source.open()
    pairs_taken = source.yields is not RecordedCloud
    if pairs_taken and isinstance(settings, Recording) and settings.take == "auto":
        with contextlib.suppress(SourceEmpty):
            source = replace(settings, take="clouds").open()
    if isinstance(source, CloudFileSource):
        check_apart(job.out, source.files, Path(source.summary.path))
    clouds = select(clouds_of(source), job.frames, job.exclude)
    for line in (clouds.summary.line, *clouds.summary.notes):
        _log.info(line)
    return clouds


@dataclass(frozen=True)
class PrepareFrame:
    """Crops a cloud, brings it into the common frame and thins it: pure, picklable, one thread.

    Args:
        frame: the common frame.
        crop: which points are wanted.
        thin: one point a cube, where that is wanted.
        origin: column that says where a point is from.
        first_ns: what its seconds count from.
    """

    frame: CloudFrame
    crop: CloudTools
    thin: CloudTools
    origin: Origin
    first_ns: int

    @classmethod
    def of(cls, job: Merge, source: FrameSequence[RecordedCloud]) -> PrepareFrame:
        """For these frames.

        Raises:
            CalibrationField: no frame is common to all.
        """
        frame = job.frame or found_frame(source)
        thin = None if job.voxel is None else Voxel(job.voxel)
        first_ns = min(whole(source).timestamps_ns, default=0)
        return cls(frame, CloudTools.load(job.crop), CloudTools.load(thin), job.origin, first_ns)

    def __call__(self, frame: RecordedCloud) -> tuple[Part, PointCloud]:
        """The cloud in the common frame, points without coordinates left out.

        Raises:
            CalibrationField: at its time no transforms lead there.
        """
        own = frame.cloud
        T_frame_cloud = chain(frame.tree, self.frame, own.frame)
        if T_frame_cloud is None:
            known = ancestors(frame.tree, own.frame)
            raise CalibrationField(
                f"no transforms from {own.frame!r} to {self.frame!r}",
                want=f"one of {', '.join(known)}",
                fix="Pass another --frame, or leave it out by --exclude.",
                where=f"frame {frame.id}",
            )
        cloud = self.crop(own, frame.tree).cloud
        cloud = carried(cloud if cloud.shape is None else cloud[cloud.valid], T_frame_cloud)
        cloud = self.marked(self.thin(cloud, ()).cloud, frame)
        part = Part(
            frame.id,
            frame.index,
            frame.timestamp_ns,
            own.frame,
            T_frame_cloud.translation_m,
            count(own),
            len(cloud),
            self.origin in own.extra,
        )
        return part, cloud

    def marked(self, cloud: PointCloud, frame: RecordedCloud) -> PointCloud:
        """The cloud with the column that says where it is from."""
        if self.origin == "none":
            return cloud
        column = np.full(len(cloud), frame.index, np.uint32)
        if self.origin == "time_s":
            column = np.full(len(cloud), (frame.timestamp_ns - self.first_ns) / NS_PER_S)
        return replace(cloud, extra={**cloud.extra, self.origin: column})


def found_frame(source: FrameSequence[RecordedCloud]) -> CloudFrame:
    """The most fixed frame that frames, evenly over the source, all reach.

    Raises:
        CalibrationField: there is none.
    """
    sights = [(frame.cloud.frame, frame.tree) for frame in evenly_loaded(source, most=LOOKED_AT)]
    found = common_frame(sights) if sights else "unknown"  # then every frame says why
    if found is None:
        names = dict.fromkeys(name for name, _ in sights)
        raise CalibrationField(
            f"clouds in {', '.join(names)}, and no transforms to a frame that all of them reach",
            want="clouds in one frame, or transforms",
            fix="Pick clouds of one frame by --frames.",
            path=source.summary.path,
        )
    return found
