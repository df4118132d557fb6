"""`align` on real streets: two moments of a drive as two pairs on one body, against its IMU."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.rigs.body_json import read_body, write_body
from pseudolidar.geometry.frames import BASE_LINK, R_BODY_OPTICAL, left_in_base_link
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.structures.body import BodyRig, MountedPair
from pseudolidar.structures.pose import Pose

pytestmark = pytest.mark.real
# Pair `behind` at these frames, pair `ahead` at the next ones, 0.9 m farther.
FRAMES = (0, 4, 8)
START_M, START_DEG = 0.05, 2.0
# IMU and Velodyne (ICP) differ by so much on these, and the steps are not quite alike.
TRUTH_M, TRUTH_DEG = 0.05, 0.1


def turned(matrix: np.ndarray, other: np.ndarray) -> float:
    """Degrees between two rotations."""
    return float(np.degrees(np.linalg.norm(cv2.Rodrigues(matrix[:3, :3] @ other[:3, :3].T)[0])))


def test_two_moments_of_a_drive_are_a_body(real_data, tmp_path):
    source = KittiRaw(str(real_data / "kitti_raw")).open()
    steps, body = [], tmp_path / "body"
    for number, at in enumerate(FRAMES):
        pair = [source.load(at), source.load(at + 1)]
        places = [frame.pose.matrix @ left_in_base_link(frame.rig).matrix for frame in pair]
        steps.append(np.linalg.inv(places[0]) @ places[1])
        for name, index in (("behind", at), ("ahead", at + 1)):
            for eye, camera in (("left", "image_02"), ("right", "image_03")):
                (picture,) = (real_data / "kitti_raw").glob(f"*/*/{camera}/data/{index:010d}.png")
                link = body / name / eye / f"{number}.png"
                link.parent.mkdir(parents=True, exist_ok=True)
                link.symlink_to(picture.resolve())
    true = np.eye(4)
    turn = np.mean([cv2.Rodrigues(step[:3, :3])[0] for step in steps], axis=0)
    true[:3, :3], true[:3, 3] = cv2.Rodrigues(turn)[0], np.mean(steps, axis=0)[:3, 3]
    rig = replace(source.rig, T_left_velodyne=None, T_velodyne_imu=None)
    behind = Pose.from_rotation(BASE_LINK, rig.left.frame, R_BODY_OPTICAL, np.zeros(3))
    wrong = true.copy()
    wrong[:3, :3] = cv2.Rodrigues(np.radians(START_DEG) * np.array([0.6, 0.64, -0.48]))[0]
    wrong[:3, 3] += START_M * np.array([0.6, 0.0, -0.8])
    ahead = Pose(BASE_LINK, rig.left.frame, behind.matrix @ wrong)
    pairs = (MountedPair("behind", rig, behind), MountedPair("ahead", rig, ahead))
    write_body(body / "rig.json", BodyRig(pairs))
    out = tmp_path / "rig.json"
    loose = ["--trust.worst-shift-m", "0.3"]
    assert main(["align", str(body), "--out", str(out), "--no-check", *loose]) == 0
    found = read_body(out)["ahead"]
    want = behind.matrix @ true
    off_m = np.abs(found.T_base_link_left.translation_m - want[:3, 3])
    assert (off_m < 2 * found.translation_sigma_m + TRUTH_M).all()
    assert (off_m < (0.15, 0.08, 0.04)).all()  # along the drive, across it, up
    off_deg = turned(found.T_base_link_left.matrix, want)
    assert off_deg < 3 * np.degrees(found.rotation_sigma_rad.max()) + TRUTH_DEG
    assert off_deg < 0.3
