"""Which video belongs to which eye, and which of their frames are of one moment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pseudolidar.errors import ImageMissing, PseudolidarError, SourceEmpty
from pseudolidar.formats.video.kind import EXTENSIONS, video_kind
from pseudolidar.sources.names import natural_key
from pseudolidar.sources.pairing import FOLDER_NUMBERS, LETTERS, NUMBERED, WORDS
from pseudolidar.structures.arrays import Int64

RULES = (WORDS, LETTERS, NUMBERED, *FOLDER_NUMBERS)
# Eyes that were triggered together differ less than this; more could be the next frame.
LARGEST_TOLERANCE_S, TOLERANCE_OF_INTERVAL = 0.010, 0.25


def videos_in(folder: Path) -> list[Path]:
    """Videos of a folder in numeric order: named and beginning like one."""
    try:
        files = [file for file in folder.iterdir() if file.suffix.lower() in EXTENSIONS]
    except OSError:
        return []
    files.sort(key=lambda file: natural_key(file.name))
    return [file for file in files if not file.name.startswith(".") and video_kind(file)]


def eyes_among(videos: Sequence[Path]) -> list[tuple[Path, Path, str]]:
    """Pairs of videos whose names differ by an eye's mark alone: left, right, rule in words."""
    for rule in RULES:
        right = dict(rule.keys(videos, "right"))
        found = [
            (path, right[key], rule.text)
            for key, path in rule.keys(videos, "left")
            if key in right and right[key] != path
        ]
        if found:
            return found
    return []


def partner_of(video: Path) -> tuple[Path, Path, str] | None:
    """The pair that a video named like an eye's forms with the one beside it."""
    pairs = eyes_among(videos_in(video.parent))
    return next((pair for pair in pairs if video.name in (pair[0].name, pair[1].name)), None)


@dataclass(frozen=True, eq=False)
class Moments:
    """Frames of two videos, put together by time.

    Args:
        left: (N,) int64, frame of the left video of each pair.
        right: (N,) int64, frame of the right one.
        ids: of the pairs; moments are numbered in order, those of one eye alone included.
        alone: frames of one eye alone, with the reason.
        tolerance_ns: largest difference within a pair.
        largest_ns: largest difference that there is.
    """

    left: Int64
    right: Int64
    ids: tuple[str, ...]
    alone: tuple[tuple[str, PseudolidarError], ...]
    tolerance_ns: int
    largest_ns: int


def pair_moments(
    left_ns: Sequence[int],
    right_ns: Sequence[int],
    *,
    tolerance_s: float | None,
    files: tuple[Path, Path],
) -> Moments:
    """Pair each left frame with the right one nearest in time, if each is the other's nearest.

    Args:
        left_ns: increasing times of the left frames.
        right_ns: of the right frames, by the same clock.
        tolerance_s: largest difference; None for a quarter of a frame's interval, at most 10 ms.
        files: left and right video, for errors.

    Raises:
        SourceEmpty: no two frames are of one moment.
    """
    left, right = np.array(left_ns, np.int64), np.array(right_ns, np.int64)
    tolerance_ns = _tolerance_ns(left, right) if tolerance_s is None else round(tolerance_s * 1e9)
    to_right, to_left = _nearest(left, right), _nearest(right, left)
    apart = np.abs(right[to_right] - left)
    own = np.arange(len(left))
    paired = (apart <= tolerance_ns) & (to_left[to_right] == own)
    partner = to_right[paired]
    lonely_right = np.setdiff1d(np.arange(len(right)), partner)
    # Of one moment the left eye's time counts.
    times = np.concatenate([left, right[lonely_right]])
    number = np.empty(len(times), np.int64)
    number[np.argsort(times, kind="stable")] = np.arange(len(times))
    names = [f"{n:06d}" for n in number]
    alone = [
        (names[i], _alone(files, "right", left[i], right[to_right[i]], tolerance_ns))
        for i in own[~paired]
    ] + [
        (names[len(left) + k], _alone(files, "left", right[j], left[to_left[j]], tolerance_ns))
        for k, j in enumerate(lonely_right)
    ]
    if not paired.any():
        nearest = alone[0][1]
        raise SourceEmpty(
            f"no frame of {len(left)} left and {len(right)} right ones has a partner: "
            f"{nearest.got}",
            want=f"frames within {tolerance_ns / 1e6:.3g} ms",
            fix=nearest.fix,
            path=files[0],
        )
    return Moments(
        left=own[paired],
        right=partner,
        ids=tuple(names[i] for i in own[paired]),
        alone=tuple(sorted(alone, key=lambda item: int(item[0]))),
        tolerance_ns=tolerance_ns,
        largest_ns=int(apart[paired].max(initial=0)),
    )


def _tolerance_ns(left: Int64, right: Int64) -> int:
    steps = [float(np.median(np.diff(times))) for times in (left, right) if len(times) > 1]
    interval_ns = min(steps, default=np.inf)
    return round(min(LARGEST_TOLERANCE_S * 1e9, TOLERANCE_OF_INTERVAL * interval_ns))


def _nearest(times: Int64, others: Int64) -> Int64:
    """(N,) for each time the place of the nearest of the others, the earlier of equals."""
    after = np.searchsorted(others, times).clip(0, len(others) - 1)
    before = (after - 1).clip(0)
    closer = np.abs(others[before] - times) <= np.abs(others[after] - times)
    return np.where(closer, before, after)


def _alone(
    files: tuple[Path, Path], missing: str, time_ns: int, nearest_ns: int, tolerance_ns: int
) -> ImageMissing:
    apart_ms = (int(nearest_ns) - int(time_ns)) / 1e6
    return ImageMissing(
        f"no frame of the {missing} eye belongs to the one at {int(time_ns) / 1e9:.6f} s: the "
        f"nearest is {apart_ms:+.3f} ms away",
        want=f"both eyes within {tolerance_ns / 1e6:.3g} ms",
        fix="Where all are off alike, say so: --source.right-delay-s, or --source.tolerance-s.",
        path=files[1] if missing == "right" else files[0],
    )
