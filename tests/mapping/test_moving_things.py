"""Odometry where something large moves by itself and nobody masks it."""

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.geometry.tracking import MatchedPair
from pseudolidar.geometry.twists import exp_twist, inverted, log_twist
from pseudolidar.mapping.alignment import Prior
from pseudolidar.mapping.keyframe import Keyframe, Sight
from pseudolidar.mapping.odometry import Fused, Vision
from pseudolidar.mapping.registration import registered
from pseudolidar.mapping.scan_overrule import lying_elsewhere
from pseudolidar.mapping.scan_witness import ScanPlanes, ScanWitness, scan_points
from tests.mapping.moving_board import Board, with_board
from tests.mapping.worlds import Drive

FRAMES = 7


@pytest.fixture(scope="module")
def street():
    return Drive.through("street", FRAMES, width_px=480)


def followed(odometry, frames):
    chain = odometry.start(frames[0].rig)
    return [chain.register(frame, frame.truth) for frame in frames], chain.trajectories()


@pytest.mark.parametrize(("begin", "end"), [(0, 4), (3, FRAMES)])
def test_scans_overrule_vision_that_goes_with_a_bus(street, begin, end):
    """Until it is gone: then vision goes on from where the scans had it."""
    beside = with_board(street.frames, "still", 0.6, begin=begin)
    told, (path,) = followed(Fused(), [*beside[:end], *street.frames[end:]])
    assert street.error_rel(told[-1].state) < 0.005
    assert np.abs(path.T_world_body[:, :3, 3] - street.T_odom[:, :3, 3]).max() < 0.03
    overruled = [one for one in told if one.check and one.check.asked == "scans"]
    assert len(overruled) >= 2
    assert {one.sensors for one in told[end:]} <= {"vision and scan"}
    for one in overruled:
        assert one.check.wrong
        assert one.sensors == "scan"
        assert one.check.other_agrees > one.check.vision_agrees


@pytest.fixture(scope="module")
def planes(street):
    return [
        ScanPlanes.of(scan_points(frame.scan), street.rig.T_left_velodyne)
        for frame in street.frames
    ]


def elsewhere(street, planes, number, step, *, known, T_guess, by_vision="near"):
    """Where the scan of a frame lies by other steps than that from the one known before."""
    scans = ScanWitness()
    for at in known:
        scans.remember(planes[at], street.T_odom[at])
    T_from = street.T_odom[known[-1]]
    if by_vision == "near":
        by_vision = scans.align(planes[number], Prior.within(T_from @ step, metres=0.02, rad=0.002))
    return lying_elsewhere(scans, planes[number], step, by_vision, T_from=T_from, T_guess=T_guess)


def longer(step, metres):
    return step @ exp_twist(np.array([0, 0, metres, 0, 0, 0]))


@pytest.mark.parametrize(("known", "number"), [([0, 1], 2), ([0], 3)])
@pytest.mark.parametrize("wrong_m", [-0.3, 0.6])
def test_a_scan_overrules_a_wrong_step_and_no_right_one(street, planes, known, number, wrong_m):
    T = street.T_odom
    right = inverted(T[known[-1]]) @ T[number]
    on = None if known == [0] else T[1] @ inverted(T[0]) @ T[1]
    found = elsewhere(street, planes, number, longer(right, wrong_m), known=known, T_guess=on)
    assert np.abs(found.T_odom_sensor - T[number]).max() < 0.01
    for by_vision in ("near", None):
        asked = {"known": known, "T_guess": on, "by_vision": by_vision}
        assert elsewhere(street, planes, number, right, **asked) is None


def test_a_scan_is_not_asked_where_the_step_goes_on_as_before_nor_for_little(street, planes):
    T = street.T_odom
    wrong = longer(inverted(T[1]) @ T[2], 0.3)
    asked = {"known": [0, 1], "T_guess": T[1] @ inverted(T[0]) @ T[1]}
    other = elsewhere(street, planes, 2, wrong, **asked)
    assert elsewhere(street, planes, 2, wrong, known=[0, 1], T_guess=T[1] @ wrong) is None
    for better, overruled in ((0.02, False), (0.04, True)):
        by_vision = replace(other, score=other.score - better)
        found = elsewhere(street, planes, 2, wrong, **asked, by_vision=by_vision)
        assert (found is not None) is overruled


@pytest.mark.parametrize(("kind", "begin"), [("still", 0), ("near", 3)])
def test_vision_goes_on_through_the_street_beside_a_bus(street, kind, begin):
    frames = with_board(street.frames, kind, 0.45, begin=begin)
    told, _ = followed(Vision(), frames)
    assert street.error_rel(told[-1].state) < 0.01
    assert told[-1].state.inliers < 150  # the street's; the board has 270


@pytest.mark.parametrize("guess", [None, np.eye(4)])
def test_a_guess_that_leads_to_the_bus_does_not_hide_the_street(street, guess):
    first, second = with_board(street.frames[:2], "still", 0.45, begin=0)
    key = Keyframe.of(Sight(0, MatchedPair.of(first, first.truth)), street.rig)
    sight = Sight(1, MatchedPair.of(second, second.truth))
    found = registered(key, sight, street.rig, guess, None)
    error = log_twist(found.T_to_from @ inverted(street.T_odom[0]) @ street.T_odom[1])
    assert np.linalg.norm(error) < 0.02


def test_who_sets_off_behind_a_car_goes_with_the_street():
    drive = Drive.through("street", 4, width_px=480, rate_hz=100)
    car = Board.before(drive.frames[0], "still", 0.12)
    chain = Vision().start(drive.rig)
    for number, at in enumerate([0, 0, 0, 1, 2, 3]):
        seen = car.on(drive.frames[at], number)  # with another noise each time
        frame = replace(seen, timestamp_ns=number * 10**8)
        state = chain.register(frame, frame.truth).state
        error_m = np.linalg.norm(state.T_odom_camera.translation_m - drive.T_odom[at, :3, 3])
        assert error_m < 0.01


def test_nobody_is_overruled_who_brakes_all_at_once(street):
    # every second frame at first, then each: the camera is half as fast from one to the next
    kept = [0, 2, 4, 5, 6]
    frames = [
        replace(street.frames[at], timestamp_ns=street.frames[i].timestamp_ns)
        for i, at in enumerate(kept)
    ]
    told, _ = followed(Fused(), frames)
    assert not any(one.check and one.check.wrong for one in told)
    assert {one.sensors for one in told[1:]} == {"vision and scan"}
    assert street.error_rel(told[-1].state) < 0.005
