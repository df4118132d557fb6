"""Which scan belongs to which picture of a drive, where only their numbers are known."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.evaluation.compared import against_scan
from pseudolidar.running.progress import FrameProgress
from pseudolidar.sources.kitti.extract import ExtractFrames, KittiExtract
from pseudolidar.sources.source import FrameSource, evenly_placed
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.disparity import DisparityMap

# Scans of so many pictures before and after are tried, each with so many pictures.
FARTHEST, PICTURES = 5, 3
# Fewer points say nothing of a scan.
LEAST_POINTS = 500
# Other numbers are believed where depths differ by so much less with them. KITTI's drive at 13 m/s:
# 1.4 % at the right number, 2.1 and 2.4 % beside it, 3.4 % two off.
CLEARLY = 0.8


@dataclass(frozen=True)
class ScanNumbers:
    """How well scans of other numbers fit.

    Args:
        error_rel: median relative difference of depths by offset: picture n with scan n - offset.
    """

    error_rel: Mapping[int, float]

    @property
    def best(self) -> int:
        """The offset that fits best; equal numbers where none is clearly better than they are."""
        best = min(self.error_rel, key=lambda offset: (self.error_rel[offset], abs(offset)))
        usual = self.error_rel.get(0, np.inf)
        return best if self.error_rel[best] < CLEARLY * usual else 0


def numbered_alone(source: KittiExtract) -> bool:
    """Whether scans of a drive are found by their numbers, as nothing says when they were taken."""
    if source.scan_offset is not None:
        return False
    scans = [files.scan for files in source.open().frames if files.scan is not None]
    return bool(scans) and all(scan.timestamp_ns is None for scan in scans)


def scan_numbers(
    source: KittiExtract, opened: Callable[[KittiExtract], FrameSource], matcher: StereoMatcher
) -> ScanNumbers | None:
    """Compare pictures with the scans of other numbers; None where no scan tells anything.

    Args:
        source: a drive.
        opened: its pairs, with the rig that is asked for.
        matcher: pair to disparity.
    """
    matched: dict[int, DisparityMap] = {}
    error_rel: dict[int, float] = {}
    offsets = range(-FARTHEST, FARTHEST + 1)
    with FrameProgress(len(offsets), what="numbers of scans") as progress:
        for offset in offsets:
            numbered = replace(source, scan_offset=offset)
            pairs, scanned = opened(numbered), _with_scan(numbered.open())
            differences = _differences(pairs, scanned, matcher, matched)
            if np.isfinite(differences).sum() >= LEAST_POINTS:
                error_rel[offset] = float(np.nanmedian(differences))
            progress.advance()
    return ScanNumbers(error_rel) if error_rel else None


def _differences(
    pairs: FrameSource,
    scanned: Sequence[int],
    matcher: StereoMatcher,
    matched: dict[int, DisparityMap],
) -> Float64:
    """(N,) relative differences of depths; `matched` keeps what is matched, for other scans."""
    differences = [np.empty(0)]
    for index in scanned:
        try:
            frame = pairs.load(index)
            if index not in matched:
                matched[index] = matcher(frame)
            compared = against_scan(matched[index], frame)
        except PseudolidarError:
            continue
        known = compared.matched
        depth_m, reference_m = compared.depth_m[known], compared.reference_m[known]
        differences.append(np.abs(depth_m - reference_m) / reference_m)
    return np.concatenate(differences)


def _with_scan(frames: ExtractFrames) -> tuple[int, ...]:
    """Some of the frames that have a scan, evenly."""
    scanned = [index for index, files in enumerate(frames.frames) if files.scan is not None]
    return tuple(scanned[place] for place in evenly_placed(len(scanned), most=PICTURES))
