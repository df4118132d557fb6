"""The calibration doctor before a run: a few pairs are looked at, as the run will look at them."""

from __future__ import annotations

import logging
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

from pseudolidar.calibration.check import (
    PairCheck,
    check_pair,
    combined,
    seen_rotation,
    stopping,
)
from pseudolidar.calibration.check_eyes import EYES
from pseudolidar.calibration.check_finding import SUREST, Finding
from pseudolidar.calibration.check_rotation import rotation_found
from pseudolidar.calibration.check_rows import ROWS
from pseudolidar.calibration.drift import EyeRotation
from pseudolidar.errors import CalibrationSizeMismatch, NotRectified, PseudolidarError, printable
from pseudolidar.running.crew.attempt import Done, Skipped
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.crew.in_flight import InFlight
from pseudolidar.running.nearness import Searching, nearest_found
from pseudolidar.running.stream import stream
from pseudolidar.sources.body import parts_of
from pseudolidar.sources.other_rig import replaced_rig
from pseudolidar.sources.rectified import exchanged, in_one_view, raw_rig
from pseudolidar.sources.selection import whole
from pseudolidar.sources.source import FrameSequence, evenly_placed, pairs_of
from pseudolidar.sources.swapped import EXCHANGED
from pseudolidar.structures.arrays import Image
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import Frame

_log = logging.getLogger(__name__)
SIZE, DATE, AS_READ = "size", "date of calibration", "as read"
# Pairs that are looked at: the first, the middle, the last.
LOOKED_AT = 3
# Looking at a pair takes 0.2 s; one that is not there in this time will be missed in its turn.
CHECK_TIMEOUT_S = 20.0
# What a source warns of begins like this; of a calibration of another day, it goes on like that.
WARNING = "warning: "
OTHER_DAY = re.compile(r"the (?:rig|calibration) is of [0-9]")


@dataclass(frozen=True)
class CheckFrame:
    """Looks at one pair; pure, picklable.

    Args:
        own_rig: the source's own rig, where another one replaces it.
        neighbours: where the pictures before and after come from; None to look at the pair alone.
    """

    own_rig: StereoRig | None = None
    neighbours: FrameSequence[StereoFrame] | None = None

    def __call__(self, frame: StereoFrame) -> PairCheck:
        """Everything that the pair shows."""
        before, after = self._right_of(frame.index - 1), self._right_of(frame.index + 1)
        return check_pair(frame, own_rig=self.own_rig, before=before, after=after)

    def _right_of(self, index: int) -> Image | None:
        if self.neighbours is None or not 0 <= index < len(self.neighbours.ids):
            return None
        try:
            return self.neighbours.load(index).right
        except PseudolidarError:
            return None  # it is refused in its turn


@dataclass(frozen=True, eq=False)
class SourceCheck:
    """What the pairs of a source show together.

    Args:
        findings: one for each thing that was looked at.
        pairs: what each pair shows.
        failed: pairs that could not be looked at.
        source: what was looked at, one line.
        path: of it.
        rotation: how the right eye is turned against its rig; None where pairs do not tell.
    """

    findings: tuple[Finding, ...]
    pairs: tuple[PairCheck, ...]
    failed: tuple[Skipped, ...]
    source: str
    path: str
    rotation: EyeRotation | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """A line for each finding that is worth one."""
        return tuple(finding.line for finding in self.findings if finding.severity == "warn")

    @property
    def error(self) -> PseudolidarError | None:
        """What stops a run on this source."""
        for frame in self.failed:
            if isinstance(frame.error, CalibrationSizeMismatch) and not self.pairs:
                return frame.error
        error = stopping(self.findings)
        pairs = ", ".join(pair.id for pair in self.pairs)
        return error and error.located(self.path, f"frames {pairs}")


def check_source(
    source: FrameSequence[Frame],
    indices: Sequence[int] | None = None,
    *,
    crew: CrewPlan,
    neighbours: bool = False,
    timeout_s: float = CHECK_TIMEOUT_S,
    in_flight: InFlight | None = None,
    exchanging: bool = True,
    searching: Searching | None = None,
) -> SourceCheck:
    """Look at some pairs of a source.

    Args:
        source: of pairs.
        indices: which; by default the first, the middle and the last.
        crew: how frames are done: a picture that crashes or hangs a library does so here, too.
        neighbours: look at the pictures before and after each of them, too; else only where
            that could explain what a pair shows.
        timeout_s: a pair that takes longer is not looked at; the crew's limit counts as well.
        in_flight: where the frames are noted that could take this process with them.
        exchanging: where rows of unrectified pairs are off, look at them exchanged, too.
        searching: what a run will look for, to tell whether it will find what is near.

    Raises:
        NoPairs: the source has none.
    """
    pairs = pairs_of(source)
    chosen = evenly_placed(len(pairs.ids), most=LOOKED_AT) if indices is None else indices
    crew = replace(
        crew,
        workers=1 if crew.isolate else min(crew.count, max(1, len(chosen))),
        timeout_s=min(crew.timeout_s, timeout_s),
    )
    own_rig, around = replaced_rig(source), pairs_of(whole(source))
    alone, beside = CheckFrame(own_rig), CheckFrame(own_rig, around)
    checked: dict[str, PairCheck] = {}
    failed: list[Skipped] = []

    def look(names: Sequence[str], at: CheckFrame) -> None:
        others = frozenset(pairs.ids) - frozenset(names)
        for outcome in stream(pairs, at, crew=crew, skip=others, in_flight=in_flight):
            if isinstance(outcome, Done):
                checked[outcome.id] = outcome.value
            elif outcome.index is not None and outcome.id not in checked:
                failed.append(outcome)

    look([pairs.ids[index] for index in chosen], beside if neighbours else alone)
    suspicious = [name for name, pair in checked.items() if pair.suspicious]
    if suspicious:
        look(suspicious, beside)
    found = list(checked.values())
    if EXCHANGED in source.summary.notes:
        found = [replace(pair, findings=_not_swapped(pair.findings)) for pair in found]
    rotation = seen_rotation(found)
    turned = (rotation_found(rotation, pairs.rig),) if found else ()
    near = nearest_found(found, pairs, searching) if found and searching is not None else None
    findings = (*_sizes(pairs.rig, found, failed), *_dates(source), *combined(found), *turned)
    findings += () if near is None else (near,)
    line, path = source.summary.line, source.summary.path
    check = SourceCheck(findings, tuple(found), tuple(failed), line, path, rotation)
    if exchanging and isinstance(check.error, NotRectified) and raw_rig(source) is not None:
        return _unless_exchanged(check, source, crew)
    return check


def _unless_exchanged(
    check: SourceCheck, source: FrameSequence[Frame], crew: CrewPlan
) -> SourceCheck:
    """What was found, or that the eyes are exchanged, which rectification turns into odd rows."""
    names = {pair.id for pair in check.pairs}
    indices = [index for index, name in enumerate(source.ids) if name in names]
    other = check_source(exchanged(source), indices, crew=crew, exchanging=False)
    meet = any(f.name == ROWS and f.severity in ("good", "warn") for f in other.findings)
    if other.error is not None or not meet:  # pairs that tell nothing of rows prove nothing
        return check
    told = EXCHANGED in source.summary.notes
    finding = Finding(
        EYES,
        "stop",
        "rows meet only if the pictures are exchanged before they are rectified",
        SUREST,
        "Leave --swap out." if told else "Pass --swap.",
    )
    kept = tuple(found for found in check.findings if found.name in (SIZE, DATE, AS_READ))
    return replace(check, findings=(*kept, finding), rotation=None)


def preflight(
    source: FrameSequence[Frame],
    *,
    wanted: bool,
    crew: CrewPlan,
    in_flight: InFlight | None = None,
    mends: Collection[str] = (),
    searching: Searching | None = None,
) -> tuple[str, ...]:
    """Look at the first, the middle and the last pair before a run; the warnings, which are logged.

    Sources of other things than pairs and rendered worlds are not looked at.

    Args:
        source: what the run will read.
        wanted: whether to look at all.
        crew: what the run will be done with.
        in_flight: where frames are noted while they are looked at.
        mends: names of what the run is there to put right: it neither stops nor warns.
        searching: what disparities the run will look for; None where it looks for none.

    Raises:
        PairSwapped, NotRectified, CalibrationSizeMismatch: the pairs would make no metres.
    """
    source = in_one_view(source)
    if wanted and source.yields is BodyFrame:
        of_part = partial(
            preflight,
            wanted=True,
            crew=crew,
            in_flight=in_flight,
            mends=mends,
            searching=searching,
        )
        return tuple(
            f"{name}: {warning}"
            for name, part in parts_of(source).items()
            for warning in of_part(part)
        )
    if not wanted or source.yields is not StereoFrame or source.summary.kind == "synthetic":
        return ()
    check = check_source(source, crew=crew, in_flight=in_flight, searching=searching)
    kept = tuple(finding for finding in check.findings if finding.name not in mends)
    check = replace(check, findings=kept)
    for line in check.warnings:
        _log.warning("check: %s", printable(line))
    if check.error is not None:
        raise check.error
    return check.warnings


def _not_swapped(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """What to do about swapped eyes where they are swapped already."""
    return tuple(
        replace(f, mend="Leave --swap out.") if f.name == EYES and f.severity == "stop" else f
        for f in findings
    )


def _sizes(
    rig: StereoRig, found: Sequence[PairCheck], failed: Sequence[Skipped]
) -> tuple[Finding, ...]:
    width, height = rig.left.size_px
    wrong = [frame for frame in failed if isinstance(frame.error, CalibrationSizeMismatch)]
    if not wrong:
        if not found:
            return ()
        width, height = found[0].matches.size_px
        return (Finding(SIZE, "good", f"{width}x{height}, as the calibration"),)
    error = wrong[0].error
    text = f"{error.got}; the calibration is for {error.want}"
    if found:
        text += f"; {len(wrong)} of {len(wrong) + len(found)} pairs"
    return (Finding(SIZE, "warn" if found else "stop", text, SUREST, error.fix),)


def _dates(source: FrameSequence[Frame]) -> tuple[Finding, ...]:
    notes = (note for note in source.summary.notes if note.startswith(WARNING))
    return tuple(_noted(note.removeprefix(WARNING)) for note in notes)


def _noted(text: str) -> Finding:
    if OTHER_DAY.match(text):
        return Finding(DATE, "warn", text, None, "Give the rig of that day.")
    return Finding(AS_READ, "warn", text, None, "Mend the file that it is about.")
