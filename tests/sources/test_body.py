"""Several pairs on one body: frames of one moment, and what is left where a pair fails."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from pseudolidar.errors import CalibrationSizeMismatch, SourceEmpty, SourceUnknown
from pseudolidar.formats.rigs.body_json import write_body
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.rectification import rectification
from pseudolidar.running.body_clouds import body_tree, joined_on_body
from pseudolidar.running.products.converted import Converted
from pseudolidar.sources.body import Body, rectified_place
from pseudolidar.sources.changed import ChangedSource
from pseudolidar.sources.recognise import recognise
from pseudolidar.structures.body import BodyRig, MountedPair
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import LidarScan, StereoFrame
from pseudolidar.structures.pose import Pose
from tests.body_rigs import HEIGHT_PX, WIDTH_PX, body_rig
from tests.raw_rigs import raw_rig

NAMES = ("front", "left", "right")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three pairs with three frames of noise, which no matcher sees."""
    rng = np.random.default_rng(1)
    for name in NAMES:
        for eye in ("left", "right"):
            (tmp_path / name / eye).mkdir(parents=True)
            for frame in range(3):
                picture = rng.integers(0, 256, (HEIGHT_PX, WIDTH_PX), np.uint8)
                cv2.imwrite(str(tmp_path / name / eye / f"{frame:06d}.png"), picture)
    write_body(tmp_path / "rig.json", body_rig())
    return tmp_path


def test_it_is_recognised_and_told(folder: Path) -> None:
    settings = recognise(str(folder))
    assert isinstance(settings, Body)
    source = settings.open()
    assert source.ids == ("000000", "000001", "000002")
    assert "3 stereo pairs on one body (front, left, right): 3 frames" in source.summary.line
    first, *others = source.summary.notes
    assert first == "column source: 0 front, 1 left, 2 right"
    # What all pairs say is said once.
    assert others.count("pairs: equal names") == 1
    assert not any("equal names" in note for note in others if ": pairs" in note)
    frame = source.load(1)
    assert tuple(frame.pairs) == NAMES
    assert frame.notes == ()
    for name in NAMES:
        want = body_rig()[name].T_base_link_left.matrix
        np.testing.assert_array_equal(frame.T_base_link_left[name].matrix, want)
    names = [pose.src for pose in body_tree(frame)]
    assert names[:2] == ["odom", "base_link"]
    assert set(names[2:]) == {f"{n}_camera_{eye}" for n in NAMES for eye in ("left", "right")}


def test_another_place_is_another_calibration(folder: Path) -> None:
    """So that a run is not continued with a body whose pairs were moved."""
    before = recognise(str(folder)).open().summary.camera
    body = body_rig()
    moved = body.pairs[0].T_base_link_left.matrix.copy()
    moved[0, 3] += 1e-9
    first = body.pairs[0].placed(Pose("base_link", "camera_left", moved))
    write_body(folder / "rig.json", replace(body, pairs=(first, *body.pairs[1:])))
    assert recognise(str(folder)).open().summary.camera != before


def test_a_pair_without_a_frame_is_left_out_of_it(folder: Path) -> None:
    for eye in ("left", "right"):
        (folder / "left" / eye / "000001.png").unlink()
    (folder / "right" / "right" / "000001.png").write_bytes(b"garbage")
    source = recognise(str(folder)).open()
    assert "frames without all pairs: 1" in source.summary.notes
    frame = source.load(1)
    assert tuple(frame.pairs) == ("front",)
    assert frame.notes[0] == "left: no pictures of this moment"
    assert frame.notes[1].startswith("right left out: ImageUnreadable")
    assert tuple(source.load(2).pairs) == NAMES


def test_a_frame_that_no_pair_can_read_fails(folder: Path) -> None:
    for name in NAMES:
        small = np.zeros((10, 10), np.uint8)
        cv2.imwrite(str(folder / name / "left" / "000002.png"), small)
        cv2.imwrite(str(folder / name / "right" / "000002.png"), small)
    source = recognise(str(folder)).open()
    with pytest.raises(CalibrationSizeMismatch):
        source.load(2)


def renamed(folder: Path, pair: str, names: list[str]) -> None:
    for eye in ("left", "right"):
        for number, name in enumerate(names):
            path = folder / pair / eye / f"{number:06d}.png"
            path.rename(path.with_name(f"{name}.png"))


def test_other_names_are_paired_by_time(folder: Path) -> None:
    times = [1600000000_000000000 + k * 100_000_000 for k in range(3)]
    renamed(folder, "front", [str(t) for t in times])
    renamed(folder, "left", [str(t + 3_000_000) for t in times])
    renamed(folder, "right", [str(t + 103_000_000) for t in times])
    source = recognise(str(folder)).open()
    assert source.ids == tuple(str(t) for t in times)
    assert [indices for _, indices in source.moments] == [(0, 0, None), (1, 1, 0), (2, 2, 1)]
    assert source.timestamps_ns == tuple(times)


def test_how_far_apart_pictures_of_one_moment_may_be(folder: Path) -> None:
    """By default 0.4 of the time between frames."""
    times = [1600000000_000000000 + k * 100_000_000 for k in range(3)]
    renamed(folder, "front", [str(t) for t in times])
    renamed(folder, "left", [str(t + 39_000_000) for t in times])
    renamed(folder, "right", [str(t + 41_000_000) for t in times])
    paired = [(0, 0, None), (1, 1, None), (2, 2, None)]
    assert [indices for _, indices in Body(str(folder)).open().moments] == paired
    wider = Body(str(folder), tolerance_s=0.0415).open()
    assert [indices for _, indices in wider.moments] == [(k, k, k) for k in range(3)]
    with pytest.raises(SourceEmpty, match="neither names nor times"):
        Body(str(folder), tolerance_s=0.038).open()


def test_a_moment_has_the_time_of_the_first_pair_that_has_it(folder: Path) -> None:
    times = [1600000000_000000000 + k * 100_000_000 for k in range(3)]
    for name in NAMES:
        renamed(folder, name, [str(t) for t in times])
    for eye in ("left", "right"):
        (folder / "front" / eye / f"{times[1]}.png").unlink()
    source = recognise(str(folder)).open()
    assert source.timestamps_ns == tuple(times)
    assert [source.load(k).timestamp_ns for k in range(3)] == times


def with_knowledge(frame: StereoFrame) -> StereoFrame:
    """The pair with a pose of its own body, and a scan if its rig knows a LiDAR."""
    R = cv2.Rodrigues(np.array([0.1, -0.2, 0.7]))[0]
    pose = Pose.from_rotation("map", "base_link", R, np.array([5.0, -3.0, 1.0]))
    scan = LidarScan(np.array([[4.0, 1.0, -0.5]], np.float32))
    return replace(frame, pose=pose, scan=None if frame.rig.T_left_velodyne is None else scan)


def test_pose_and_scan_of_a_pair_become_those_of_the_body(folder: Path) -> None:
    R = cv2.Rodrigues(np.array([0.0, 0.3, 0.0]))[0]
    lidar = Pose.from_rotation("camera_left", "velodyne", R, np.array([0.1, -0.4, 0.2]))
    body = body_rig()
    pairs = [
        replace(pair, rig=replace(pair.rig, T_left_velodyne=lidar if n == 1 else None))
        for n, pair in enumerate(body.pairs)
    ]
    write_body(folder / "rig.json", BodyRig(tuple(pairs)))
    opened = Body(str(folder)).open()
    for knowing in (0, 1):
        sources = list(opened.sources)
        sources[knowing] = ChangedSource(sources[knowing], "told", with_knowledge)
        frame = replace(opened, sources=tuple(sources)).load(0)
        pair = frame.pairs[NAMES[knowing]]
        in_left = np.array([[0.5, 0.2, 6.0]])
        in_map = pair.pose.apply(left_in_base_link(pair.rig).apply(in_left))
        on_body = frame.T_base_link_left[NAMES[knowing]].apply(in_left)
        np.testing.assert_allclose(frame.pose.apply(on_body), in_map, atol=1e-12)
        if knowing == 0:
            assert frame.scan is None
            continue
        seen = frame.T_base_link_left["left"].apply(lidar.apply(frame.scan.xyz))
        np.testing.assert_allclose(frame.T_base_link_lidar.apply(frame.scan.xyz), seen, atol=1e-12)


def test_points_keep_the_number_of_their_pair_where_another_is_lost(folder: Path) -> None:
    frame = recognise(str(folder)).open().load(0)
    in_left = np.array([[0.0, 0.0, 2.0], [0.1, 0.0, 3.0]], np.float32)
    part = Converted(frame.pairs["right"], PointCloud(in_left, "camera_left"), counts={"cut": 3.0})
    joined = joined_on_body(frame, {"right": part}, lost=("left: nothing",))
    assert joined.cloud.extra["source"].tolist() == [2, 2]
    want = frame.T_base_link_left["right"].apply(in_left)
    np.testing.assert_allclose(joined.cloud.xyz, want, atol=1e-6)
    assert joined.counts == {"points_right": 2, "cut": 3.0}
    both = joined_on_body(frame, {"front": part, "right": part})
    assert both.cloud.extra["source"].tolist() == [0, 0, 2, 2]
    assert both.counts == {"points_front": 2, "points_right": 2, "cut": 6.0}
    assert joined.frame.notes == ("left: nothing",)


def test_what_does_not_belong_together_is_refused(folder: Path) -> None:
    for name, at in (("front", 1600000000), ("left", 1700000000), ("right", 1800000000)):
        renamed(folder, name, [f"{at + k}000000000" for k in range(3)])
    with pytest.raises(SourceEmpty, match="neither names nor times"):
        recognise(str(folder)).open()
    shutil.rmtree(folder / "right")
    with pytest.raises(SourceUnknown, match="no folder right"):
        recognise(str(folder)).open()


def test_a_rectified_view_of_unrectified_cameras_stands_where_they_do() -> None:
    """The left camera is turned by rectification, and with it its place on the body."""
    raw = raw_rig(5)
    plan = rectification(raw)
    place = Pose.from_rotation("base_link", "camera_left", np.eye(3), np.array([1.0, 2.0, 3.0]))
    got = rectified_place(MountedPair("a", raw, place))
    point = np.array([[0.3, -0.2, 4.0]])  # in the left camera as it is
    in_rectified = (plan.R_left @ point.T).T
    np.testing.assert_allclose(got.apply(in_rectified), place.apply(point), atol=1e-12)


def test_one_pair_alone_is_a_body_too(folder: Path) -> None:
    write_body(folder / "rig.json", BodyRig(body_rig().pairs[:1]))
    source = recognise(str(folder)).open()
    assert tuple(source.load(0).pairs) == ("front",)


def test_how_well_a_place_is_known_is_not_known_of_another() -> None:
    pair = replace(
        body_rig().pairs[0],
        rotation_sigma_rad=np.full(3, 1e-3),
        translation_sigma_m=np.full(3, 0.1),
    )
    moved = pair.placed(pair.T_base_link_left)
    assert moved.rotation_sigma_rad is moved.translation_sigma_m is None
    assert moved.rig is pair.rig
