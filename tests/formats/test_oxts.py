"""OXTS packets: poses of the IMU as the development kit computes them, and back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import PoseFileError
from pseudolidar.formats.oxts import (
    OxtsPacket,
    body_motion,
    body_pose,
    packet_at,
    read_oxts,
    write_oxts,
)

FIRST = OxtsPacket(49.0, 8.4, 116.0, 0.0, 0.0, 0.0)


def test_heading_east_and_moving_north_is_moving_left():
    one_metre_deg = math.degrees(1.0 / 6_378_137.0)
    moved = OxtsPacket(49.0 + one_metre_deg, 8.4, 116.5, 0.0, 0.0, 0.0)
    pose = body_pose(moved, FIRST)
    np.testing.assert_allclose(pose.translation_m, (0.0, 1.0, 0.5), atol=1e-6)
    assert (pose.dst, pose.src) == ("map", "base_link")


def test_angles_turn_as_the_data_format_says():
    yawed = body_pose(OxtsPacket(49.0, 8.4, 116.0, 0.0, 0.0, 0.1), FIRST)
    assert yawed.matrix[1, 0] > 0  # counter-clockwise: the front goes left
    pitched = body_pose(OxtsPacket(49.0, 8.4, 116.0, 0.0, 0.1, 0.0), FIRST)
    assert pitched.matrix[2, 0] < 0  # the front goes down
    rolled = body_pose(OxtsPacket(49.0, 8.4, 116.0, 0.1, 0.0, 0.0), FIRST)
    assert rolled.matrix[2, 1] > 0  # the left side goes up


def test_first_packet_is_the_map():
    tilted = OxtsPacket(49.0, 8.4, 116.0, 0.02, -0.03, 2.0)
    np.testing.assert_allclose(body_pose(tilted, tilted).matrix, np.eye(4), atol=1e-9)


def test_motion_is_of_the_columns_that_the_data_format_names(tmp_path):
    path = tmp_path / "0.txt"
    path.write_text(" ".join(str(column) for column in range(30)).replace("0 1 2", "49 8 116", 1))
    packet = read_oxts(path)
    assert packet.velocity_m_s == (8.0, 9.0, 10.0)  # vf, vl, vu, not north and east
    assert packet.rates_rad_s == (17.0, 18.0, 19.0)  # about the IMU's own axes


def test_level_velocities_are_turned_into_the_body():
    # nose down by 0.1 while driving level: the body moves forward and, in its own axes, up
    diving = replace(FIRST, pitch_rad=0.1, velocity_m_s=(10.0, 0.0, 0.0), rates_rad_s=(0, 0, 0.3))
    motion = body_motion(diving)
    expected = (10 * math.cos(0.1), 0, 10 * math.sin(0.1))
    np.testing.assert_allclose(motion.velocity_m_s, expected, atol=1e-12)
    np.testing.assert_array_equal(motion.rate_rad_s, (0, 0, 0.3))
    assert motion.frame == "base_link"
    # and it is what poses a moment later say
    later = replace(
        diving, longitude_deg=8.4 + math.degrees(1.0 / 6_378_137.0) / math.cos(math.radians(49))
    )
    step = body_pose(later, diving).translation_m  # 1 m to the east, where it heads
    np.testing.assert_allclose(step, motion.velocity_m_s / 10, atol=1e-3)


def test_round_trip(tmp_path):
    packet = OxtsPacket(49.0003, 8.4007, 118.25, 0.013, -0.021, 2.9)
    write_oxts(tmp_path / "0.txt", packet)
    assert read_oxts(tmp_path / "0.txt") == packet
    again = body_pose(packet_at(body_pose(packet, FIRST), FIRST), FIRST)
    # Mercator's metres are around 6e6 here: a double has steps of 1e-9 m.
    np.testing.assert_allclose(again.matrix, body_pose(packet, FIRST).matrix, atol=1e-8)


@pytest.mark.parametrize(
    ("text", "got"),
    [
        ("49 8.4 116 0 0 0\n", "6 numbers"),
        ("", "0 lines"),
        (" ".join(["nan"] + ["0"] * 29), "'nan'"),
        (" ".join(["490"] + ["0"] * 29), "latitude 490"),
    ],
)
def test_bad_packet_is_refused(tmp_path, text, got):
    path = tmp_path / "0.txt"
    path.write_text(text)
    with pytest.raises(PoseFileError) as caught:
        read_oxts(path)
    assert got in caught.value.got
    assert caught.value.path == str(path)


@pytest.mark.real
def test_real_drive_is_8_2_m(real_data):
    drive = real_data / "kitti_raw" / "2011_09_26" / "2011_09_26_drive_0002_sync"
    packets = [read_oxts(path) for path in sorted((drive / "oxts" / "data").glob("*.txt"))]
    poses = [body_pose(packet, packets[0]) for packet in packets]
    steps_m = np.linalg.norm(np.diff([pose.translation_m for pose in poses], axis=0), axis=1)
    assert steps_m.sum() == pytest.approx(8.2, abs=0.01)
    assert steps_m.min() == pytest.approx(0.87, abs=0.005)
    assert steps_m.max() == pytest.approx(0.98, abs=0.005)
    # It drives forward.
    assert poses[-1].translation_m[0] > 8.1
