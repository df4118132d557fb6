"""Frames fused with those before them: surer where the world stood still, unchanged where not."""

from __future__ import annotations

import pickle
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import ImageMissing, PoseMissing, StereoConfig
from pseudolidar.evaluation.disparity import disparity_errors
from pseudolidar.evaluation.lidar import scan_samples
from pseudolidar.geometry.frames import BASE_LINK, MAP, left_in_base_link
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.sightings import SPARE, Sightings
from pseudolidar.stereo.filters.temporal import Kalman
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.pose import Pose
from tests.stereo.pairs import frame

HEIGHT, WIDTH = 60, 120
SIGMA_PX = 0.3


class Walls:
    """Frames that look at a wall while they come nearer; noisy maps of it instead of matching."""

    def __init__(self, depth_m=20.0, step_m=0.5, *, moving_m=0.0, poses=True, absent=()):
        self.depth_m, self.step_m, self.moving_m = depth_m, step_m, moving_m
        self.poses, self.absent = poses, absent
        self.loads: list[int] = []

    def load(self, index):
        self.loads.append(index)
        if index in self.absent:
            raise ImageMissing("nothing", path="x.png")
        grey = np.full((HEIGHT, WIDTH), 90, np.uint8)
        pair = frame(grey, grey)
        t_left = np.array([0.0, 0.0, index * self.step_m])
        body = left_in_base_link(pair.rig).matrix[:3, :3] @ t_left
        pose = Pose.from_rotation(MAP, BASE_LINK, np.eye(3), body) if self.poses else None
        return replace(pair, index=index, id=str(index), pose=pose)

    def truth(self, pair, *, thing=False):
        depth_m = self.depth_m - pair.index * self.step_m
        truth = np.full((HEIGHT, WIDTH), pair.rig.fB_px_m / depth_m, np.float32)
        if thing:
            near_m = 8.0 + pair.index * self.moving_m
            truth[20:40, 40:80] = pair.rig.fB_px_m / near_m
        return truth

    def match(self, pair, *, thing=False):
        rng = np.random.default_rng(pair.index)
        truth = self.truth(pair, thing=thing)
        values = truth + rng.normal(0, SIGMA_PX, truth.shape).astype(np.float32)
        return DisparityMap(values, np.full_like(values, SIGMA_PX))


def fused(world, index, *, window=5, match=None):
    matcher = match or world.match
    fuse = Kalman(window=window).load(matcher, world)
    pair = world.load(index)
    return pair, fuse(pair, fuse.sightings(pair))


@pytest.mark.parametrize("window", [2, 5, 8])
def test_noise_falls_where_the_world_stands_still(window):
    world = Walls()
    pair, (out, counts) = fused(world, 9, window=window)
    error = out.values - world.truth(pair)
    inside = np.s_[6:-6, 12:-12]  # the border was not seen before
    assert error[inside].std() < SIGMA_PX * (0.8 if window == 2 else 0.6)
    assert abs(error[inside].mean()) < 0.02
    assert counts["pixels_fused"] > 0.9 * out.values.size
    assert np.mean(out.sigma[inside] < SIGMA_PX) > 0.98  # the others are outliers of the noise
    assert np.mean(np.abs(error[inside]) < out.sigma[inside]) > 0.68


def test_the_first_frame_stays_as_it_is():
    world = Walls()
    pair, (out, counts) = fused(world, 0)
    np.testing.assert_array_equal(out.values, world.match(pair).values)
    assert counts == {"pixels_fused": 0, "pixels_carried_over": 0}


def test_what_moves_does_not_smear():
    """A thing that keeps its distance while the camera drives: by the poses it should be nearer."""
    world = Walls(moving_m=0.0)
    pair, (out, _) = fused(world, 6, match=lambda p: world.match(p, thing=True))
    measured = world.match(pair, thing=True)
    thing = np.s_[20:40, 40:80]
    np.testing.assert_array_equal(out.values[thing], measured.values[thing])
    np.testing.assert_array_equal(out.sigma[thing], measured.sigma[thing])


def holed(world, index, *, holes):
    """The map of a frame, with a hole in frame `holes`."""

    def match(pair):
        found = world.match(pair)
        if pair.index == holes:
            found.values[25:35, 50:70] = np.nan
            found.sigma[25:35, 50:70] = np.nan
        return found

    return fused(world, index, match=match)


def test_a_hole_takes_what_earlier_frames_agree_upon():
    world = Walls(step_m=0.1)  # so little that no pixel is skipped by the growing picture
    pair, (out, counts) = holed(world, 6, holes=6)
    hole = np.s_[25:35, 50:70]
    assert np.isfinite(out.values[hole]).mean() > 0.9
    assert np.nanmax(np.abs(out.values - world.truth(pair))[hole]) < 5 * SIGMA_PX
    assert np.nanmin(out.sigma[hole]) > SIGMA_PX
    assert counts["pixels_carried_over"] == np.isfinite(out.values[hole]).sum()


def test_earlier_frames_that_disagree_fill_nothing():
    world = Walls(step_m=0.1)

    def match(pair):
        found = holed_map(world, pair)
        return replace(found, values=found.values + (pair.index % 5) * 8)

    def holed_map(world, pair):
        found = world.match(pair)
        if pair.index == 6:
            found.values[25:35, 50:70] = np.nan
        return found

    _, (out, counts) = fused(world, 6, match=match)
    assert counts["pixels_carried_over"] == 0
    assert np.isnan(out.values[25:35, 50:70]).all()


def test_the_rigs_systematic_error_is_taken_off_before_metres_are_compared():
    """A wall with an offset of 3 px: without the correction its depth and motion are wrong."""
    world = Walls(step_m=1.0)
    correction = DisparityCorrection(np.array([3.0, 0, 0, 0, 0, 0, 0, 0, 0, 0]), 0.1)

    class Corrected(Walls):
        def load(self, index):
            pair = super().load(index)
            return replace(pair, rig=pair.rig.with_correction(correction))

        def match(self, pair, **kwargs):
            found = super().match(pair, **kwargs)
            return replace(found, values=found.values + np.float32(3))

    corrected = Corrected(step_m=1.0)
    pair, (out, _) = fused(corrected, 8)
    inside = np.s_[12:-12, 24:-24]
    assert abs((out.values - 3 - world.truth(pair))[inside].mean()) < 0.03


def test_results_do_not_depend_on_what_was_asked_before_or_on_threads():
    world = Walls()
    alone = {}
    for index in (3, 7, 12):
        alone[index] = fused(Walls(), index)[1].disparity.values.tobytes()
    fuse = Kalman(window=5).load(world.match, world)

    def one(index):
        pair = world.load(index)
        return fuse(pair, fuse.sightings(pair)).disparity.values.tobytes()

    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(one, range(40)))
    assert {i: together[i] for i in alone} == alone
    again = pickle.loads(pickle.dumps(fuse.settings))
    assert one(7) == alone[7]  # long dropped from memory
    assert again == fuse.settings


def test_frames_are_matched_once_and_memory_is_bounded():
    world, matched = Walls(), []
    lock = threading.Lock()

    def match(pair):
        with lock:
            matched.append(pair.index)
        return world.match(pair)

    sightings = Sightings(match, world, window=5)
    for index in range(30):
        sightings(world.load(index))
        for back in range(1, 5):
            sightings.of(index - back)
    assert sorted(matched) == list(range(30))
    assert len(sightings._memo._known) <= 5 + SPARE


def test_a_frame_that_cannot_be_read_is_left_out_of_the_window():
    with_gap = fused(Walls(absent=(7,)), 9)[1]
    assert with_gap.counts["pixels_fused"] > 0
    assert not np.array_equal(with_gap.disparity.values, fused(Walls(), 9)[1].disparity.values)


def test_a_failure_is_tried_again_and_stays_with_who_asked():
    world, tries = Walls(), []

    def match(pair):
        tries.append(pair.index)
        if len(tries) == 1:
            raise ImageMissing("once")
        return world.match(pair)

    sightings = Sightings(match, world, window=3)
    with pytest.raises(ImageMissing):
        sightings(world.load(0))
    assert sightings.of(0) is not None


def test_a_source_without_poses_is_refused():
    world = Walls(poses=False)
    with pytest.raises(PoseMissing, match="without poses"):
        Kalman().load(world.match, world)


@pytest.mark.parametrize("settings", [{"window": 1}, {"window": 65}, {"gate": 0.0}])
def test_settings_that_mean_nothing_are_refused(settings):
    with pytest.raises(StereoConfig):
        Kalman(**settings)


def test_on_a_street_errors_fall_and_sigma_holds():
    source = Synthetic("street", frames=5, width_px=480).open()
    fuse = Kalman(window=4).load(Census(disparities=64).load(), source)
    pair = source.load(4)
    before = fuse.sightings(pair)
    after = fuse(pair, before).disparity
    kept = DisparityMap(np.where(before.valid, after.values, np.float32(np.nan)), after.sigma)
    errors = [disparity_errors(found, pair.truth) for found in (before, kept, after)]
    assert errors[1].epe < 0.97 * errors[0].epe
    assert errors[1].d1_est <= errors[0].d1_est * 1.02
    assert after.density > before.density
    assert errors[2].d1_filled <= 1.02 * errors[0].d1_filled
    both = kept.valid & pair.truth.valid
    assert np.mean(np.abs(kept.values - pair.truth.values)[both] < kept.sigma[both]) > 0.68


@pytest.mark.real
def test_against_velodyne_on_a_drive(real_data):
    source = KittiRaw(str(real_data / "kitti_raw" / "2011_09_26")).open()
    fuse = Kalman().load(Census().load(), source)
    reproject = Reproject(max_range_m=15.0).load()
    noise, thickness = [], []
    for index in (6, 7, 8, 9):
        pair = source.load(index)
        before = fuse.sightings(pair)
        after = fuse(pair, before).disparity
        kept = replace(after, values=np.where(before.valid, after.values, np.float32(np.nan)))
        for found in (before, kept):
            samples = scan_samples(found, pair, frame_number=0)
            # 15 m and more: nearer, errors of the poses weigh as much as those of matching.
            error = (samples.measured - samples.reference)[samples.reference < 25]
            assert len(error) > 3000
            # The stock rig's own error is as large in both.
            noise.append(np.abs(error - np.median(error)).mean())
            thickness.append(ground_thickness_m(reproject(pair, found).xyz))
    before, after = np.reshape(noise, (-1, 2)).mean(axis=0)
    assert after < 0.99 * before
    before, after = np.reshape(thickness, (-1, 2)).mean(axis=0)
    assert after < 0.8 * before


def ground_thickness_m(xyz, *, edge_m=0.4, least=40):
    """Median over cubes of the standard deviation across their level surfaces."""
    cells = np.floor(xyz / edge_m).astype(int)
    order = np.lexsort(cells.T)
    cuts = np.flatnonzero(np.any(np.diff(cells[order], axis=0), axis=1)) + 1
    found = []
    for points in np.split(xyz[order], cuts):
        if len(points) >= least:
            variances, axes = np.linalg.eigh(np.cov(points.T))
            if variances[1] > 4 * variances[0] and abs(axes[1, 0]) > 0.8:
                found.append(np.sqrt(variances[0]))
    return np.median(found)
