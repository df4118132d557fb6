"""Errors that were put in come out; drift follows the KITTI devkit's rule, written out here."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from pseudolidar.errors import UsageError
from pseudolidar.evaluation.trajectory.judge import TrajectoryErrors, judge_trajectory
from pseudolidar.evaluation.trajectory.motions import angles_rad
from pseudolidar.evaluation.trajectory.pairing import PairedPoses, TimePairing, paired
from pseudolidar.evaluation.trajectory.segments import SegmentLengths, segment_errors
from pseudolidar.evaluation.trajectory.steps import RpeChoice, RpeSteps
from pseudolidar.geometry.twists import exp_twist
from tests.evaluation.trajectory.paths import drifting, record, winding

ELSEWHERE = exp_twist(np.array([3.0, 1.0, -2.0, 0.3, 0.1, -2.2]))


def judged(estimate: np.ndarray, reference: np.ndarray, **kwargs) -> TrajectoryErrors:
    pairs = paired(record(estimate), record(reference), TimePairing())
    settings = {"align": "se3", "steps": (RpeSteps(),), "segments": SegmentLengths(), **kwargs}
    return judge_trajectory(pairs, **settings)


@pytest.mark.parametrize("align", ["se3", "sim3", "origin"])
def test_the_same_path_in_another_world_has_no_error(align):
    truth = winding(300)
    errors = judged(ELSEWHERE @ truth, truth, align=align)
    for values in (errors.ape_m, errors.ape_rad, errors.relative[0].rpe_m, errors.segments.t_rel):
        assert values.max() < 1e-9
    assert errors.alignment.scale == pytest.approx(1, abs=1e-12)
    assert judged(ELSEWHERE @ truth, truth, align="none").ape_m.min() > 1


def test_a_path_that_is_too_long_is_told_by_its_scale_and_its_drift():
    truth = winding(300)
    longer = truth.copy()
    longer[:, :3, 3] *= 1.02
    by_scale = judged(longer, truth, align="sim3")
    assert by_scale.alignment.scale == pytest.approx(1 / 1.02, rel=1e-12)
    assert by_scale.ape_m.max() < 1e-9
    rigid = judged(longer, truth)
    straight = np.linalg.norm(truth[-1, :3, 3] - truth[0, :3, 3]) / rigid.length_m
    assert rigid.end_error_rel == pytest.approx(0.02 * straight, rel=1e-9)
    assert rigid.segments.mean_r_rel_deg_per_m < 1e-9


def test_one_bad_step_is_one_bad_motion_and_bends_what_follows():
    truth = winding(100)
    steps = np.linalg.inv(truth[:-1]) @ truth[1:]
    off = exp_twist(np.array([0.5, 0, 0, 0, 0, np.radians(3)]))
    estimate = truth.copy()
    estimate[51:] = truth[51] @ off @ np.linalg.inv(truth[51]) @ truth[51:]
    errors = judged(estimate, truth, align="none", steps=RpeChoice.parse("1,10,20m:all").each)
    one, ten, metres = errors.relative
    wrong = np.flatnonzero(one.rpe_m > 1e-9)
    assert wrong.tolist() == [50]
    assert np.degrees(one.rpe_rad[50]) == pytest.approx(3, rel=1e-9)
    assert np.flatnonzero(ten.rpe_rad > 1e-6).tolist() == [5]
    begins = metres.pairs[np.flatnonzero(metres.rpe_rad > 1e-6), 0]
    assert begins.tolist() == list(range(begins[0], 51))
    assert len(begins) == 20  # one pose a metre
    assert len(steps) == len(one.rpe_m)


def test_motions_from_every_pose_end_where_their_path_is_nearest_to_the_length():
    rng = np.random.default_rng(8)
    steps_m = rng.uniform(0, 0.8, 300) * (rng.random(300) < 0.7)  # it stands now and then
    line = np.tile(np.eye(4), (301, 1, 1))
    line[1:, 0, 3] = np.cumsum(steps_m)
    path_m = line[:, 0, 3]
    wanted = []
    for begin in range(300):
        off_m = np.abs(path_m[begin + 1 :] - path_m[begin] - 2.0)
        if off_m.min() <= 0.2:
            wanted.append((begin, begin + 1 + int(off_m.argmin())))
    found = RpeSteps.parse("2m:all").pairs(line)
    assert found.tolist() == [list(pair) for pair in wanted]
    assert len(found) > 200


def devkit(estimate: np.ndarray, truth: np.ndarray, metres: tuple[int, ...], step: int):
    """The benchmark's loops, as its code has them."""
    gone = [0.0]
    for before, after in pairwise(truth):
        gone.append(gone[-1] + float(np.linalg.norm(after[:3, 3] - before[:3, 3])))
    found = []
    for first in range(0, len(truth), step):
        for length_m in metres:
            last = next(
                (i for i in range(first, len(gone)) if gone[i] > gone[first] + length_m), -1
            )
            if last < 0:
                continue
            true = np.linalg.inv(truth[first]) @ truth[last]
            own = np.linalg.inv(estimate[first]) @ estimate[last]
            error = np.linalg.inv(own) @ true
            cosine = np.clip((np.trace(error[:3, :3]) - 1) / 2, -1, 1)
            off = np.linalg.norm(error[:3, 3]), np.arccos(cosine)
            found.append((first, length_m, off[0] / length_m, off[1] / length_m))
    return np.array(found)


@pytest.mark.parametrize(
    ("text", "metres", "step", "step_m"),
    [
        ("kitti", (100, 200, 300, 400, 500, 600, 700, 800), 10, 2.3),
        ("short", (10, 20, 30, 40), 1, 0.31),
        ("15,7", (7, 15), 1, 0.31),
    ],
)
def test_segments_are_those_of_the_devkit(text, metres, step, step_m):
    truth = winding(420, step_m=step_m)
    estimate = drifting(truth)
    found = segment_errors(estimate, truth, SegmentLengths.parse(text))
    wanted = devkit(estimate, truth, metres, step)
    assert len(found) == len(wanted) > 100
    np.testing.assert_array_equal(found.first, wanted[:, 0])
    np.testing.assert_array_equal(found.length_m, wanted[:, 1])
    np.testing.assert_allclose(found.t_rel, wanted[:, 2], rtol=1e-9)
    # The arc cosine of the benchmark has half of the digits.
    np.testing.assert_allclose(found.r_rel_rad_per_m, wanted[:, 3], atol=1e-8)
    assert found.mean_t_rel == pytest.approx(wanted[:, 2].mean())
    assert sum(row.n for row in found.by_length()) == len(found)


def test_a_segment_ends_beyond_its_length():
    line = np.tile(np.eye(4), (30, 1, 1))
    line[:, 0, 3] = np.arange(30)  # and not at the pose that is 10 m on to the digit
    assert segment_errors(line, line, SegmentLengths("10")).first.tolist() == list(range(19))


@pytest.mark.parametrize(
    ("poses", "metres"),
    [(102, (100, 200, 300, 400, 500, 600, 700, 800)), (60, (10, 20, 30, 40)), (9, ())],
)
def test_segments_are_as_long_as_the_path_allows(poses, metres):
    truth = winding(poses)
    errors = judged(drifting(truth), truth)
    assert errors.segments.lengths_m == metres
    assert len(errors.segments) > 0
    if not metres:
        assert errors.segments.mean_t_rel == pytest.approx(errors.end_error_rel)


def test_the_summary_holds_the_figures_of_the_report():
    truth = winding(60)
    estimate = drifting(truth)
    found = judge_trajectory(PairedPoses.of_frames(estimate, truth)).summary()
    errors = judged(estimate, truth)
    assert found.pop("ape_rmse_m") == pytest.approx(np.sqrt(np.mean(errors.ape_m**2)))
    assert found == {
        "frames": 60,
        "length_m": errors.length_m,
        "end_error_rel": errors.end_error_rel,
        "t_rel": errors.segments.mean_t_rel,
        "segments_m": [10, 20, 30, 40],
        "r_rel_deg_per_m": errors.segments.mean_r_rel_deg_per_m,
    }


def test_what_does_not_move_has_no_drift():
    still = np.tile(np.eye(4), (5, 1, 1))
    errors = judged(still, still)
    assert (errors.end_error_rel, errors.segments.mean_t_rel) == (None, None)
    assert errors.ape_m.max() == 0


@pytest.mark.parametrize("angle", [1e-9, 1e-3, 1.0, 3.0, np.pi - 1e-6])
def test_angles_keep_their_digits(angle):
    T = exp_twist(np.array([0, 0, 0, *(angle * np.array([0.6, 0, 0.8]))]))
    assert angles_rad(T[None])[0] == pytest.approx(angle, rel=1e-8)


@pytest.mark.parametrize("text", ["", "m", "0", "1.5", "-1m", "nanm", "10 km", "1,,2"])
def test_motions_that_are_none_are_refused(text):
    with pytest.raises(UsageError):
        RpeChoice.parse(text)


@pytest.mark.parametrize("text", ["", "0", "long", "10,-5", "10.5", "1234567"])
def test_lengths_that_are_none_are_refused(text):
    with pytest.raises(UsageError):
        SegmentLengths.parse(text)


def test_settings_are_told_as_they_are_given():
    assert str(RpeChoice.parse("1, 10m,2.5m:all")) == "1,10m,2.5m:all"
    assert SegmentLengths.parse("30,10").of(5.0) == (10, 30)
