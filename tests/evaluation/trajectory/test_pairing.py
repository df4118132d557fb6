"""Which poses belong together: by time, between two, by place; and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import PoseFileError, SequenceTime, UsageError
from pseudolidar.evaluation.trajectory.pairing import (
    TimePairing,
    interpolated,
    nearest_in,
    paired,
)
from tests.evaluation.trajectory.paths import START_NS, STEP_NS, record, stamps, winding


def test_each_pose_of_the_sparser_file_gets_the_nearest_of_the_other():
    truth = winding(101)
    dense = record(truth, stamps(101), "dense.txt")
    late_ns = 4_000_000
    sparse = record(truth[::10], stamps(101)[::10] + late_ns, "sparse.txt")
    for own, other in ((sparse, dense), (dense, sparse)):
        pairs = paired(own, other, TimePairing())
        assert (len(pairs), pairs.by, pairs.largest_difference_s) == (11, "nearest", 0.004)
        np.testing.assert_array_equal(pairs.T_world_estimate, pairs.T_world_reference)


def test_poses_too_far_apart_in_time_are_left_out_and_told():
    times_ns = stamps(20)
    shifted_ns = times_ns[:15].copy()
    shifted_ns[4] += 30_000_000
    own = record(winding(15), shifted_ns, "own.txt")
    pairs = paired(own, record(winding(20), times_ns), TimePairing())
    assert len(pairs) == 14
    assert START_NS + 4 * STEP_NS not in pairs.times_ns
    assert "1 of 15 poses of own.txt left out" in pairs.notes[0]


def test_interpolation_finds_the_pose_between_two():
    truth = winding(200, step_m=0.1)
    times_ns = stamps(200)
    own = record(truth[1:-1:2][:50], times_ns[1:-1:2][:50])
    sparse = record(truth[::2], times_ns[::2])
    nearest = paired(own, sparse, TimePairing("nearest", max_difference_s=0.2))
    between = paired(own, sparse, TimePairing("interpolate", max_difference_s=0.2))
    off_m = [
        np.linalg.norm((p.T_world_estimate - p.T_world_reference)[:, :3, 3], axis=1).max()
        for p in (nearest, between)
    ]
    assert off_m[0] == pytest.approx(0.1, rel=0.01)  # a whole step
    assert off_m[1] < 3e-3  # what the arc rises above its chord, 0.2 m and 0.1 rad: 2.5 mm
    turned = np.abs((between.T_world_estimate - between.T_world_reference)[:, :3, :3]).max()
    assert turned < 3e-3


def test_beyond_the_ends_the_pose_stays():
    truth = winding(3)
    found = interpolated(stamps(3), truth, np.array([START_NS - STEP_NS, START_NS + 9 * STEP_NS]))
    np.testing.assert_allclose(found, truth[[0, 2]], atol=1e-12)


def test_an_offset_moves_the_estimates_times():
    own = record(winding(10), stamps(10, begin_ns=0))
    other = record(winding(10), stamps(10))
    with pytest.raises(SequenceTime) as caught:
        paired(own, other, TimePairing())
    assert "--pair.offset-s 1400000000.000000" in caught.value.fix
    assert len(paired(own, other, TimePairing(offset_s=1.4e9))) == 10


def test_times_that_count_from_0_and_from_1_s_are_the_same():
    truth = winding(60)
    times_ns = stamps(60, begin_ns=0) + np.random.default_rng(2).integers(0, 9_000_000, 60)
    kept = np.r_[0:20, 24:60]  # some were lost
    for shift_ns in (1_000_000_000, -1_000_000_000):
        own = record(truth[kept], times_ns[kept] + 10**9 + shift_ns)
        pairs = paired(own, record(truth, times_ns + 10**9), TimePairing())
        assert (len(pairs), pairs.largest_difference_s) == (56, 0)
        assert f"1 s {'later' if shift_ns > 0 else 'earlier'}" in pairs.notes[0]


def test_an_estimate_that_begins_a_second_late_is_not_moved():
    truth, times_ns = winding(60), stamps(60, begin_ns=0)
    pairs = paired(record(truth[10:], times_ns[10:]), record(truth, times_ns), TimePairing())
    assert (len(pairs), pairs.notes) == (50, ())
    np.testing.assert_array_equal(pairs.T_world_estimate, pairs.T_world_reference)


def test_poses_without_times_are_paired_by_place_and_then_as_many():
    truth = winding(10)
    assert paired(record(truth), record(truth, stamps(10)), TimePairing()).by == "index"
    with pytest.raises(PoseFileError) as caught:
        paired(record(truth[:7], name="short.txt"), record(truth), TimePairing())
    error = caught.value
    assert (error.path, error.where) == ("short.txt", "pose 8")
    assert error.got == "7 poses of the estimate, 10 of the reference"
    with pytest.raises(PoseFileError, match="without times"):
        paired(record(truth), record(truth, stamps(10)), TimePairing("nearest"))


def test_one_pose_is_no_motion():
    one = record(winding(10)[:1], stamps(1))
    with pytest.raises(SequenceTime, match="1 common times"):
        paired(one, record(winding(10), stamps(10)), TimePairing())
    with pytest.raises(PoseFileError, match="1 poses in each"):
        paired(record(winding(10)[:1]), record(winding(10)[:1]), TimePairing())


def test_of_two_as_near_the_earlier_is_taken():
    found = nearest_in(np.array([0, 10, 20]), np.array([-5, 5, 6, 15, 99]))
    assert found.tolist() == [0, 0, 1, 1, 2]


@pytest.mark.parametrize("difference_s", [-1.0, float("nan"), float("inf")])
def test_a_difference_that_is_none_is_refused(difference_s):
    with pytest.raises(UsageError):
        TimePairing(max_difference_s=difference_s)
