"""Files of poses in any form, told by their content: TUM, KITTI, EuRoC."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from pseudolidar.errors import LimitError, PoseFileError, SequenceTime
from pseudolidar.formats.euroc_poses import POSE_COLUMNS, read_euroc_trajectory
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.text import NUMBER, TextLine, read_lines
from pseudolidar.formats.time_table import read_time_table
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.formats.trajectory import read_kitti_poses
from pseudolidar.formats.tum import TRAJECTORY_NUMBERS, read_tum_trajectory
from pseudolidar.structures.arrays import Float64, Int64

TrajectoryForm = Literal["TUM", "KITTI", "EuRoC"]
# The same, or the frames of a source that knows where it was.
PoseForm = Literal["TUM", "KITTI", "EuRoC", "frames"]
KITTI_NUMBERS = 12
KITTI_VERTICAL = 1  # the world is the first camera: x right, y down, z forward
POSE_SUFFIXES = frozenset((".txt", ".csv", ".tum", ".kitti"))
# An hour at 100 Hz is 360 000 poses and 50 MB; the caps of calibrations and labels are narrower.
TRAJECTORY_LIMITS = Limits(text_bytes=200_000_000, text_lines=1_000_000)
# Holds comments, a heading and the first pose; with the mark that some editors put before them.
SNIFFED_BYTES, BOM = 65_536, "\xef\xbb\xbf"
# Coordinates of the whole Earth are nearer to 0, m; squares of larger ones lose their digits.
LARGEST_M = 1e8
# A gap beyond this multiple of the median interval is told.
GAP_RATIO = 3.0


@dataclass(frozen=True, eq=False)
class PoseRecord:
    """What a file of poses says, or a source with poses.

    Args:
        path: the file, or the source.
        form: how it is written.
        T_world_body: (N, 4, 4) float64, metres; of what body the file does not say.
        times_ns: (N,) int64, increasing; None where nobody says when the poses were.
        times_from: the file of the times, where it is another one.
        notes: what is odd, or was assumed.
        vertical: axis of the world (0-2) that stands upright; None where nobody says.
    """

    path: Path
    form: PoseForm
    T_world_body: Float64
    times_ns: Int64 | None
    times_from: Path | None = None
    notes: tuple[str, ...] = ()
    vertical: int | None = None

    def __len__(self) -> int:
        return len(self.T_world_body)


def trajectory_form(path: Path) -> TrajectoryForm | None:
    """How a file of poses is written, by its first line that is no comment; None if it is none."""
    try:
        with path.open("rb") as file:
            head = file.read(SNIFFED_BYTES)
    except OSError:
        return None
    if b"\0" in head:
        return None
    text = head.decode("latin-1").removeprefix(BOM)
    found = [TextLine(path, n, one, PoseFileError) for n, one in enumerate(text.splitlines(), 1)]
    rows = _content(found)
    return _form(rows[0]) if rows else None


def read_trajectory(
    path: Path, *, times: Path | None = None, limits: Limits = TRAJECTORY_LIMITS
) -> PoseRecord:
    """Read a file of poses, whatever its form.

    A KITTI file has no times. They are taken from `times`, else from `NAME_times.txt` or
    `times.txt` beside it, or from `sequences/NAME/times.txt` as KITTI's odometry data has it.

    Args:
        path: TUM (8 numbers a line), KITTI (12) or EuRoC (CSV).
        times: file of the times, one by pose, in place of its own.
        limits: caps on its size.

    Raises:
        PoseFileError: missing file, none of these forms, a bad row, no pose, fewer or more poses
            than times.
        SequenceTime: times that cannot be read, or do not increase.
        LimitError: a file larger than the caps.
    """
    try:
        form, rows = _recognised(path, limits)
        stamps, poses = _READERS[form](path, limits)
        _check_places(poses, rows)
        found = PoseRecord(
            path,
            form,
            poses,
            None if stamps is None else np.array(stamps, np.int64),
            vertical=KITTI_VERTICAL if form == "KITTI" else None,
        )
        if times is not None:
            found = _timed(found, times, limits, strict=True)
        elif found.times_ns is None and (beside := _times_beside(path)) is not None:
            found = _timed(found, beside, limits, strict=False)
    except LimitError as error:
        error.fix = "Cut the file into parts, or leave out every other pose."
        raise
    if found.times_ns is None:
        return found
    # Where times stand in a file of their own, its entries are the lines.
    own = found.times_from is None
    _check_increasing(found.times_from or path, found.times_ns, rows if own else None)
    return replace(found, notes=(*found.notes, *_gap_note(found.times_ns)))


def _recognised(path: Path, limits: Limits) -> tuple[TrajectoryForm, list[TextLine]]:
    rows = _content(read_lines(path, error=PoseFileError, limits=limits))
    wanted = f"TUM ({TRAJECTORY_NUMBERS} numbers a line), KITTI ({KITTI_NUMBERS}) or EuRoC (CSV)"
    if not rows:
        raise PoseFileError("no pose", want=wanted, path=path)
    form = _form(rows[0])
    if form is None:
        count = len(rows[0].words())
        raise rows[0].refusal(f"{count} words: {rows[0].text[:40]!r}", want=wanted)
    return form, rows


def _content(lines: Sequence[TextLine]) -> list[TextLine]:
    rows = [line for line in lines if line.text.strip() and not line.text.lstrip().startswith("#")]
    # EuRoC's heading begins with #; where programs dropped that, it begins with a letter.
    return rows[1:] if rows and "," in rows[0].text and rows[0].text.lstrip()[0].isalpha() else rows


def _form(line: TextLine) -> TrajectoryForm | None:
    """By the count of columns alone: what stands in them its reader judges, by place."""
    if line.text.count(",") >= POSE_COLUMNS - 1:
        return "EuRoC"
    words = line.words()
    if not any(NUMBER.fullmatch(word.text) for word in words):
        return None
    if len(words) == TRAJECTORY_NUMBERS:
        return "TUM"
    return "KITTI" if len(words) == KITTI_NUMBERS else None


_Reader = Callable[[Path, Limits], tuple[Sequence[int] | None, Float64]]
_READERS: dict[TrajectoryForm, _Reader] = {
    "TUM": lambda path, limits: read_tum_trajectory(path, limits=limits),
    "EuRoC": lambda path, limits: read_euroc_trajectory(path, limits=limits),
    "KITTI": lambda path, limits: (None, read_kitti_poses(path, limits=limits)),
}


def _times_beside(path: Path) -> Path | None:
    here = path.resolve().parent
    places = (
        here / f"{path.stem}_times.txt",
        here / "times.txt",
        here.parent / "sequences" / path.stem / "times.txt",
    )
    return next((place for place in places if place.is_file()), None)


def _timed(poses: PoseRecord, times: Path, limits: Limits, *, strict: bool) -> PoseRecord:
    """The poses with times of a file; one that was only found beside them must fit to be taken."""
    table = read_time_table(times, limits=limits)
    stamps = [stamp for stamp in table.stamps_ns if stamp is not None]
    if len(stamps) == len(poses):
        note = f"{poses.path.name}: {table.note}"
        stamps_ns = np.array(stamps, np.int64)
        return replace(poses, times_ns=stamps_ns, times_from=times, notes=(*poses.notes, note))
    counts = f"{len(poses)} poses and {len(stamps)} times"
    if not strict:
        note = f"{poses.path.name}: {counts} in {times.name} beside it, which are not used"
        return replace(poses, notes=(*poses.notes, note))
    raise PoseFileError(
        f"{counts} of {times.name}",
        want="one time for each pose",
        fix="Pass the times of this file.",
        path=poses.path,
        where=f"pose {min(len(poses), len(stamps)) + 1}",
    )


def _check_places(T_world_body: Float64, rows: Sequence[TextLine]) -> None:
    far = np.flatnonzero(np.abs(T_world_body[:, :3, 3]).max(axis=1) > LARGEST_M)
    if len(far):
        place = ", ".join(f"{value:g}" for value in T_world_body[far[0], :3, 3])
        raise rows[int(far[0])].refusal(
            f"pose {far[0]} (from 0) at {place} m", want=f"metres, within {LARGEST_M:g}"
        )


def _check_increasing(path: Path, times_ns: Int64, rows: Sequence[TextLine] | None) -> None:
    wrong = np.flatnonzero(np.diff(times_ns) <= 0)
    if not len(wrong):
        return
    index = int(wrong[0]) + 1
    step_s = int(times_ns[index] - times_ns[index - 1]) / NS_PER_S
    told = f"{-step_s:.9g} s before the one before it" if step_s else "that of the one before it"
    more = f"; {len(wrong)} such in all" if len(wrong) > 1 else ""
    raise SequenceTime(
        f"the time of pose {index} (from 0) is {told}{more}",
        want="increasing times",
        fix="Sort the file by time, and leave one of each time.",
        path=path,
        where=f"entry {index + 1}" if rows is None else f"line {rows[index].number}",
    )


def _gap_note(times_ns: Int64) -> tuple[str, ...]:
    if len(times_ns) < 3:
        return ()
    steps = np.diff(times_ns)
    usual = float(np.median(steps))
    gaps = np.flatnonzero(steps > GAP_RATIO * usual)
    if not len(gaps):
        return ()
    widest = int(steps.argmax())
    return (
        f"{len(gaps)} gap(s) of more than {GAP_RATIO:g} times the usual {usual / NS_PER_S:.3g} s, "
        f"the widest {steps[widest] / NS_PER_S:.3g} s after pose {widest} (from 0)",
    )
