"""Look at everything in a browser."""

from __future__ import annotations

import contextlib
import json
import logging
import re
import sys
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

# The package path of pipelines/ is made at run time; mypy checks the file itself.
from pseudolidar.pipelines.convert import Convert, ConvertFrame  # type: ignore[import-untyped]
from pseudolidar.pipelines.convert import opened as opened_source
from pseudolidar.pipelines.refine import Refine, fitted, mounted  # type: ignore[import-untyped]
from pseudolidar.pipelines.refine import opened as pairs_as_taken

from pseudolidar.clouds.ground_fit import GroundFit
from pseudolidar.clouds.outliers import Lonely
from pseudolidar.errors import PseudolidarError, UsageError
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.formats.trajectory_file import PoseRecord
from pseudolidar.obstacles.corridor import Corridor
from pseudolidar.obstacles.detectors import AnyDetector
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.drawn_frames import detector_for
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY
from pseudolidar.running.matching import MatchFrame, Refining
from pseudolidar.running.memory import give_back_freed_memory, leave_loaded_out_of_searches
from pseudolidar.running.nearness import Searching
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.settings_json import from_json
from pseudolidar.running.sighting import SMALL_THINGS_KEPT, Seen, SightFrame
from pseudolidar.running.signals import Stopped
from pseudolidar.sources.recognise import Source
from pseudolidar.sources.scans_put_right import Scans, with_scans_put_right
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import FrameSequence, pairs_of
from pseudolidar.stereo.balance import BalanceWhen
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.eyes import Eyes
from pseudolidar.stereo.filters.clean import Clean
from pseudolidar.stereo.filters.filled_map import Surfaces
from pseudolidar.stereo.filters.smoothed_map import Fgs
from pseudolidar.stereo.filters.temporal import Kalman
from pseudolidar.stereo.neural import Onnx
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.stereo.row_alignment import RowsWhen
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import DepthFrame, Frame
from pseudolidar.viewer.address import LOOPBACK, PORT, Address, Port
from pseudolidar.viewer.app import App
from pseudolidar.viewer.comparing.rigs import Fit, RigShop, Seeing, some_frames
from pseudolidar.viewer.effect import without_effect
from pseudolidar.viewer.exporting import check_export, draw, export, is_drawn
from pseudolidar.viewer.filming.outlined import FilmedObjects
from pseudolidar.viewer.means import Means
from pseudolidar.viewer.objects.asking import Asked
from pseudolidar.viewer.objects.teller import ScenesAtOnce
from pseudolidar.viewer.opening import RUN_FILE, Opened, Opening
from pseudolidar.viewer.reel import SourceReel
from pseudolidar.viewer.truth import true_places
from pseudolidar.viewer.tuning.tuner import Workshop
from pseudolidar.viewer.view_report import ViewReport

_log = logging.getLogger(__name__)
# Settings of a run that say which frames it saw, and how their disparities were found.
OF_FRAMES = (
    "source", "matcher", "rows", "balance", "frames", "exclude", "rig", "rig_unit", "rectify",
    "scale_calibration", "min_depth", "swap",
)  # fmt: skip
HOST_NAME = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?")


@dataclass(frozen=True)
class View:
    """Serve PATH to a browser: clouds, pictures, obstacles, with a time line.

    The printed address holds a token; whoever has it may look. Only this machine can come, unless
    --host says otherwise. Over SSH forward the port: `ssh -L 8080:localhost:8080 robot`. Ctrl-C
    ends it.

        pseudolidar view synthetic:street
        pseudolidar view KITTI/2011_09_26/2011_09_26_drive_0002_sync
        pseudolidar view out/map.ply out/trajectory.tum
        pseudolidar view out/mesh.glb
        pseudolidar view out/drive --no-browser --port 9000
        pseudolidar view out/drive --host 0.0.0.0 --named robot.lan
        pseudolidar view training --detector cloud --corridor 2x2x30
        pseudolidar view out/map.ply --export map.html
        pseudolidar view out/map.ply out/trajectory.tum --export flight.mp4
        pseudolidar view training --detector cloud --export found.mp4
        pseudolidar view drive --settings settings.json

    Args:
        paths: several at once: sources (KITTI data, folders, videos, recordings, synthetic:NAME),
            folders that a run wrote, files of clouds, meshes, trajectories.
        matcher: how disparities are found.
        rows: bring the rows of the right picture to those of the left one before matching: `auto`
            where points that both eyes see show that they differ, `never`.
        balance: give the right picture the brightness, colours, gamma and vignetting of the left
            one before matching: `auto`, `always`, `never`.
        clean: what is removed of them because it is no surface; `none` keeps all.
        temporal: how disparities are fused with those of the frames before; needs poses.
        smooth: how disparities are smoothed before they become points.
        fill: how holes between matched pixels are filled.
        reproject: which pixels become points, and how.
        outliers: which points are removed of clouds of any origin; `clean` is for disparities.
        frames: only these: slices 100:400:2, ids 13,35, or @FILE with such items.
        rig: calibration that replaces the source's cameras.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        detector: what says where objects are, at first; what `obstacles` found needs none. Those
            that need a file (onnx, template) come from here alone, others are chosen on the page.
        corridor: draw a corridor ahead, WIDTHxHEIGHTxLENGTH in m, with the nearest thing in it.
        port: to listen at; 0 or `auto` for any that is free.
        host: to listen at; others than 127.0.0.1 let other machines in, which still need the token.
        named: a name that this machine has in the addresses of browsers, where that is neither
            localhost nor an IP number: behind a proxy, or in your network. Others are refused.
        share: refused: a public tunnel shows the token and all pictures to whoever runs it.
        browser: open the page.
        export: serve nothing, and write what there is to see, all frames of it, to one file that
            opens without a server: scene.html, scene.viser for viser's own player; scene.mp4, a
            film (H.264) behind the rig of a sequence, along the path of a map, or once round clouds
            that lie still; scene.png, its first picture. Objects are in each of them.
    """

    paths: Annotated[tuple[str, ...], POSITIONAL] = ()
    matcher: Census | Sgbm | Bm | Onnx = field(default_factory=Census)
    rows: RowsWhen = "auto"
    balance: BalanceWhen = "auto"
    clean: Clean | None = field(default_factory=Clean)
    temporal: Kalman | None = None
    smooth: Fgs | None = None
    fill: Surfaces | None = None
    reproject: Reproject = field(default_factory=Reproject)
    outliers: Lonely | None = None
    frames: FrameSelection | None = None
    rig: Path | None = None
    rig_unit: RigUnit | None = None
    detector: AnyDetector | None = None
    corridor: Corridor | None = None
    port: Annotated[Port, RUN_ONLY] = PORT
    host: Annotated[str, RUN_ONLY] = LOOPBACK
    named: Annotated[str | None, RUN_ONLY] = None
    share: Annotated[bool, RUN_ONLY] = False
    browser: Annotated[bool, RUN_ONLY] = True
    export: Annotated[Path | None, RUN_ONLY] = None

    def __post_init__(self) -> None:
        if self.share:
            port = self.port or "PORT"
            raise UsageError(
                "a public tunnel, whose keeper would see the token and every picture",
                want="a way on which nobody reads along",
                fix=f"Forward the port: ssh -L {port}:localhost:{port} THIS-MACHINE.",
                where="--share",
            )
        if self.named is not None and not HOST_NAME.fullmatch(self.named):
            raise UsageError(self.named, want="a name as robot.lan, without port", where="--named")

    @property
    def address(self) -> Address:
        """Where it is served."""
        return Address(self.host, self.port, () if self.named is None else (self.named.lower(),))

    def conversion(self, source: Source) -> Convert:
        """What `convert` would do with a source."""
        return Convert(
            source,
            matcher=self.matcher,
            rows=self.rows,
            balance=self.balance,
            clean=self.clean,
            temporal=self.temporal,
            smooth=self.smooth,
            fill=self.fill,
            reproject=self.reproject,
            outliers=self.outliers,
            frames=self.frames,
            rig=self.rig,
            rig_unit=self.rig_unit,
        )

    def reel_of(self, source: Source) -> SourceReel:
        """The frames of a source, made into clouds when they are looked at."""
        return replace(reel_by(self.conversion(source)), origin=source)

    def reel_of_run(self, folder: Path) -> SourceReel | None:
        """The frames that a run saw, as it saw them; None, and why, where they are gone."""
        try:
            return reel_by(replace(job_of_run(folder), clean=self.clean))
        except UNREADABLE as error:
            _log.warning("%s: its source cannot be opened: %s", folder, error)
            return None


# What a run's settings and its source can be that are not here any more, or were changed.
UNREADABLE = (OSError, ValueError, KeyError, TypeError, RecursionError, PseudolidarError)


def job_of_run(folder: Path) -> Convert:
    """The frames of a run, and how their disparities were found.

    Raises:
        what `UNREADABLE` has.
    """
    settings = json.loads((folder / RUN_FILE).read_bytes())["settings"]
    told = {name: settings[name] for name in OF_FRAMES if name in settings}
    return from_json(Convert, told, where=RUN_FILE)


def truth_of_run(folder: Path, found: PoseRecord) -> Float64 | None:
    """Where the rig of a run really was, as the path that it found; None where nobody knows."""
    try:
        job = job_of_run(folder)
        return true_places(select(job.source.open(), job.frames, job.exclude), found)
    except UNREADABLE as error:
        _log.info("%s: where it really was cannot be told: %s", folder, error)
        return None


def run(job: View) -> ViewReport:
    """Serve until somebody ends it: Ctrl-C, or the terminal that it runs in is closed.

    Raises:
        SourceUnknown: a path is nothing that can be looked at.
        ServeError: the address cannot be had.
    """
    give_back_freed_memory()
    if job.export is not None:
        check_export(job.export, job.paths)
    opened = Opening(job.reel_of, job.reel_of_run, truth_of_run).all_of(job.paths)
    if unused := without_effect(job, opened):
        _log.warning("without effect on what was opened: %s", ", ".join(unused))
    if job.export is not None:
        try:
            exported(job, opened, job.export)
        except Stopped as stop:
            stop.advice = f"{job.export} was not written; the same command begins anew."
            raise
        return ViewReport(opened, file=job.export)
    # Ctrl-C is the ordinary way out, and no interruption.
    address = ""
    with (
        contextlib.suppress(Stopped),
        App.served(job.address, opened, means_of(job, opened)) as app,
    ):
        address = app.url.partition("?")[0]  # without the token, which opens the page
        print(app.url, file=sys.stderr, flush=True)  # noqa: T201 - printed at once, not at the end
        if job.browser:
            webbrowser.open(app.url)
        leave_loaded_out_of_searches()
        app.wait()
    return ViewReport(opened, address=address)


def exported(job: View, opened: Opened, path: Path) -> None:
    """Write what there is to see, with the objects that are asked for, to one file.

    Raises:
        PseudolidarError: the detector cannot be loaded, whose fault only a page would tell.
    """
    asked = asked_of(job, opened)
    wish = asked.wish(of_run=bool(opened.objects))
    reel = opened.first_source
    sighted = None if reel is None else reel.sighted
    if is_drawn(path):
        draw(opened, path, FilmedObjects(ScenesAtOnce.of(wish, opened.objects, sighted)))
        return
    with App.made(Address(port=0), opened.in_one_file(), Means(sighted, asked)) as app:
        export(app, path)


def reel_by(job: Convert) -> SourceReel:
    """The frames of a source as `convert` makes clouds of them, and `measure` measures in them."""
    frames = with_scans_put_right(opened_source(job), Scans())  # as `compare` does
    convert = ConvertFrame.of(job, frames).converted
    if frames.yields not in (StereoFrame, DepthFrame):
        return SourceReel(frames, convert)
    return SourceReel(frames, convert, measuring(job, frames))


def measuring(job: Convert, frames: FrameSequence[Frame]) -> Callable[[Frame], Seen]:
    """What things in frames with pictures are measured by, as `measure` does."""
    match = MatchFrame.load(
        frames,
        job.matcher,
        Refining(),
        SMALL_THINGS_KEPT,
        eyes=Eyes(job.rows, job.balance),
        min_depth_m=job.min_depth,
    )
    searched_px = Searching(job.matcher, job.min_depth).searched_px(frames)
    return SightFrame.of(match, GroundFit(), searched_px=searched_px)


def means_of(job: View, opened: Opened) -> Means:
    """What can be done with the frames of the first sequence."""
    reel, asked = opened.first_source, asked_of(job, opened)
    if reel is None:
        return Means(asked=asked)
    return Means(reel.sighted, asked, workshop(job, reel), rig_shop(job, reel))


def asked_of(job: View, opened: Opened) -> Asked:
    """What is looked for from the start, in the frames of the first sequence."""
    reel = opened.first_source
    if reel is None:
        return Asked(job.detector, job.corridor)
    return Asked(job.detector, job.corridor, partial(detector_for, source=reel.source))


def rig_shop(job: View, reel: SourceReel) -> RigShop | None:
    """How the frames of a source look by other rigs; None where it has no pairs, or is of a run.

    Args:
        job: the settings.
        reel: its frames as they are made by these.
    """
    source = reel.origin
    if source is None or reel.source.yields is not StereoFrame:
        return None
    refine = Refine(
        source, rig=job.rig, rig_unit=job.rig_unit, frames=job.frames, rows=job.rows,
        balance=job.balance,
    )  # fmt: skip

    def fit(seen: Seeing) -> Fit:
        frames = pairs_of(some_frames(pairs_as_taken(refine), seen))
        try:
            found = fitted(refine, frames, CrewPlan(1))  # one core is left to those who look
        finally:
            give_back_freed_memory()  # again: the fit, as every run, told glibc to keep it
        rig = mounted(found.rig, frames) if found.changed else None
        return Fit(rig, found.lines)

    given = job.rig is not None
    return RigShop(lambda rig: replace(job, rig=rig).reel_of(source), fit, given=given)


def workshop(job: View, reel: SourceReel) -> Workshop[View] | None:
    """How the frames of a source are made by other settings; None as for `rig_shop`.

    Args:
        job: the first settings.
        reel: its frames as they are made by these.
    """
    source, frames = reel.origin, reel.source
    if source is None or frames.yields is not StereoFrame:
        return None

    def load(tuned: View) -> Callable[[Frame], Converted]:
        convert: Callable[[Frame], Converted] = ConvertFrame.of(
            tuned.conversion(source), frames
        ).converted
        return convert

    return Workshop(job, load, lambda tuned: measuring(tuned.conversion(source), frames))
