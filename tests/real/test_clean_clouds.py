"""What cleaning must do on KITTI: ghosts fall, good points and objects stay."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.calibration.refine import fit
from pseudolidar.evaluation.ghosts import GHOST_M, GHOST_REL, judge_points
from pseudolidar.evaluation.lidar import scan_samples
from pseudolidar.evaluation.scan_surface import ScanSurface
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.clean import Clean
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.samples import DisparitySamples

EVERY_NTH = 4


@pytest.fixture(scope="module")
def matched(real_data) -> list[tuple[StereoFrame, DisparityMap]]:
    """Every fourth frame with its disparity, on a rig refined by frames in between."""
    source = KittiStereo(str(real_data / "kitti_stereo2015")).open()
    matcher = Census().load()
    others = [source.load(i) for i in range(2, len(source.ids), EVERY_NTH)]
    samples = [scan_samples(matcher(f), f, frame_number=i) for i, f in enumerate(others)]
    correction = fit(DisparitySamples.concatenate(samples))
    found = []
    for i in range(0, len(source.ids), EVERY_NTH):
        frame = source.load(i)
        frame = replace(frame, rig=frame.rig.with_correction(correction))
        found.append((frame, matcher(frame)))
    return found


def pixels_by_verdict(matched) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Pixels of stray and of good points to 30 m, and why cleaning removed pixels."""
    cleaner, reproject = Clean().load(), Reproject(max_range_m=30.0).load()
    for frame, disparity in matched:
        cloud = reproject(frame, disparity)
        verdict = judge_points(cloud, frame, ScanSurface.of(frame))
        masks = []
        for chosen in (verdict.stray, verdict.judged & ~verdict.stray):
            mask = np.zeros(disparity.values.shape, bool)
            column, row = np.rint(cloud.uv[chosen]).astype(int).T
            mask[row, column] = True
            masks.append(mask)
        yield masks[0], masks[1], cleaner(frame, disparity).reason


@pytest.mark.real
def test_ghosts_to_30_m_fall_to_a_third_and_good_points_stay(matched):
    stray, stray_left, good, good_left = 0, 0, 0, 0
    for bad, right, reason in pixels_by_verdict(matched):
        stray, good = stray + bad.sum(), good + right.sum()
        stray_left += (bad & (reason == 0)).sum()
        good_left += (right & (reason == 0)).sum()
    assert stray > 1000
    assert good > 500_000
    assert stray_left / stray < 1 / 3
    assert good_left / good > 0.90


@pytest.mark.real
def test_pixels_of_cars_stay(matched, real_data):
    cleaner = Clean().load()
    there, left = 0, 0
    for frame, disparity in matched:
        fB_px_m = frame.rig.fB_px_m
        path = real_data / "kitti_stereo2015" / "training" / "obj_map" / f"{frame.id}.png"
        cars = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) > 0
        depth_m, true_m = fB_px_m / disparity.values, fB_px_m / frame.truth.values
        right = cars & (np.abs(depth_m - true_m) <= GHOST_M + GHOST_REL * true_m) & (true_m < 30)
        there += right.sum()
        left += (right & (cleaner(frame, disparity).reason == 0)).sum()
    assert there > 20_000
    assert left / there > 0.88  # 90.6 % on all 22 frames
