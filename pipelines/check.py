"""Tell whether pairs and calibration fit together: eyes, rows, units, exposure, time."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np

from pseudolidar.calibration.check_finding import SUREST, Finding
from pseudolidar.calibration.check_rotation import turned
from pseudolidar.calibration.drift_rig import realigned_rig, remounted_rig
from pseudolidar.errors import MapScale, PseudolidarError, SourceEmpty, UsageError
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.geometry.rectification import aligning_rotations
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.field_markers import RUN_ONLY, THIS_TIME, Recognised
from pseudolidar.running.given import GivenSettings, given_maps
from pseudolidar.running.nearness import Searching
from pseudolidar.running.preflight import SourceCheck, check_source
from pseudolidar.running.reports.check_report import BodyCheckReport, CheckReport
from pseudolidar.running.rig_output import check_rig_place, store_rig
from pseudolidar.running.scan_numbers import numbered_alone, scan_numbers
from pseudolidar.sources.body import parts_of
from pseudolidar.sources.kitti.extract import KittiExtract
from pseudolidar.sources.kitti.scan_times import numbered
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.rectified import Rectify, in_one_view, raw_rig
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import FrameSequence, FrameSource, pairs_of
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.given_maps import StoredSteps
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.recorded import Frame

MAPS, SCANS = "given maps", "scans"


@dataclass(frozen=True)
class Check:
    """Tell whether the pairs of SOURCE and its calibration fit together.

    Each pair is matched without trusting its rows. Swapped eyes, rows that are off (shifted,
    rolled, scaled), one picture on both sides, another image size, a baseline in mm, the focal
    length of another matrix, different exposures, pictures of two moments: what was seen, how sure
    that is, and what mends it. `convert` and `evaluate` do so before their first frame.

    All pairs together tell how one eye is turned against what the rig says, with standard
    deviations: the more of them (--frames), the surer. --out writes the rig with that put right.
    The yaw is hardly seen in the rows; `refine` by motion or by scans sees what it does.

    Of several pairs on one body each is looked at by itself.

    Where scans have no times (unsynchronised KITTI), those of other numbers are tried, too.

    Exit code 3 where something would stop a run, else 0.

        pseudolidar check 2011_09_26_drive_0002_sync
        pseudolidar check pictures --rig rig.json --picture check.png
        pseudolidar check training --frames 0::10 --json
        pseudolidar check 2011_09_26_drive_0002_sync --frames 0::5 --out rig.json

    Args:
        source: data with pairs.
        frames: these pairs, slices 100:400:2, ids 13,35, or @FILE with such items; by default the
            first, the middle and the last.
        exclude: not these.
        rig: calibration that replaces the source's cameras.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        rectify: how unrectified pairs are rectified, as they load.
        scale_calibration: scale the calibration where images have another size.
        swap: exchange left and right pictures.
        disparity: disparity maps that somebody else made: are they in the scale they are read in?
        depth: the same with depth maps.
        map_scale: steps a px or m of such maps: auto, 256, 16 (OpenCV), 1000 (mm), 5000 (TUM), 1.
        out: write the rig with the turn of the right eye put right into this file, if there is any.
        overwrite: replace OUT, if that is a rig file; it is kept as OUT's name with .previous.
        picture: draw the matches of the pairs into this PNG, coloured by how far rows are off.
        workers: pairs looked at at the same time; by default one per core.
    """

    source: Annotated[Source, Recognised(recognise)]
    frames: FrameSelection | None = None
    exclude: FrameSelection | None = None
    rig: Path | None = None
    rig_unit: RigUnit | None = None
    rectify: Rectify = field(default_factory=Rectify)
    scale_calibration: bool = False
    swap: bool = False
    disparity: Path | None = None
    depth: Path | None = None
    map_scale: StoredSteps = field(default_factory=StoredSteps)
    out: Annotated[Path | None, RUN_ONLY] = None
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False
    picture: Path | None = None
    workers: Annotated[int | None, RUN_ONLY] = None


def run(job: Check) -> CheckReport | BodyCheckReport:
    """Look at the pairs that are asked for, and at those around them.

    Raises:
        NoPairs: the source has none.
        SourceEmpty: not one of the pairs could be read.
        UsageError: OUT is there already, or it is wanted of several pairs on one body.
    """
    if job.out is not None:
        check_rig_place(job.out, overwrite=job.overwrite)
    source = in_one_view(with_rig(job, job.source))
    if source.yields is BodyFrame:
        return checked_body(job, source)
    return checked_pairs(job, pairs_of(select(source, job.frames, job.exclude)))


def checked_body(job: Check, body: FrameSequence[Frame]) -> BodyCheckReport:
    """Look at each pair of a body as at one alone.

    Raises:
        UsageError: something is asked for that is of one pair.
    """
    alone = {"out": job.out, "picture": job.picture}
    alone |= {"disparity": job.disparity, "depth": job.depth}
    asked = [f"--{name}" for name, path in alone.items() if path is not None]
    if asked:
        raise UsageError(
            f"{' and '.join(asked)} with several pairs on one body",
            want="one pair",
            fix="Give the folder of one pair; it finds its rig in the body's.",
            path=body.summary.path,
        )
    reports = {
        name: checked_pairs(job, pairs_of(select(part, job.frames, job.exclude)))
        for name, part in parts_of(body).items()
    }
    return BodyCheckReport(body.summary.line, body.summary.path, reports)


def checked_pairs(job: Check, source: FrameSource) -> CheckReport:
    """Look at the pairs of one rig."""
    every = range(len(source.ids)) if job.frames is not None else None
    crew = CrewPlan(job.workers)
    check = check_source(
        source,
        every,
        crew=crew,
        neighbours=True,
        timeout_s=crew.timeout_s,
        searching=Searching(Census()),
    )
    if not check.pairs and check.error is None:
        raise unreadable(check)
    maps = maps_found(job, source)
    if job.picture is not None:
        draw(job.picture, check, source)
    rig = None if job.out is None else mended_rig(check, source)
    if job.out is not None and rig is not None:
        store_rig(job.out, rig)
    told = (*check.findings, *scans_found(job), *maps)
    return CheckReport(check, told, job.picture, job.out, rig is not None)


def with_rig(job: Check, source: Source) -> FrameSequence[Frame]:
    """All frames of a source with the rig that is asked for."""
    return opened_with_rig(
        source,
        job.rig,
        scale_calibration=job.scale_calibration,
        unit=job.rig_unit,
        swap=job.swap,
        rectify=job.rectify,
    )


def mended_rig(check: SourceCheck, source: FrameSource) -> StereoRig | None:
    """The source's rig with the turn of its right eye put right; None where there is none."""
    if check.rotation is None or not turned(check.rotation):
        return None
    mounted = raw_rig(source)
    if mounted is None:
        return realigned_rig(source.rig, check.rotation)
    _, R_right = aligning_rotations(mounted.T_right_left)
    return remounted_rig(mounted, R_right, check.rotation)


def maps_found(job: Check, source: FrameSource) -> tuple[Finding, ...]:
    """What the pictures say of the maps that are given with them; nothing without maps."""
    wanted = GivenSettings(job.disparity, job.depth, job.map_scale, check=True, sigma_px=None)
    try:
        given = given_maps(wanted, source)
    except MapScale as error:
        return (Finding(MAPS, "stop", error.got, SUREST, error.fix),)
    if given is None:
        return ()
    return (Finding(MAPS, "good", "they lead to the same places in the right pictures"),)


def scans_found(job: Check) -> tuple[Finding, ...]:
    """Whether scans that are known by their numbers alone are of the moments of their pictures."""
    if not isinstance(job.source, KittiExtract) or not numbered_alone(job.source):
        return ()
    source = job.source
    found = scan_numbers(source, lambda drive: pairs_of(with_rig(job, drive)), Census().load())
    if found is None:
        return (Finding(SCANS, "unknown", "none of them sees what the pictures show"),)
    fits = f"depths differ by {found.error_rel[found.best]:.1%} (median)"
    if not found.best:
        return (Finding(SCANS, "good", f"equal numbers fit best: {fits}"),)
    usual = found.error_rel.get(0)
    than = "" if usual is None else f", by {usual:.1%} with equal numbers"
    seen = f"picture n belongs to scan {numbered(found.best)}: {fits}{than}"
    mend = f"Pass --scan-offset {found.best}."
    return (Finding(SCANS, "note", seen, None, mend, {"scan_offset": found.best}),)


def unreadable(check: SourceCheck) -> PseudolidarError:
    """Why there is nothing to be looked at."""
    if check.failed:
        return check.failed[0].error
    return SourceEmpty("no pair", want="a source of pairs", path=check.path)


def draw(path: Path, check: SourceCheck, source: FrameSource) -> None:
    """Draw the matches of every pair that was looked at, one below the other.

    Raises:
        OutputError: the picture cannot be written.
    """
    from pseudolidar.evaluation.match_picture import match_picture
    from pseudolidar.formats.atomic import write_atomic
    from pseudolidar.formats.pictures.image import encode_png

    panels = []
    for pair in check.pairs:
        frame = source.load(source.ids.index(pair.id))
        title = f"{pair.id}: {len(pair.matches)} matches, {int(pair.inliers.sum())} agree"
        panels.append(
            match_picture(
                frame.left,
                frame.right,
                pair.matches.left_px,
                pair.matches.right_px,
                pair.inliers,
                title=title,
            )
        )
    width = max(panel.shape[1] for panel in panels)
    padded = [np.pad(p, ((0, 0), (0, width - p.shape[1]), (0, 0))) for p in panels]
    write_atomic(path, encode_png(np.vstack(padded)))
