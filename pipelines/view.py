"""Look at everything in a browser."""

from __future__ import annotations

import contextlib
import re
import sys
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

# The package path of pipelines/ is made at run time; mypy checks the file itself.
from pseudolidar.pipelines.convert import Convert, ConvertFrame  # type: ignore[import-untyped]
from pseudolidar.pipelines.convert import opened as opened_source

from pseudolidar.clouds.ground_fit import GroundFit
from pseudolidar.clouds.outliers import Lonely
from pseudolidar.errors import ALL_DONE, UsageError
from pseudolidar.formats.rigs.rig_reading import RigUnit
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY
from pseudolidar.running.matching import MatchFrame, Refining
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.sighting import SMALL_THINGS_KEPT, Seen, SightFrame
from pseudolidar.running.signals import Stopped
from pseudolidar.sources.recognise import Source
from pseudolidar.sources.scans_put_right import Scans, with_scans_put_right
from pseudolidar.sources.selection import FrameSelection
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
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import DepthFrame, Frame
from pseudolidar.viewer.address import LOOPBACK, Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.exporting import check_export, export
from pseudolidar.viewer.opening import Opened, Opening
from pseudolidar.viewer.reel import SourceReel
from pseudolidar.viewer.tuning.tuner import Workshop

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
        pseudolidar view out/drive --no-browser --port 9000
        pseudolidar view out/drive --host 0.0.0.0 --named robot.lan
        pseudolidar view out/map.ply --export map.html
        pseudolidar view drive --settings settings.json

    Args:
        paths: several at once: sources (KITTI data, folders, videos, recordings, synthetic:NAME),
            folders that a run wrote, files of clouds, trajectories.
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
        port: to listen at, 0 for any that is free.
        host: to listen at; others than 127.0.0.1 let other machines in, which still need the token.
        named: a name that this machine has in the addresses of browsers, where that is neither
            localhost nor an IP number: behind a proxy, or in your network. Others are refused.
        share: refused: a public tunnel shows the token and all pictures to whoever runs it.
        browser: open the page.
        export: serve nothing, and write what there is to see, all frames of it, to one file that
            opens without a server: scene.html, or scene.viser for viser's own player.
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
    port: Annotated[int, RUN_ONLY] = 8080
    host: Annotated[str, RUN_ONLY] = LOOPBACK
    named: Annotated[str | None, RUN_ONLY] = None
    share: Annotated[bool, RUN_ONLY] = False
    browser: Annotated[bool, RUN_ONLY] = True
    export: Annotated[Path | None, RUN_ONLY] = None

    def __post_init__(self) -> None:
        if self.share:
            raise UsageError(
                "a public tunnel, whose keeper would see the token and every picture",
                want="a way on which nobody reads along",
                fix=f"Forward the port: ssh -L {self.port}:localhost:{self.port} THIS-MACHINE.",
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
        job = self.conversion(source)
        opened = with_scans_put_right(opened_source(job), Scans())  # as `compare` does
        return SourceReel(opened, ConvertFrame.of(job, opened).converted)


def run(job: View) -> ViewReport:
    """Serve until somebody ends it: Ctrl-C, or the terminal that it runs in is closed.

    Raises:
        SourceUnknown: a path is nothing that can be looked at.
        ServeError: the address cannot be had.
    """
    if job.export is not None:
        check_export(job.export)
    sources: list[Source] = []

    def reel_of(source: Source) -> SourceReel:
        sources.append(source)
        return job.reel_of(source)

    opened = Opening(reel_of).all_of(job.paths)
    if job.export is not None:
        with App.made(Address(port=0), opened) as app:
            export(app, job.export)
        return ViewReport(job.export)
    shop = workshop(job, sources[0], opened) if sources else None
    # Ctrl-C is the ordinary way out, and no interruption.
    with (
        contextlib.suppress(Stopped),
        App.served(job.address, opened, measuring(job, opened), shop) as app,
    ):
        print(app.url, file=sys.stderr, flush=True)  # noqa: T201 - printed at once, not at the end
        if job.browser:
            webbrowser.open(app.url)
        app.wait()
    return ViewReport()


def measuring(job: View, opened: Opened) -> Callable[[Frame], Seen] | None:
    """What things in pictures are measured by, as `measure` does; None where there are none."""
    reel = opened.reels[0] if opened.reels else None
    if not isinstance(reel, SourceReel) or reel.source.yields not in (StereoFrame, DepthFrame):
        return None
    eyes = Eyes(job.rows, job.balance)
    match = MatchFrame.load(reel.source, job.matcher, Refining(), SMALL_THINGS_KEPT, eyes=eyes)
    return SightFrame.of(match, GroundFit())


def workshop(job: View, source: Source, opened: Opened) -> Workshop[View] | None:
    """How the first source's frames are made by other settings; None where it has no pairs.

    Args:
        job: the first settings.
        source: that was opened first.
        opened: all that there is.
    """
    reel = opened.reels[0]
    if not isinstance(reel, SourceReel) or reel.source.yields is not StereoFrame:
        return None
    frames = reel.source

    def load(tuned: View) -> Callable[[Frame], Converted]:
        convert: Callable[[Frame], Converted] = ConvertFrame.of(
            tuned.conversion(source), frames
        ).converted
        return convert

    def sighted(tuned: View) -> Callable[[Frame], Seen]:
        found = measuring(tuned, opened)
        assert found is not None  # it has pairs
        return found

    return Workshop(job, load, sighted)


@dataclass(frozen=True)
class ViewReport:
    """What is left of it.

    Args:
        file: what was exported.
    """

    file: Path | None = None
    exit_code = ALL_DONE

    def as_dict(self) -> dict[str, Any]:
        """Where it is."""
        return {"file": None if self.file is None else str(self.file)}

    def text(self) -> str:
        """The same."""
        return "" if self.file is None else f"  {self.file}"
