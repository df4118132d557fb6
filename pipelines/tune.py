"""Find matcher settings for SOURCE by itself, and save them for every other command."""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pseudolidar.errors import UsageError
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.field_markers import RUN_ONLY, THIS_TIME, Recognised
from pseudolidar.running.folder import check_usable
from pseudolidar.running.journal.identity import identity
from pseudolidar.running.nearness import Searching
from pseudolidar.running.new_file import check_kind, check_new_file, is_text
from pseudolidar.running.preflight import preflight
from pseudolidar.running.progress import TimeProgress
from pseudolidar.running.tuning.duration import Duration
from pseudolidar.running.tuning.findings import Figures, Found, TuneReport, write_settings
from pseudolidar.running.tuning.judged import By, JudgedFrames
from pseudolidar.running.tuning.picture_mark import is_picture_of_trials
from pseudolidar.running.tuning.search import Budget, Scored, Search
from pseudolidar.running.tuning.space import Candidate, Space
from pseudolidar.running.tuning.trials import Trials
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.scans_put_right import Scans
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import FrameSource, nearest_depth_m, pairs_of, tell
from pseudolidar.stereo.balance import BalanceWhen
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.eyes import Eyes
from pseudolidar.stereo.filters.filled_map import Surfaces
from pseudolidar.stereo.filters.map_filter import FilteredMatcher, MapFilters
from pseudolidar.stereo.filters.smoothed_map import Fgs
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.stereo.row_alignment import RowsWhen
from pseudolidar.stereo.sgbm import Bm, Sgbm

_log = logging.getLogger(__name__)
# Matchers that are kept loaded: each holds its working memory.
LOADED = 4
JOURNAL_SUFFIX = ".trials.jsonl"


@dataclass(frozen=True)
class Tune:
    """Find good settings of a matcher, and of the filters behind it, for data like SOURCE.

    Settings are judged by ground truth or LiDAR scans where SOURCE has them, else by the pairs
    themselves: left against right, photometric error, and the next frame. One figure counts:
    an outlier (D1) costs 1, a pixel without a disparity a tenth, or half where filling it makes an
    outlier, a right one up to a tenth by its error. The last frames are held back: the figures
    that are told are of those, and what is not clearly better there than the first settings is not
    taken. By pairs alone census is tuned nearly as well, SGBM and BM hardly.
    Time does not count: where it must not grow, say `--keep matcher.quality,smooth`.

    The first settings are the defaults, or what the flags say. The same command goes on where it
    was stopped; Ctrl-C keeps the best so far. With the same seed the same settings are tried.

        pseudolidar tune training --out settings.json --budget 300s
        pseudolidar tune drive --by pairs --budget 10m --picture trials.png
        pseudolidar convert drive out --settings settings.json

    Args:
        source: pairs of pictures, with or without ground truth or scans.
        out: the file of settings; the trials are beside it, NAME.trials.jsonl.
        budget: time for the search: 300s, 5m, 1h.
        by: what settings are compared with: truth, scan, pairs; auto is the best that there is.
        matcher: whose settings, and from which on.
        smooth: smoothing to start with; the search tries it, with other settings, and none.
        fill: filling of holes to start with; its settings are tuned only where it is chosen.
        rows: whether the rows of the right eye are aligned with the left one's before: auto, never.
        balance: whether the right eye is equalised to the left one before: auto, always, never.
        keep: settings that stay as they are, a comma list: matcher.quality, smooth.
        candidates: most settings that are tried, whatever time is left.
        seed: of all chance.
        tune_frames: most frames that settings are tuned on.
        held_frames: most frames that are held back.
        frames: only these: slices 100:400:2, ids 13,35, or @FILE with such items.
        exclude: not these.
        rig: calibration that replaces the source's cameras: a rig.json, OpenCV YAML, XML or JSON,
            ROS camera_info, K.txt, calib.txt; a file, a folder, or LEFT,RIGHT.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        scale_calibration: scale the calibration where images have another size.
        min_depth: nearest depth that must be found, m; decides how many disparities are searched.
            By default what the data set says of its scenes, or the rig of its board, else 3.
        swap: exchange left and right pictures.
        scans: how LiDAR scans are put right first.
        picture: draw the trials into this PNG.
        check: look at the first, the middle and the last pair before: swapped eyes, rows that are
            off and a calibration for another size stop it, other oddities are warned of.
        workers: frames matched at the same time; by default one per core.
        overwrite: start anew, even where OUT has trials of another search.
    """

    source: Annotated[Source, Recognised(recognise)]
    out: Annotated[Path, RUN_ONLY] = Path("settings.json")
    budget: Annotated[Duration, RUN_ONLY] = Duration(300.0)
    by: By = "auto"
    matcher: Census | Sgbm | Bm = field(default_factory=Census)
    smooth: Fgs | None = None
    fill: Surfaces | None = None
    rows: RowsWhen = "auto"
    balance: BalanceWhen = "auto"
    keep: str = ""
    candidates: Annotated[int | None, RUN_ONLY] = None
    seed: int = 0
    tune_frames: int = 6
    held_frames: int = 4
    frames: FrameSelection | None = None
    exclude: FrameSelection | None = None
    rig: Path | None = None
    rig_unit: RigUnit | None = None
    scale_calibration: bool = False
    min_depth: float | None = None
    swap: bool = False
    scans: Scans = field(default_factory=Scans)
    picture: Annotated[Path | None, RUN_ONLY] = None
    check: Annotated[bool, RUN_ONLY] = True
    workers: Annotated[int | None, RUN_ONLY] = None
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False

    def __post_init__(self) -> None:
        least = {"tune_frames": 1, "held_frames": 1, "candidates": 1, "seed": 0}
        for name, value in least.items():
            given = getattr(self, name)
            if given is not None and given < value:
                raise UsageError(f"{name} {given}", want=f"{value} or more", where=name)


def run(job: Tune) -> TuneReport:
    """Search until the time is over; the best so far is on disk at any moment.

    Raises:
        UsageError: OUT is there and no journal belongs to it, or a setting is unknown.
        OutputSettings: the trials beside OUT are of another search.
        ReferenceMissing: SOURCE does not have what settings are to be judged by.
    """
    journal = check_place(job)
    source, crew = opened(job), CrewPlan(job.workers)
    space = Space.around(
        Candidate(job.matcher, job.smooth, job.fill),
        keep=[name for each in job.keep.split(",") if (name := each.strip())],
    )
    searching = Searching(job.matcher, job.min_depth)
    warnings = preflight(source, wanted=job.check, crew=crew, searching=searching)
    load = loader(job, source)
    frames = JudgedFrames.of(
        source, job.by, load(space.start), tuned_on=job.tune_frames, held=job.held_frames
    )
    trials = Trials.opened(journal, identity(job, source), anew=job.overwrite)
    search, found = searched(job, source, frames, trials, space, load)
    if job.picture is not None:
        draw(job.picture, search, found)
    doubts = found.doubts(frames.by)
    for line in doubts:
        _log.warning("%s", line)
    return TuneReport(
        subject=source.summary.line,
        by=frames.by,
        found=found,
        tuned_on=tuple(part.id for part in frames.tuned_on),
        held=tuple(part.id for part in frames.held),
        candidates=len(search.tried),
        trials=len(trials.known),
        restored=trials.restored,
        seconds=search.budget.spent_s,
        out=job.out,
        journal=journal,
        picture=job.picture,
        warnings=(*warnings, *doubts),
        skipped=frames.skipped,
    )


def searched(
    job: Tune,
    source: FrameSource,
    frames: JudgedFrames,
    trials: Trials,
    space: Space,
    load: Callable[[Candidate], StereoMatcher],
) -> tuple[Search, Found]:
    """Search until the time is over, and what was found best; that is on disk at any moment."""
    about = {
        "source": source.summary.line,
        "by": frames.by,
        "tuned_on": [part.id for part in frames.tuned_on],
        "held": [part.id for part in frames.held],
        "seed": job.seed,
    }
    budget = Budget(job.budget.seconds)
    kept: list[Found] = []

    def keep(scored: Scored, held: float) -> None:
        kept.append(found_of(search, scored, held))
        if not (search.repeats_only and job.out.exists()):  # an earlier run wrote what is better
            write_settings(job.out, kept[-1], about)

    with TimeProgress(job.budget.seconds, "tuning") as bar:

        def progress(begun: int) -> None:
            best = f"best {kept[-1].tuned:.3f} of the first loss" if kept else ""
            bar.used(budget.spent_s, f"{begun} settings, {best}")

        workers = CrewPlan(job.workers).count
        search = Search(space, frames, load, trials, budget, job.seed, workers, keep, progress)
        try:
            search.run(most_candidates=job.candidates)
        except KeyboardInterrupt:
            if kept:
                if not search.repeats_only:
                    write_settings(job.out, kept[-1], about)
                _log.info("the best so far is in %s", job.out)
            raise
    write_settings(job.out, kept[-1], about)
    return search, kept[-1]


def check_place(job: Tune) -> Path:
    """The journal's path; OUT is new, or the search that belongs to it goes on.

    Raises:
        UsageError: OUT is there, and no journal beside it; or it or the picture would replace
            a file of another kind.
        OutputError: nothing can be written there.
    """
    journal = job.out.with_name(job.out.stem + JOURNAL_SUFFIX)
    check_usable(job.out.parent)
    taken = job.out.exists() and not journal.exists() and not job.overwrite
    if job.out.is_dir() or taken:
        raise UsageError(
            "a folder" if job.out.is_dir() else "there is such a file already, and no trials of it",
            want="the name of a new file",
            fix="Name another with --out, or pass --overwrite to replace a file.",
            path=job.out,
        )
    check_kind(job.out, is_text, "file of settings")
    if job.picture is not None:
        check_new_file(job.picture, overwrite=True, flag="--picture")
        check_kind(job.picture, is_picture_of_trials, "picture of trials", flag="--picture")
    return journal


def opened(job: Tune) -> FrameSource:
    """The pairs that are asked for, with the rig that is asked for."""
    every = opened_with_rig(
        job.source,
        job.rig,
        scale_calibration=job.scale_calibration,
        unit=job.rig_unit,
        swap=job.swap,
        scans=job.scans,
    )
    source = pairs_of(select(every, job.frames, job.exclude))
    tell(source)
    return source


def loader(job: Tune, source: FrameSource) -> Callable[[Candidate], StereoMatcher]:
    """What makes a matcher of settings, as every command does."""
    nearest_m = nearest_depth_m(job.min_depth, source)

    @functools.lru_cache(maxsize=LOADED)
    def load(candidate: Candidate) -> StereoMatcher:
        matcher = Eyes(job.rows, job.balance).load(candidate.matcher, min_depth_m=nearest_m)
        return FilteredMatcher(matcher, MapFilters.load(candidate.smooth, candidate.fill))

    return load


def found_of(search: Search, scored: Scored, held: float) -> Found:
    """A candidate with its figures on the frames that were held back."""
    start, frames = search.space.start, search.frames.held
    first, best = (
        Figures.of(search.judgements(each, frames), seconds=search.seconds(each, frames))
        for each in (start, scored.candidate)
    )
    return Found(scored.candidate, start, scored.score, held, first, best)


def draw(path: Path, search: Search, found: Found) -> None:
    """Draw the trials.

    Raises:
        OutputError: the picture cannot be written.
    """
    from pseudolidar.formats.atomic import write_atomic
    from pseudolidar.running.tuning.picture import trials_png

    write_atomic(path, trials_png(search, found))
