"""The calibration doctor on real pairs, as they are and as mistakes make them."""

from __future__ import annotations

import itertools
import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.calibration.check import check_pair, seen_rotation
from pseudolidar.calibration.check_rotation import rotation_found
from pseudolidar.cli import main
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.source import pairs_of
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose
from tests.perturbed import ROWS_OFF, right_turned, swapped
from tests.stereo.motorcycle import motorcycle

pytestmark = pytest.mark.real
KITTI = {
    "stereo 2015": "kitti_stereo2015/training",
    "object": "kitti_object/training",
    "raw": "kitti_raw/2011_09_26",
    "odometry": "kitti_odometry",
}


def kitti(real_data: Path, name: str, *, step: int = 1):
    source = pairs_of(recognise(str(real_data / KITTI[name])).open())
    for index in range(0, len(source.ids), step):
        yield source.load(index)


def severities(frame: StereoFrame) -> dict[str, str]:
    return {finding.name: finding.severity for finding in check_pair(frame).findings}


def alarms(frame: StereoFrame) -> list[str]:
    found = check_pair(frame).findings
    return [f"{frame.id}: {f.line}" for f in found if f.severity in ("stop", "warn")]


@pytest.mark.parametrize("name", [*KITTI, "motorcycle"])
def test_real_pairs_alarm_nobody_and_their_mistakes_do(real_data, name):
    frame = motorcycle(real_data) if name == "motorcycle" else next(kitti(real_data, name))
    assert alarms(frame) == []
    assert severities(swapped(frame))["eyes"] == "stop"
    for how in ("2 px", "-0.5 degrees"):
        seen = severities(ROWS_OFF[how](frame))
        assert (seen["rows"], seen["eyes"]) == ("stop", "good")


@pytest.mark.parametrize("name", [*KITTI, "motorcycle"])
def test_no_eye_of_real_pairs_is_turned_until_one_is(real_data, name):
    """Three pairs of each data set; the pitch and roll that are added to them come out of them."""
    frames = [motorcycle(real_data)] if name == "motorcycle" else [*kitti(real_data, name, step=4)]
    frames = frames[:3]
    rotation = seen_rotation([check_pair(frame) for frame in frames])
    assert rotation_found(rotation, frames[0].rig).severity == "good"
    added = np.radians((0.1, 0.0, 0.1))
    bent = seen_rotation([check_pair(right_turned(f, (0.1, 0, 0.1))) for f in frames])
    assert rotation_found(bent, frames[0].rig).severity == "note"
    off = (bent.rotation_rad - rotation.rotation_rad - added) / bent.sigma_rad
    assert np.abs(off).max() < 3


@pytest.mark.slow
def test_rates_over_all_pairs(real_data):
    """Swapped all, rows off by 2 px or 0.5 degrees at least 99 %, false alarms at most 1 %."""
    pairs = [(name, frame) for name in KITTI for frame in kitti(real_data, name)]
    pairs.append(("motorcycle", motorcycle(real_data)))
    for world in ("street", "room", "flight"):
        source = Synthetic(world, frames=20).open()
        pairs += [(world, source.load(index)) for index in range(0, 20, 4)]
    missed, wrong, runs = Counter(), [], Counter()
    for name, frame in pairs:
        seen = alarms(frame)
        wrong += [f"{name} {line}" for line in seen[:1]]
        for how, changed in (("swapped", swapped), *ROWS_OFF.items()):
            faults = severities(changed(frame))
            runs[how] += 1
            missed[how] += faults["eyes" if how == "swapped" else "rows"] != "stop"
    assert len(pairs) >= 100
    assert len(wrong) <= 0.01 * len(pairs), wrong
    assert missed["swapped"] == 0
    del missed["swapped"]
    assert missed.total() <= 0.01 * sum(n for how, n in runs.items() if how != "swapped"), missed


def test_unrectified_pairs_stop_and_say_what_is_off(real_data):
    root = real_data / "kitti_raw_unrectified" / "2011_09_26" / "2011_09_26_extract"
    lefts = sorted((root / "image_00" / "data").glob("*.png"))
    K = np.array([[984.2439, 0, 690.0], [0, 980.8141, 233.1966], [0, 0, 1.0]])
    for path in lefts[::3]:
        left, right = (
            read_image(root / eye / "data" / path.name).pixels for eye in ("image_00", "image_01")
        )
        height, width = left.shape[:2]
        eyes = (Camera(K, width, height), Camera(K, width, height, frame="camera_right"))
        pose = Pose.from_rotation(
            "camera_right", "camera_left", np.eye(3), np.array([-0.537, 0.0, 0.0])
        )
        found = check_pair(StereoFrame(left, right, StereoRig(*eyes, pose), path.stem, 0, 0))
        seen = {finding.name: finding for finding in found.findings}
        assert (seen["rows"].severity, seen["eyes"].severity) == ("stop", "good")
        assert "rolled" in seen["rows"].text
        # The matrix of the camera itself, where pixels are not square.
        assert seen["focal length"].severity == "warn"


@pytest.mark.parametrize(("name", "most_missed"), [("raw", 1), ("odometry", 1)])
def test_pictures_a_frame_late_are_told(real_data, name, most_missed):
    """The right picture of the frame after, which the frame before then shows."""
    frames = list(kitti(real_data, name))[:8]
    late = [
        check_pair(replace(here, right=after.right), before=here.right)
        for here, after in itertools.pairwise(frames)
    ]
    sync = [next(f for f in check.findings if f.name == "sync") for check in late]
    told = [f.severity == "warn" and abs(f.figures["frames_late"] - 1) < 0.25 for f in sync]
    assert len(told) - sum(told) <= most_missed, [f.line for f in sync]
    assert all(f.severity != "stop" for check in late for f in check.findings)


def test_neighbours_show_that_kitti_is_in_step(real_data, capsys):
    assert main(["check", str(real_data / KITTI["raw"])]) == 0
    assert "in step" in capsys.readouterr().out


def test_scans_without_times_are_told_by_what_they_show(real_data, capsys):
    """The data set's text scan 31 is of the moment of picture 33."""
    drive = str(real_data / "kitti_raw_unrectified")
    assert main(["check", drive, "--json"]) == 0
    found = {each["name"]: each for each in json.loads(capsys.readouterr().out)["findings"]}
    assert found["scans"]["scan_offset"] == 2
    assert found["scans"]["mend"] == "Pass --scan-offset 2."
