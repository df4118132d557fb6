"""The frames that settings are judged on, and what they are compared with there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pseudolidar.errors import PseudolidarError, ReferenceMissing, SourceEmpty
from pseudolidar.evaluation.blind import PairEvidence, judged_by_pair
from pseudolidar.evaluation.compared import projected
from pseudolidar.evaluation.matching_loss import (
    Judgement,
    as_the_rig_has_it,
    judged_by_reference,
)
from pseudolidar.geometry.rectified_pixels import unmasked
from pseudolidar.geometry.triangulation import disparity_from_depth
from pseudolidar.running.comparing.references import OwnReference
from pseudolidar.running.crew.attempt import Skipped
from pseudolidar.sources.selection import whole
from pseudolidar.sources.source import FrameSource
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.structures.arrays import Bool, Float32, Image
from pseudolidar.structures.frame import PairMask, StereoFrame

By = Literal["auto", "truth", "scan", "pairs"]
# Frames that are held back, as a share; they are the last ones, as neighbours are alike.
HELD_SHARE = 0.4
# A single pair is judged in so many strips: every other one is held back.
STRIPS = 8


@dataclass(frozen=True, eq=False)
class JudgedFrame:
    """One frame, or every other strip of it.

    Args:
        id: of the frame, and which strips.
        frame: the pair.
        rows: (H,) rows that count.
        reference: (H, W) px, disparities that the rig has for what is known; None where the pair
            itself is all there is.
        evidence: what the pair tells, else.
        following: the next pair, where it shows the same.
    """

    id: str
    frame: StereoFrame
    rows: Bool
    reference: Float32 | None
    evidence: PairEvidence | None = None
    following: StereoFrame | None = None

    def __call__(self, matcher: StereoMatcher) -> Judgement:
        """How good the matcher's map is; raises as the matcher does."""
        values = _matched(matcher, self.frame)
        if self.reference is not None:
            return judged_by_reference(values, self.reference, self.rows)
        assert self.evidence is not None
        of_right = _matched(matcher, mirrored(self.frame))[:, ::-1]
        then = None if self.following is None else _matched(matcher, self.following)
        return judged_by_pair(self.evidence, values, of_right, then, self.rows)


def mirrored(frame: StereoFrame) -> StereoFrame:
    """The pair in a mirror, eyes exchanged: its left disparities are those of the right eye."""
    left: Image = frame.right[:, ::-1].copy()
    right: Image = frame.left[:, ::-1].copy()
    mask = frame.mask and PairMask(frame.mask.right[:, ::-1], frame.mask.left[:, ::-1])
    pair = StereoFrame(left, right, frame.rig, frame.id, frame.index, frame.timestamp_ns)
    return replace(pair, mask=mask)


def _matched(matcher: StereoMatcher, frame: StereoFrame) -> Float32:
    """(H, W) px, of what both pictures show."""
    return unmasked(matcher(frame), frame.mask).values


@dataclass(frozen=True, eq=False)
class JudgedFrames:
    """All that settings are judged on.

    Args:
        by: what they are compared with.
        tuned_on: what the search sees.
        held: what it does not.
        skipped: frames that would have been in one of them, but cannot be read.
    """

    by: str
    tuned_on: tuple[JudgedFrame, ...]
    held: tuple[JudgedFrame, ...]
    skipped: tuple[Skipped, ...] = ()

    @classmethod
    def of(
        cls, source: FrameSource, by: By, start: StereoMatcher, *, tuned_on: int, held: int
    ) -> JudgedFrames:
        """Load and prepare them.

        Args:
            source: where they come from.
            by: what settings are compared with; `auto` for the best that there is.
            start: the settings that the search starts from; the rig's error is told by them.
            tuned_on: how many frames at most.
            held: how many frames at most are held back.

        Raises:
            ReferenceMissing: the frames do not have what is asked for.
            SourceEmpty: not one frame can be read.
        """
        first, last = halves(len(source.ids), tuned_on, held)
        skipped: list[Skipped] = []
        frames = {
            index: frame for index in (*first, *last) if (frame := _read(source, index, skipped))
        }
        if not frames:
            raise SourceEmpty("no pair that can be read", want="some", path=source.summary.path)
        chosen = by if by != "auto" else _best(list(frames.values()))
        parts = [
            [
                JudgedFrame(frame.id, frame, np.ones(frame.size_px[1], bool), None)
                for index in indices
                if (frame := frames.get(index))
            ]
            for indices in (first, last)
        ]
        if not all(parts):
            every = [part for each in parts for part in each]
            first, last = halves(len(every), tuned_on, held)
            parts = [[every[i] for i in first], [every[i] for i in last]]
            if len(every) == 1:
                parts = [[half] for half in _strips(every[0])]
        ready = [tuple(_prepared(each, chosen, start, source)) for each in parts]
        if not all(ready):
            raise ReferenceMissing(
                f"{source.summary.line}: too few frames with a {chosen} to judge settings by",
                want="one to tune on and one to hold back",
                fix="Choose other frames, or --by pairs, which needs pairs only.",
            )
        return cls(chosen, ready[0], ready[1], tuple(skipped))


def halves(frames: int, tuned_on: int, held: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Positions of the frames to tune on, and of those to hold back, which come after them.

    Args:
        frames: how many there are.
        tuned_on: most positions to tune on.
        held: most positions to hold back.
    """
    first_held = frames if frames < 2 else min(frames - 1, round(frames * (1 - HELD_SHARE)))
    return _spread(0, first_held, tuned_on), _spread(first_held, frames, held)


def _spread(begin: int, end: int, most: int) -> tuple[int, ...]:
    n = min(end - begin, most)
    return tuple(begin + (2 * step + 1) * (end - begin) // (2 * n) for step in range(n))


def _read(source: FrameSource, index: int, skipped: list[Skipped]) -> StereoFrame | None:
    try:
        return source.load(index)
    except PseudolidarError as error:
        skipped.append(Skipped(source.ids[index], index, error))
        return None


def _best(frames: Sequence[StereoFrame]) -> str:
    """What most of the frames have."""
    for kind in ("truth", "scan"):
        having = sum(_reference(frame, kind) is not None for frame in frames)
        if 2 * having > len(frames):
            return kind
    return "pairs"


def _reference(frame: StereoFrame, kind: str) -> StereoFrame | None:
    if kind == "truth":
        return OwnReference("truth")(frame)
    found = OwnReference("auto")(replace(frame, truth=None))
    if found is None or found.scan is None or found.rig.T_left_velodyne is None:
        return None
    return found


def _strips(alone: JudgedFrame) -> tuple[JudgedFrame, ...]:
    """Every other strip of a single pair to tune on, the others to hold back."""
    strip = np.arange(len(alone.rows)) * STRIPS // len(alone.rows) % 2
    return tuple(
        replace(alone, id=f"{alone.id} {name} strips", rows=strip == number)
        for number, name in enumerate(("even", "odd"))
    )


def _prepared(
    parts: Sequence[JudgedFrame], by: str, start: StereoMatcher, source: FrameSource
) -> Iterator[JudgedFrame]:
    for part in parts:
        if by == "pairs":
            following = _following(source, part.frame)
            evidence = PairEvidence.of(part.frame, following)
            seen = following if evidence.follows else None
            yield replace(part, evidence=evidence, following=seen)
            continue
        found = _reference(part.frame, by)
        if found is None:
            continue
        reference = as_the_rig_has_it(reference_px(found), _matched(start, part.frame))
        if np.isfinite(reference[part.rows]).any():
            yield replace(part, reference=reference)


def reference_px(frame: StereoFrame) -> Float32:
    """(H, W) px, disparities that the truth of a frame has, or its scan calls for."""
    if frame.truth is not None:
        return frame.truth.values
    scan = projected(frame)
    width, height = frame.size_px
    column, row = np.rint(scan.uv).astype(np.intp).T
    true_px = disparity_from_depth(scan.depth_m, column.astype(np.float64), frame.rig)
    values = np.full((height, width), np.nan, np.float32)
    values[row, column] = true_px
    return values


def _following(source: FrameSource, frame: StereoFrame) -> StereoFrame | None:
    every = whole(source)
    if frame.index + 1 >= len(every.ids):
        return None
    try:
        return every.load(frame.index + 1)
    except PseudolidarError:
        return None
