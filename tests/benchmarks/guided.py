"""Clouds guided by few beams of a Velodyne, judged by the beams that none of them uses; their time.

    python -m tests.benchmarks.guided [--picture FILE.png]

KITTI frames with a scan (stereo 2015, raw drive 0002), matched by `Census`, cleaned. Stock is the
rig as it came; refined is corrected by a fit to all beams of every second frame, judged on the
others. Guided clouds use some beams of the frame itself. All are judged at the same points: those
of lasers that belong to none of the patterns, projected into the left image. Depth errors relative
to the Velodyne, pooled over frames: median, in brackets the signed median. Then the time of one
frame of 64 x 1024 points, and of all its pixels, beside that of matching.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from pseudolidar.calibration.refine import fit
from pseudolidar.clouds.correct import Scan, corrected
from pseudolidar.evaluation.lidar import cloud_against_scan, scan_samples
from pseudolidar.evaluation.ranges import RANGE_BINS_M, errors_by_range
from pseudolidar.geometry.lasers import of_beams
from pseudolidar.running.memory import keep_freed_memory
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.sources.scans_put_right import Scans, with_scans_put_right
from pseudolidar.sources.source import FrameSource, pairs_of
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.clean import Clean
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import LidarScan, StereoFrame
from pseudolidar.structures.samples import DisparitySamples
from tests.conftest import DATA

FOUR, LEVEL, SIXTEEN = Scan(beams=4), Scan(beams=4, pattern="level"), Scan(beams=16)
USED = (FOUR, LEVEL, SIXTEEN)
ROWS: tuple[tuple[str, bool, Scan | None], ...] = (
    ("stock", False, None),
    ("refined", True, None),
    ("stock + 4 beams", False, FOUR),
    ("stock + 4 level beams", False, LEVEL),
    ("stock + 16 beams", False, SIXTEEN),
    ("refined + 4 beams", True, FOUR),
    ("refined + 4 level beams", True, LEVEL),
    ("refined + 16 beams", True, SIXTEEN),
)
SIXTY_FOUR_BY_1024, ROUNDS = 64 * 1024, 5
# From above: 80 m ahead, 20 m to each side, at so many px a metre.
AHEAD_M, ASIDE_M, PX_PER_M = 80.0, 20.0, 16


@dataclass(frozen=True, eq=False)
class Matched:
    """A frame with its disparity, raw and cleaned, and what the other frames say of the rig."""

    frame: StereoFrame
    raw: DisparityMap
    disparity: DisparityMap
    correction: DisparityCorrection | None = None

    def cloud(self, *, refined: bool) -> tuple[StereoFrame, PointCloud]:
        """The frame on one of the rigs, and its cloud."""
        rig = self.frame.rig.with_correction(self.correction if refined else None)
        frame = replace(self.frame, rig=rig)
        return frame, Reproject().load()(frame, self.disparity)


def matched_frames(source: FrameSource, *, step: int = 1) -> Iterator[Matched]:
    """Every `step`-th frame."""
    matcher, cleaner = Census().load(), Clean().load()
    for index in range(0, len(source.ids), step):
        frame = source.load(index)
        disparity = matcher(frame)
        yield Matched(frame, disparity, cleaner(frame, disparity).disparity)


def with_corrections(frames: list[Matched]) -> list[Matched]:
    """The same with corrections, fitted to the even and the odd ones for the others."""
    samples = [scan_samples(m.raw, m.frame, frame_number=i) for i, m in enumerate(frames)]
    corrections = [fit(DisparitySamples.concatenate(samples[k::2])) for k in (1, 0)]
    return [replace(m, correction=corrections[i % 2]) for i, m in enumerate(frames)]


def unused_beams(scan: LidarScan) -> LidarScan:
    """The points of the lasers that no pattern uses."""
    used = [of_beams(scan.xyz, each.beams, pattern=each.pattern) for each in USED]
    return LidarScan(scan.xyz[~np.logical_or.reduce(used)], timestamp_ns=scan.timestamp_ns)


def errors(matched: Matched, *, refined: bool, guide: Scan | None) -> np.ndarray:
    """(2, N) depth of the cloud and of the unused beams."""
    frame, cloud = matched.cloud(refined=refined)
    if guide is not None:
        cloud, _ = corrected(cloud, frame, guide)
    assert frame.scan is not None
    pairs = cloud_against_scan(cloud, replace(frame, scan=unused_beams(frame.scan)))
    return np.stack([pairs.depth_m, pairs.reference_m])


def print_table(name: str, frames: list[Matched]) -> None:
    """Errors by range of every row."""
    bins = "".join(f"{low:>9}-{high} m     " for low, high in RANGE_BINS_M)
    print(f"{name}, {len(frames)} frames\n{'':24}{bins}")
    for label, refined, guide in ROWS:
        pooled = [errors(each, refined=refined, guide=guide) for each in frames]
        found = errors_by_range(*np.concatenate(pooled, axis=1))
        cells = "".join(
            f"   {each.median_rel:6.2%} ({each.bias_rel:+6.2%})" if each.n else f"{'-':>19}"
            for each in found
        )
        print(f"{label:24}{cells}", flush=True)
    print(f"{'points judged':24}" + "".join(f"{each.n:>19}" for each in found))


def least_s(work: Callable[[], object]) -> float:
    """Least CPU seconds of one thread."""
    seconds = []
    for _ in range(ROUNDS):
        begin = time.thread_time()
        work()
        seconds.append(time.thread_time() - begin)
    return min(seconds)


def print_times(matched: Matched) -> None:
    """CPU seconds of a frame, of 64 x 1024 points and of all."""
    cv2.setNumThreads(1)
    frame, whole = matched.cloud(refined=False)
    matcher = Census().load()
    print(f"matching {least_s(lambda: matcher(frame)):.2f} s")
    some = whole[np.linspace(0, len(whole) - 1, SIXTY_FOUR_BY_1024).astype(np.int64)]
    for cloud in (some, whole):
        for guide in (FOUR, SIXTEEN, Scan()):
            seconds = least_s(lambda c=cloud, g=guide: corrected(c, frame, g))  # type: ignore[misc]
            print(f"{len(cloud)} points, {guide.beams} beams: {seconds:.2f} s")


def draw(matched: Matched, path: Path) -> None:
    """The cloud from above before and after 4 beams, with the whole scan over it."""
    frame, cloud = matched.cloud(refined=False)
    assert frame.scan is not None
    assert frame.rig.T_left_velodyne is not None
    scan = frame.rig.T_left_velodyne.apply(frame.scan.xyz.astype(np.float64))
    panels = []
    for title, each in (
        ("stock", cloud),
        ("stock + 4 beams", corrected(cloud, frame, FOUR)[0]),
        ("stock + 16 beams", corrected(cloud, frame, SIXTEEN)[0]),
    ):
        panel = np.zeros((int(2 * ASIDE_M * PX_PER_M), int(AHEAD_M * PX_PER_M), 3), np.uint8)
        for xyz, colour in ((each.xyz, (130, 110, 90)), (scan, (60, 255, 255))):
            upright = xyz[(xyz[:, 1] < 1.2) & (xyz[:, 1] > -1.0) & (xyz[:, 2] > 0)]
            row = ((upright[:, 0] + ASIDE_M) * PX_PER_M).astype(int)
            column = (upright[:, 2] * PX_PER_M).astype(int)
            inside = (row >= 0) & (row < len(panel)) & (column < panel.shape[1])
            panel[row[inside], column[inside]] = colour
        cv2.putText(panel, title, (10, 40), cv2.FONT_HERSHEY_SIMPLEX, 1.2, (255, 255, 255), 2)
        panels += [panel, np.full_like(panel[:4], 255)]
    cv2.imwrite(str(path), np.concatenate(panels))


def main() -> None:
    """Print the tables, and draw where asked to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--picture", type=Path)
    asked = parser.parse_args()
    keep_freed_memory()
    drive = DATA / "kitti_raw" / "2011_09_26" / "2011_09_26_drive_0002_sync"
    stereo = with_corrections(
        list(matched_frames(KittiStereo(str(DATA / "kitti_stereo2015")).open()))
    )
    print_table("KITTI stereo 2015", stereo)
    source = pairs_of(with_scans_put_right(KittiRaw(str(drive)).open(), Scans()))
    raw = with_corrections(list(matched_frames(source)))
    print_table("KITTI raw, drive 0002", raw)
    print_times(stereo[0])
    if asked.picture is not None:
        draw(stereo[7], asked.picture)


if __name__ == "__main__":
    main()
