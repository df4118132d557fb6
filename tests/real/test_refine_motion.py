"""Offset and rows of KITTI's rigs without a LiDAR, against surveyed poses and Velodyne."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from pseudolidar.calibration.motion import Motion
from pseudolidar.calibration.motion_fit import MotionFit
from pseudolidar.calibration.motion_scale import ScaleFrom
from pseudolidar.calibration.rows import fit_rows, row_points
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.projection import project_scan
from pseudolidar.geometry.rows import rows_aligned
from pseudolidar.geometry.tracking import MatchedPair
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.source import pairs_of
from pseudolidar.stereo.census import Census
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame


@dataclass(frozen=True, eq=False)
class Drive:
    frames: list[StereoFrame]
    maps: list[DisparityMap]
    pairs: list[MatchedPair]

    @classmethod
    def of(cls, path, count):
        source, match = pairs_of(recognise(str(path)).open()), Census("fine").load()
        frames = [source.load(i) for i in range(count)]
        maps = [match(frame) for frame in frames]
        pairs = [MatchedPair.of(*each) for each in zip(frames, maps, strict=True)]
        return cls(frames, maps, pairs)

    def motion(self, *, scale: ScaleFrom = "auto") -> MotionFit:
        estimator = Motion(scale=scale).load(self.frames[0].rig, len(self.frames))
        for position, (frame, pair) in enumerate(zip(self.frames, self.pairs, strict=True)):
            survey = frame.pose and (frame.pose @ left_in_base_link(frame.rig)).matrix
            estimator.add(position, pair, survey)
        return estimator.fit()


@pytest.fixture(scope="module")
def odometry(real_data):
    return Drive.of(real_data / "kitti_odometry", 24)


@pytest.fixture(scope="module")
def raw(real_data):
    return Drive.of(real_data / "kitti_raw", 10)


@pytest.mark.real
def test_the_offset_of_odometry_06(odometry):
    """Against surveyed poses: all 51 frames give -0.095 px and a bend of -1.02."""
    fit = odometry.motion()
    assert fit.by_poses_px == (pytest.approx(-0.095, abs=0.06), pytest.approx(-1.02, abs=0.3))
    assert fit.offset_px == pytest.approx(fit.by_poses_px[0], abs=2 * fit.sigma_px)
    assert fit.sigma_px < 0.08
    assert fit.bend_px == pytest.approx(-1.02, abs=0.3)
    assert fit.step_m == pytest.approx(3.6, abs=0.1)


@pytest.mark.real
def test_the_offset_of_drive_0002_takes_far_bias_away(raw):
    """Velodyne on 22 frames of other drives: -0.47 px at the centre, -1.17 x^2 to the sides."""
    fit = raw.motion()
    assert fit.offset_px == pytest.approx(-0.47, abs=fit.sigma_px)
    sides = fit.correction.coefficients[4]
    assert sides == pytest.approx(-1.17, abs=0.3)
    before, after = (bias(raw, correction, 50, 80) for correction in (None, fit.correction))
    assert before > 0.05
    assert abs(after) < 0.6 * before


@pytest.mark.real
@pytest.mark.parametrize("scale", ["poses", pytest.param("near", marks=pytest.mark.slow)])
def test_near_depths_of_drive_0002_get_no_worse(raw, scale):
    """The offset alone makes 0.5 % of bias at 5 to 10 m 2.0, and 0.4 % at 10 to 20 m 2.3."""
    fit = raw.motion(scale=scale)
    assert fit.scale.by == scale
    for near_m, far_m, worse in ((5, 10, 0.002), (10, 20, 0.006), (20, 30, 0.004)):
        before, after = (bias(raw, each, near_m, far_m) for each in (None, fit.correction))
        assert abs(after) < abs(before) + worse


@pytest.mark.real
def test_near_depths_tell_of_the_scale_what_surveys_say(raw, odometry):
    """Two drives, two surveys: 1.5 and 0.4 % by poses, 2.4 and 0.6 % by what stays."""
    for drive in (raw, odometry):
        poses, near = (drive.motion(scale=by) for by in ("poses", "near"))
        unsure = poses.as_dict()["scale_sigma_rel"]
        assert poses.scale.factor == pytest.approx(near.scale.factor, abs=1.5 * unsure)


def bias(drive, correction, near_m, far_m):
    """Median relative depth error against Velodyne, between two depths."""
    errors = []
    for frame, disparity in zip(drive.frames, drive.maps, strict=True):
        rig, scan = frame.rig, project_scan(frame.scan, frame.rig)
        u, v = np.rint(scan.uv).astype(int).T
        d = disparity.values[v, u].astype(float)
        if correction is not None:
            d = d - correction.offset_px(d, u.astype(float), v.astype(float), rig.left.size_px)
        relative = rig.fB_px_m / d / scan.depth_m - 1
        errors.append(relative[np.isfinite(d) & (scan.depth_m > near_m) & (scan.depth_m < far_m)])
    return float(np.median(np.concatenate(errors)))


@pytest.mark.real
def test_rows_put_right_give_density(odometry):
    fit = fit_rows([row_points(pair) for pair in odometry.pairs[::3]])
    assert fit.before_px > 0.45
    assert fit.after_px < 0.22
    match = Census().load()
    density = []
    for frame in odometry.frames[1::8]:  # not among those fitted to
        aligned = replace(frame, right=rows_aligned(frame.right, fit.correction))
        density.append([match(each).valid.mean() for each in (frame, aligned)])
    before, after = np.mean(density, axis=0)
    assert after > before + 0.025


@pytest.mark.real
def test_pictures_of_different_places_are_no_motion(real_data):
    from pseudolidar.errors import MotionInsufficient

    with pytest.raises(MotionInsufficient, match="only 0 motions"):
        Drive.of(real_data / "kitti_stereo2015", 9).motion()
