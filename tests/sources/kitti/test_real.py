"""The KITTI sources on real data: known answers, and the whole chain against the Velodyne."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from pseudolidar.errors import NotRectified, SourceEmpty
from pseudolidar.sources.kitti.object import KittiObject
from pseudolidar.sources.kitti.odometry import KittiOdometry
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.structures.frame import StereoFrame

pytestmark = pytest.mark.real
KINDS = (KittiRaw, KittiObject, KittiOdometry, KittiStereo)


@pytest.mark.parametrize(
    ("folder", "kind"),
    [
        ("kitti_raw", KittiRaw),
        ("kitti_raw/2011_09_26", KittiRaw),
        ("kitti_raw/2011_09_26/2011_09_26_drive_0002_sync", KittiRaw),
        ("kitti_object", KittiObject),
        ("kitti_object/training", KittiObject),
        ("kitti_odometry", KittiOdometry),
        ("kitti_odometry/sequences", KittiOdometry),
        ("kitti_odometry/sequences/06", KittiOdometry),
        ("kitti_stereo2015", KittiStereo),
        ("kitti_stereo2015/training", KittiStereo),
        ("chessboard", None),
        ("middlebury/motorcycle", None),
        ("odd_formats", None),
        ("absent", None),
    ],
)
def test_kind_is_seen_from_the_content_and_every_level_opens(real_data, folder, kind):
    path = real_data / folder
    assert [one for one in KINDS if one.looks_like(path)] == ([kind] if kind else [])
    if kind:
        source = kind(str(path)).open()
        assert len(source.ids) == {KittiRaw: 10, KittiObject: 11, KittiOdometry: 51}.get(kind, 22)


def test_raw_drive(real_data):
    source = KittiRaw(str(real_data / "kitti_raw")).open()
    assert source.ids[0] == "0000000000"
    assert source.ids[-1] == "0000000009"
    # First line of image_02/timestamps.txt, as UTC.
    assert source.timestamps_ns[0] == 1_317_042_164_327_963_904
    assert source.rig.baseline_m == pytest.approx(0.53273, abs=5e-6)
    assert source.summary.absent == ("grey cameras (image_00, image_01)",)
    assert source.refused == ()
    frame = source.load(3)
    assert (frame.id, frame.index, frame.size_px) == ("0000000003", 3, (1242, 375))
    assert frame.left.ndim == 3
    assert len(frame.scan) > 100_000
    # Line 4 of velodyne_points/timestamps.txt.
    assert frame.scan.timestamp_ns % 1_000_000_000 == 626_811_755
    poses = [source.load(index).pose for index in (0, 9)]
    np.testing.assert_allclose(poses[0].matrix, np.eye(4), atol=1e-9)
    assert np.linalg.norm(poses[1].translation_m) == pytest.approx(8.2, abs=0.01)
    assert (frame.pose.dst, frame.pose.src) == ("map", "base_link")


def test_raw_drive_with_the_camera_that_is_not_there(real_data):
    with pytest.raises(SourceEmpty, match="--camera colour"):
        KittiRaw(str(real_data / "kitti_raw"), camera="grey").open()


def test_unrectified_drive_is_refused(real_data):
    with pytest.raises(NotRectified, match="sync"):
        KittiRaw(str(real_data / "kitti_raw_unrectified")).open()


def test_object_frames(real_data):
    source = KittiObject(str(real_data / "kitti_object")).open()
    assert source.ids[:2] == ("000013", "000035")
    assert source.timestamps_ns[:2] == (1_000_000_000, 1_100_000_000)
    assert any("synthetic" in note for note in source.summary.notes)
    assert source.summary.absent == ("velodyne of 10 of 11 frames",)
    with_scan, without = source.load(0), source.load(1)
    assert with_scan.scan is not None
    assert without.scan is None
    assert {label.detection.name for label in without.labels} >= {"Car"}
    assert sum(len(source.load(index).labels) for index in range(11)) > 60


def test_odometry_sequence(real_data):
    source = KittiOdometry(str(real_data / "kitti_odometry")).open()
    assert source.ids[0] == "000000"
    assert source.rig.baseline_m == pytest.approx(0.53715, abs=5e-6)
    assert source.timestamps_ns[50] == 6_000_000_000
    assert {"colour cameras (image_2, image_3)", "velodyne", "calibration Tr"} == set(
        source.summary.absent
    )
    frame = source.load(50)
    assert frame.left.ndim == 2
    # base_link is the left camera turned to x forward: the car drove along x.
    positions_m = np.array([files.pose.translation_m for files in source.frames])
    steps_m = np.linalg.norm(np.diff(positions_m, axis=0), axis=1)
    assert steps_m.sum() == pytest.approx(59.9, abs=0.05)
    assert frame.pose.translation_m[0] > 59


def test_stereo_pairs(real_data):
    source = KittiStereo(str(real_data / "kitti_stereo2015")).open()
    assert source.ids[:2] == ("000002_10", "000013_10")
    frame = source.load(1)
    assert frame.truth.density == pytest.approx(0.19, abs=0.02)
    assert frame.scan is not None
    assert frame.labels is None


def test_opened_source_survives_pickling(real_data):
    source = KittiRaw(str(real_data / "kitti_raw")).open()
    again = pickle.loads(pickle.dumps(source))
    assert again.ids == source.ids
    np.testing.assert_array_equal(again.load(2).left, source.load(2).left)


def disparity_errors(frame: StereoFrame) -> np.ndarray:
    """Relative disparity differences of the projected scan from the ground truth."""
    rig = frame.rig
    xyz = rig.T_left_velodyne.apply(frame.scan.xyz.astype(np.float64))
    xyz = np.hstack([xyz[xyz[:, 2] > 1.0], np.ones((np.count_nonzero(xyz[:, 2] > 1.0), 1))])
    left, right = xyz @ rig.P_left.T, xyz @ rig.P_right.T
    uv = left[:, :2] / left[:, 2:]
    d = uv[:, 0] - right[:, 0] / right[:, 2]
    column, row = np.round(uv).astype(int).T
    width, height = frame.size_px
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    truth = frame.truth.values[row[inside], column[inside]]
    return (d[inside] / truth - 1.0)[np.isfinite(truth)]


def test_velodyne_agrees_with_the_ground_truth_disparity(real_data):
    # The chain of P2, P3, R_rect_00, velo_to_cam and image decoding in one figure.
    source = KittiStereo(str(real_data / "kitti_stereo2015")).open()
    errors = np.concatenate([disparity_errors(source.load(index)) for index in range(0, 22, 3)])
    assert len(errors) > 80_000
    assert np.median(np.abs(errors)) <= 0.003
    assert abs(np.median(errors)) <= 0.001
