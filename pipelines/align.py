"""Find where the stereo pairs of one body stand to each other, from what they see in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from pseudolidar.calibration.overlap import Overlap, Trust
from pseudolidar.calibration.overlap_board import SharedBoard
from pseudolidar.calibration.overlap_fit import PlaceFound, places_found
from pseudolidar.errors import ALL_DONE, SOME_SKIPPED, UsageError
from pseudolidar.formats.rigs.body_json import write_body
from pseudolidar.running.aligning import FrameSights, SeeBoard, SeeFrame
from pseudolidar.running.bad_frames import OnError, good_frames
from pseudolidar.running.crew.attempt import Skipped
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.field_markers import RUN_ONLY, THIS_TIME, Recognised
from pseudolidar.running.nearness import Searching
from pseudolidar.running.preflight import preflight
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.rig_output import check_rig_place, stored
from pseudolidar.running.stream import stream
from pseudolidar.running.table import table_text
from pseudolidar.sources.body import body_of, rectified_place
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import FrameSequence, tell
from pseudolidar.stereo.balance import BalanceWhen
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.eyes import Eyes
from pseudolidar.stereo.row_alignment import RowsWhen
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.structures.body import BodyRig
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import Frame

# Shorter lengths are told in millimetres.
LEAST_CM_M = 0.01


@dataclass(frozen=True)
class Align:
    """Fit the places of the pairs of a body to what neighbours see in common.

    SOURCE is a folder with a rig.json of several pairs and a folder for each; the places in it are
    where the search begins, right to some degrees and decimetres. One pair stays where it is.
    Neighbours share surfaces of any scene, or a board that is held where both see it. The
    result tells how sure each place is; what a scene does not hold is refused and not guessed. A
    dozen frames at different places, with walls at several distances, are enough; who moves while
    the pictures of a moment are not quite of one moment aligns that motion, too.

        pseudolidar align drone --out drone/rig.json --overwrite
        pseudolidar align crawler --out rig.json --frames 0::20 --root left
        pseudolidar align boards --by shared-board --by.board charuco:8x6 --by.square 0.03

    Args:
        source: pairs of several rigs on one body.
        out: the rig file with the places found.
        root: the pair that stays; by default the first.
        by: what neighbours share: `overlap` (surfaces) or `shared-board`.
        trust: how well the places given are known, and how sure the result must be.
        matcher: how disparities are found; boards need none.
        rows: bring the rows of the right picture to those of the left one before matching: `auto`
            where points that both eyes see show that they differ, `never`.
        balance: give the right picture the brightness, colours, gamma and vignetting of the left
            one before matching: `auto` for matchers that compare brightness (all but census) where
            the eyes differ, `always`, `never`.
        frames: only these: slices 100:400:2, ids 13,35, or @FILE with such items.
        exclude: not these.
        rig: rig file of the pairs that replaces the folder's.
        min_depth: nearest depth that must be found, m.
        check: look at the first, the middle and the last frame of each pair before.
        workers: frames worked on at the same time; by default one per core.
        on_error: skip a bad frame (and stop when they become many), or stop at the first.
        overwrite: replace OUT, if that is a rig file; it is kept as OUT's name with .previous.
    """

    source: Annotated[Source, Recognised(recognise)]
    out: Annotated[Path, RUN_ONLY] = Path("rig.json")
    root: str | None = None
    by: Overlap | SharedBoard = field(default_factory=Overlap)
    trust: Trust = field(default_factory=Trust)
    matcher: Census | Sgbm | Bm = field(default_factory=lambda: Census(quality="fine"))
    rows: RowsWhen = "auto"
    balance: BalanceWhen = "auto"
    frames: FrameSelection | None = None
    exclude: FrameSelection | None = None
    rig: Path | None = None
    min_depth: float | None = None
    check: Annotated[bool, RUN_ONLY] = True
    workers: Annotated[int | None, RUN_ONLY] = None
    on_error: Annotated[OnError, RUN_ONLY] = "skip"
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False


def run(job: Align) -> AlignReport:
    """See every frame with every pair, fit, write the rig.

    Raises:
        UsageError: OUT is there already, or no pair has the name of the root.
        NoPairs: the source is not several pairs on one body.
        OverlapInsufficient: what is seen does not tell a place.
    """
    check_rig_place(job.out, overwrite=job.overwrite)
    source, crew = opened(job), CrewPlan(job.workers)
    body = body_of(source)
    root = _root(body, job.root)
    searching = Searching(job.matcher, job.min_depth)
    warnings = preflight(source, wanted=job.check, crew=crew, searching=searching)
    given = {pair.name: rectified_place(pair) for pair in body.pairs}
    see: SeeFrame | SeeBoard
    if isinstance(job.by, SharedBoard):
        see = SeeBoard(job.by, given)
    else:
        see = SeeFrame.of(
            source, job.matcher, job.by, eyes=Eyes(job.rows, job.balance), min_depth_m=job.min_depth
        )
    seen, skipped = _seen(source, see, crew, job.on_error)
    found = places_found([frame.sights for frame in seen], given, root, job.by, job.trust)
    line = source.summary.line
    placed = _with_places(body, given, found, line)
    previous = stored(job.out, lambda: write_body(job.out, placed))
    return AlignReport(line, job.out, root, found, len(seen), warnings, skipped, previous)


def _seen(
    source: FrameSequence[Frame], see: SeeFrame | SeeBoard, crew: CrewPlan, on_error: OnError
) -> tuple[list[FrameSights], tuple[Skipped, ...]]:
    seen, skipped = list[FrameSights](), list[Skipped]()
    total = len(source.ids)
    with FrameProgress(total) as progress:

        def skip(frame: Skipped) -> None:
            skipped.append(frame)
            progress.skip()

        outcomes = stream(source, see, crew=crew)
        for done in good_frames(outcomes, frames=total, on_error=on_error, skipped=skip):
            seen.append(done.value)
            progress.advance()
    return seen, tuple(skipped)


def _root(body: BodyRig, wanted: str | None) -> str:
    if len(body.pairs) < 2:
        raise UsageError("one pair alone", want="two or more pairs on one body")
    if wanted is not None and wanted not in body.names:
        raise UsageError(f"no pair {wanted!r}", want=" or ".join(body.names), where="--root")
    return wanted or body.names[0]


def _with_places(
    body: BodyRig, given: Mapping[str, Pose], found: Mapping[str, PlaceFound], line: str
) -> BodyRig:
    """The body with the places found; of unrectified pairs those of their own left cameras."""
    pairs = []
    for pair in body.pairs:
        if pair.name in found:
            place = found[pair.name]
            T_seen_left = given[pair.name].inverse() @ pair.T_base_link_left
            pairs.append(
                replace(
                    pair,
                    T_base_link_left=place.T_base_link_left @ T_seen_left,
                    rotation_sigma_rad=place.rotation_sigma_rad,
                    translation_sigma_m=place.translation_sigma_m,
                )
            )
        else:
            pairs.append(pair)
    return BodyRig(tuple(pairs), f"{body.origin or 'places given'}, aligned on {line}")


def opened(job: Align) -> FrameSequence[Frame]:
    """The frames that are asked for."""
    source = select(opened_with_rig(job.source, job.rig), job.frames, job.exclude)
    tell(source)
    return source


@dataclass(frozen=True, eq=False)
class AlignReport:
    """Where the pairs stand, and how sure that is.

    Args:
        subject: what was looked at, one line.
        out: the rig file.
        root: the pair that stayed.
        found: places of the others, by their names.
        frames: how many were used.
        warnings: what is odd about the pairs.
        skipped: frames that could not be used.
        previous: where the rig file is that `out` replaced; None where there was none.
    """

    subject: str
    out: Path
    root: str
    found: Mapping[str, PlaceFound]
    frames: int
    warnings: tuple[str, ...] = ()
    skipped: tuple[Skipped, ...] = ()
    previous: Path | None = None

    @property
    def exit_code(self) -> int:
        """4 if frames were skipped, else 0."""
        return SOME_SKIPPED if self.skipped else ALL_DONE

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "subject": self.subject,
            "out": str(self.out),
            "previous": None if self.previous is None else str(self.previous),
            "root": self.root,
            "frames": self.frames,
            "pairs": {name: _figures(place) for name, place in self.found.items()},
            "warnings": list(self.warnings),
            "skipped": [{"id": each.id, **each.error.as_dict()} for each in self.skipped],
        }

    def text(self) -> str:
        """For people."""
        rows = [(self.root, "stays", "", "", "", "")]
        rows += [
            (
                name,
                f"{_length(place.moved_m)}, {place.turned_deg:.2f} deg",
                _length(place.translation_sigma_m.max()),
                f"{np.degrees(place.rotation_sigma_rad.max()):.2f} deg",
                f"{place.matches} ({place.share:.0%})",
                f"{_length(place.before_m)} -> {_length(place.after_m)}",
            )
            for name, place in self.found.items()
        ]
        header = ("pair", "moved", "known to", "and to", "points in common", "apart (median)")
        parts = [self.subject, table_text(rows, header=header)]
        parts += [f"warning: {text}" for text in self.warnings]
        parts += [f"left out: {each.id}: {each.error}" for each in self.skipped]
        parts.append(f"{self.out}: {self.frames} frames; pass it to other commands with --rig")
        if self.previous is not None:
            parts.append(f"  the one before: {self.previous}")
        return "\n".join(parts)


def _length(metres: float) -> str:
    """Boards tell places to fractions of a millimetre, surfaces to centimetres."""
    return f"{metres * 1000:.1f} mm" if metres < LEAST_CM_M else f"{metres * 100:.1f} cm"


def _figures(place: PlaceFound) -> dict[str, Any]:
    return {
        "T_base_link_left": place.T_base_link_left.matrix,
        "moved_m": place.moved_m,
        "turned_deg": place.turned_deg,
        "translation_sigma_m": place.translation_sigma_m,
        "rotation_sigma_deg": np.degrees(place.rotation_sigma_rad),
        "matches": place.matches,
        "share": place.share,
        "residual_before_m": place.before_m,
        "residual_m": place.after_m,
    }
