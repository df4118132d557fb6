"""Odometry where something large moves by itself and nobody masks it."""

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.mapping.odometry import Fused, Vision
from tests.mapping.moving_board import Board
from tests.mapping.worlds import Drive

FRAMES = 7


@pytest.fixture(scope="module")
def street():
    return Drive.through("street", FRAMES, width_px=480)


def with_board(drive, *, begin, kind="still", share=0.45):
    board = Board.before(drive.frames[0], kind, share)
    return [
        board.on(frame, at - begin) if at >= begin else frame
        for at, frame in enumerate(drive.frames)
    ]


def followed(odometry, frames):
    chain = odometry.start(frames[0].rig)
    return [chain.register(frame, frame.truth) for frame in frames], chain.trajectories()


@pytest.mark.parametrize("begin", [0, 3])
def test_scans_overrule_vision_that_goes_with_a_bus(street, begin):
    told, (path,) = followed(Fused(), with_board(street, begin=begin))
    assert street.error_rel(told[-1].state) < 0.005
    assert np.abs(path.T_world_body[:, :3, 3] - street.T_odom[:, :3, 3]).max() < 0.03
    for one in told:
        if one.check and one.check.asked == "scans":
            assert one.check.wrong
            assert one.sensors == "scan"
            assert one.check.other_agrees > one.check.vision_agrees


@pytest.mark.parametrize(("kind", "begin", "share"), [("still", 0, 0.45), ("near", 3, 0.45)])
def test_vision_goes_on_through_the_street_beside_a_bus(street, kind, begin, share):
    frames = with_board(street, begin=begin, kind=kind, share=share)
    told, _ = followed(Vision(), frames)
    assert street.error_rel(told[-1].state) < 0.01
    assert told[-1].state.inliers < 150  # the street's; the board has 270


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
