import numpy as np
import pytest

from pseudolidar.evaluation.cloud_distances import cloud_distances, in_view
from pseudolidar.evaluation.comparison.bins import DepthBins
from pseudolidar.evaluation.comparison.clouds import compare_clouds

BINS = DepthBins((5, 10, 20))


def wall(x_m: float, *, step_m: float = 0.05, half_m: float = 2.0) -> np.ndarray:
    side = np.arange(-half_m, half_m + step_m / 2, step_m)
    y, z = np.meshgrid(side, side)
    return np.stack([np.full(y.size, x_m), y.ravel(), z.ravel()], axis=1)


def compared(*frames):
    distances = [cloud_distances(*frame) for frame in frames]
    return compare_clouds(distances, subject="", reference="", bins=BINS)


def test_parallel_walls_by_hand():
    found = compared((wall(8.15), wall(8.0))).overall.figures
    # each point has its neighbour straight ahead, but for those beyond the other's border
    assert found["accuracy_median_m"] == pytest.approx(0.15)
    assert found["completeness_median_m"] == pytest.approx(0.15)
    assert found["chamfer_m"] == pytest.approx(0.15, abs=0.002)
    assert (found["precision_0_1"], found["recall_0_1"], found["f_score_0_1"]) == (0, 0, 0)
    assert (found["precision_0_2"], found["f_score_0_5"]) == (1, 1)


def test_a_hole_costs_completeness_and_no_accuracy():
    full = wall(8.0)
    holed = full[full[:, 1] ** 2 + full[:, 2] ** 2 > 1.0]  # in the middle, of radius 1 m
    found = compared((holed, full)).overall.figures
    assert found["accuracy_m"] == 0
    share = np.pi / 16  # of the wall is hole
    # within 0.1 m of its border the hole is covered
    assert found["recall_0_1"] == pytest.approx(1 - share * 0.9**2, abs=0.01)
    assert found["precision_0_1"] == 1
    recall = found["recall_0_1"]
    assert found["f_score_0_1"] == pytest.approx(2 * recall / (1 + recall))


def test_sensors_that_look_backwards_or_apart():
    behind = wall(8.0) * np.array([-1, 1, 1])  # across the border of azimuths
    inside = in_view(np.concatenate([behind, wall(8.0), wall(8.0)[:, [1, 0, 2]]]), of=behind)
    assert inside[: len(behind)].mean() > 0.95
    assert not inside[len(behind) :].any()
    apart = cloud_distances(wall(8.0), behind)
    assert len(apart.accuracy_m) == len(apart.completeness_m) == 0


def test_what_only_one_sensor_reaches_does_not_count():
    seen = wall(8.0)
    beside = seen + np.array([0, 6, 0])
    full = np.concatenate([seen, wall(-8.0), beside, wall(30.0)])
    inside = in_view(full, of=seen)
    assert inside[: len(seen)].mean() > 0.95  # some at the very border are left out
    assert not inside[len(seen) :].any()


def test_every_bin_is_listed_with_intervals_over_frames():
    every = compared((wall(8.1), wall(8.0)), (wall(8.3), wall(8.0)))
    near, far = every.as_dict()["bins"]
    assert (near["from_m"], near["to_m"], far["from_m"], far["to_m"]) == (5, 10, 10, 20)
    assert near["n"] > 1000
    low, high = near["intervals"]["accuracy_m"]
    assert low == pytest.approx(0.1, abs=0.01)
    assert high == pytest.approx(0.3, abs=0.01)
    assert (far["n"], far["accuracy_m"], far["f_score_0_1"]) == (0, None, None)


def test_nothing_to_compare_with():
    found = compared((wall(8.0), np.empty((0, 3)))).overall
    assert (found.n, found.reference, found.figures["chamfer_m"]) == (0, 0, None)


def test_not_finite_points_are_left_out_and_few_are_asked_about():
    cloud = np.concatenate([wall(8.0), np.full((5, 3), np.nan)])
    few = cloud_distances(cloud, wall(8.0), most=100)
    assert 50 < len(few.accuracy_m) <= 100
    assert few.accuracy_m.max() == 0
