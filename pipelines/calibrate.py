"""Calibrate two cameras from pictures of a board; the rig file is taken by every other verb."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pseudolidar.calibration.boards.board import Board, BoardName, Dictionary
from pseudolidar.calibration.solving.calibrated import ModelChoice, calibrate
from pseudolidar.calibration.solving.left_out import LeftOut
from pseudolidar.calibration.solving.observations import LEAST_CORNERS, Observations
from pseudolidar.calibration.solving.solve import LEAST_VIEWS, Solution, Views
from pseudolidar.errors import BoardNotFound
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.board_search import Looked, boards_in
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.field_markers import RUN_ONLY, THIS_TIME, Recognised
from pseudolidar.running.new_file import check_kind, check_new_file, is_text
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.reports.calibration_page import (
    SHOWN_PAIRS,
    ShownPair,
    calibration_page,
)
from pseudolidar.running.reports.calibration_report import CalibrateReport
from pseudolidar.running.rig_output import check_rig_place, store_rig
from pseudolidar.sources.bare_films import Films, recognise_bare
from pseudolidar.sources.bare_pairs import BarePairs, Pictures
from pseudolidar.sources.selection import FrameSelection
from pseudolidar.sources.source import evenly_placed


@dataclass(frozen=True)
class Calibrate:
    """Calibrate two cameras from pairs of pictures of a board, and write the rig file.

    Every pair is looked at; the lens model is the one that predicts views best that were held out
    of the fit. Pairs that disagree with the others are left out with the reason, and each eye is
    used alone. Exchanged eyes are found and exchanged back. Standard deviations, rows on held-out
    views, coverage and the depth error to expect say what the result is worth; a poor one is called
    poor, with what to do next.

    Metres follow from --square: measure the printed board over many squares.

        pseudolidar calibrate pictures --board chessboard:9x6 --square 0.025 --out rig.json
        pseudolidar calibrate left.mp4 --board charuco:8x6 --square 0.03 --marker 0.022
        pseudolidar calibrate pictures --board circles:9x7 --square 0.02 --report report.html
        pseudolidar convert drive out --rig rig.json

    Args:
        source: pairs of pictures in folders, two videos, or one with both eyes. Of films the views
            are taken in which the board is held still, sharp, and where it was not before.
        board: kind and counts: `chessboard:9x6` (inner corners), `charuco:8x6` (squares),
            `circles:7x6`, `acircles:4x11` (asymmetric), `aprilgrid:6x6` (tags).
        square: side of a square, m; distance of neighbouring circles, of asymmetric ones that of
            neighbouring rows; side of an AprilGrid's tag.
        marker: side of a ChArUco marker, m (by default 3/4 of the square); gap between the tags of
            an AprilGrid (0.3 of the tag).
        dictionary: of the markers: 4x4, 5x5 (ChArUco's default), 6x6, 7x7 or 36h11 (AprilTags).
        model: of the lenses: `pinhole` (5 coefficients), `pinhole8`, `thin-prism` (12), `fisheye`;
            `auto` tries pinhole, fisheye and pinhole8.
        out: the rig file.
        report: a page with plots of all this, such as report.html.
        frames: only these pairs: slices 100:400:2, ids 13,35, or @FILE with such items.
        exclude: not these.
        workers: pairs looked at at the same time; by default one per core.
        overwrite: replace OUT, if that is a rig file; it is kept as OUT's name with .previous.
            Replace the page.
    """

    source: Annotated[Pictures | Films, Recognised(recognise_bare)]
    board: BoardName
    square: float
    marker: float | None = None
    dictionary: Dictionary | None = None
    model: ModelChoice = "auto"
    out: Annotated[Path, RUN_ONLY] = Path("rig.json")
    report: Annotated[Path | None, RUN_ONLY] = None
    frames: FrameSelection | None = None
    exclude: FrameSelection | None = None
    workers: Annotated[int | None, RUN_ONLY] = None
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False


def run(job: Calibrate) -> CalibrateReport:
    """Find the board in every pair, solve, judge, write the rig.

    Raises:
        UsageError: OUT is there already, or a board that cannot be.
        BoardNotFound: too few pairs in which both eyes see the board.
    """
    board = Board.of(job.board, job.square, marker_m=job.marker, dictionary=job.dictionary)
    check_rig_place(job.out, overwrite=job.overwrite)
    if job.report is not None:
        check_new_file(job.report, overwrite=job.overwrite, flag="--report")
        check_kind(job.report, is_text, "page", flag="--report")
    pairs = job.source.open().chosen(job.frames, job.exclude)
    crew = CrewPlan(job.workers)
    looked = boards_in(pairs, board, crew)
    views, unseen = views_of(looked, board, pairs)
    with FrameProgress(3 if job.model == "auto" else 1, what="models") as progress:
        calibration = calibrate(views, job.model, tried=progress.advance)
    previous = store_rig(job.out, calibration.rig)
    report = CalibrateReport(pairs, calibration, unseen, looked, job.out, previous, job.report)
    if job.report is not None:
        shown = shown_pairs(pairs, calibration.solution)
        page = calibration_page(calibration, pairs.summary.line, report.left_out, shown)
        write_atomic(job.report, page)
    return report


def shown_pairs(pairs: BarePairs, solution: Solution) -> list[ShownPair]:
    """Some of the pairs that tie the eyes together, the eyes in their true order."""
    place = {name: index for index, name in enumerate(pairs.ids)}
    shown = []
    for chosen in evenly_placed(len(solution.paired), most=SHOWN_PAIRS):
        pair = pairs.load(place[solution.views.ids[solution.paired[chosen]]])
        eyes = (pair.right, pair.left) if solution.swapped else (pair.left, pair.right)
        shown.append(ShownPair(chosen, *eyes))
    return shown


def views_of(looked: Looked, board: Board, pairs: BarePairs) -> tuple[Views, tuple[LeftOut, ...]]:
    """The pairs in which an eye sees the board, and why others are left out.

    Raises:
        BoardNotFound: both eyes see it in too few.
    """
    found = looked.found
    left_out: list[LeftOut] = []
    sizes = Counter(seen.sizes_px for seen in found)
    usual = sizes.most_common(1)[0][0] if sizes else ((0, 0), (0, 0))
    used = []
    for seen in found:
        parts = (seen.left, seen.right)
        missing = [
            eye
            for eye, part in zip(("left", "right"), parts, strict=True)
            if part is None or len(part) < LEAST_CORNERS
        ]
        if seen.sizes_px != usual:
            left_out.append(LeftOut(seen.id, f"pictures of {_sizes(seen.sizes_px)}, where the "
                                    f"others have {_sizes(usual)}"))  # fmt: skip
            continue
        if missing:
            eyes = "neither eye sees" if len(missing) == 2 else f"the {missing[0]} eye does not see"
            left_out.append(LeftOut(seen.id, f"{eyes} the board"))
        if len(missing) < 2:
            used.append(seen)
    both = [seen for seen in used if seen.left is not None and seen.right is not None]
    if len(both) < LEAST_VIEWS:
        left, right = (sum(seen.eyes[eye] is not None for seen in used) for eye in range(2))
        raise BoardNotFound(
            f"both eyes see the {board.name} in {len(both)} of {len(found)} pairs (left {left}, "
            f"right {right})" + "".join(f"; {note}" for note in looked.notes),
            want=f"{LEAST_VIEWS} pairs or more, better 20",
            fix="Check --board: chessboards count inner corners, ChArUco boards squares. Take "
            "pictures in which both eyes see all of the board, sharp and lit evenly.",
            path=pairs.summary.path,
        )
    observations = Observations.of(board.points_m, [(seen.left, seen.right) for seen in used])
    return Views(board, tuple(s.id for s in used), observations, usual), tuple(left_out)


def _sizes(sizes_px: tuple[tuple[int, int], tuple[int, int]]) -> str:
    return " and ".join(f"{width}x{height}" for width, height in dict.fromkeys(sizes_px))
