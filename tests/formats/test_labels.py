"""KITTI labels: boxes in the left camera, unset values, round trips, refused lines."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import LabelError
from pseudolidar.formats.labels import (
    encode_tracking_labels,
    read_labels,
    read_tracking_labels,
    result_label,
    unknown_classes,
    write_labels,
)
from pseudolidar.formats.rigs.kitti import read_object_calib
from pseudolidar.formats.rigs.kitti_calibration import COLOUR, FRAME_CAM0
from pseudolidar.structures.pose import Pose
from tests.formats.made_obstacles import car, light

# Left camera 6 cm right of camera 0, as KITTI's colour camera nearly is.
T_LEFT_CAM0 = Pose.from_rotation(
    "camera_left", FRAME_CAM0, np.eye(3), np.array([0.06, -0.0003, 0.0027])
)
CAR = "Car 0.00 1 1.91 526.05 176.89 556.11 194.71 1.50 1.44 3.69 -6.00 1.86 62.98 1.82"
DONT_CARE = "DontCare -1 -1 -10 724.15 169.81 737.73 180.27 -1 -1 -1 -1000 -1000 -1000 -10"


def read(tmp_path: Path, text: str):
    path = tmp_path / "000007.txt"
    path.write_text(text)
    return read_labels(path, T_left_cam0=T_LEFT_CAM0)


def test_box_stands_on_its_location_and_faces_its_rotation(tmp_path):
    text = "Car 0.00 0 0.00 0 0 10 10 1.50 1.60 4.00 2.00 1.70 20.00 0.00"
    (label,) = read(tmp_path, text)
    corners = label.box.corners_m() - T_LEFT_CAM0.translation_m
    # rotation_y 0: 4 m along camera x, 1.6 m along z; the bottom is at y 1.70, the top above it.
    np.testing.assert_allclose(corners.min(axis=0), [0.0, 0.2, 19.2], atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), [4.0, 1.7, 20.8], atol=1e-12)
    forward, left, up = label.box.pose.matrix[:3, :3].T
    np.testing.assert_allclose((forward, left, up), [(1, 0, 0), (0, 0, 1), (0, -1, 0)], atol=1e-12)


def test_positive_rotation_turns_the_front_towards_the_camera(tmp_path):
    text = CAR.rsplit(" ", 1)[0] + f" {math.pi / 2}"
    (label,) = read(tmp_path, text)
    np.testing.assert_allclose(label.box.pose.matrix[:3, 0], [0, 0, -1], atol=1e-12)


def test_unset_values_are_none_and_ignored(tmp_path):
    car, nothing, flat = read(
        tmp_path,
        f"{CAR}\n{DONT_CARE}\nCar -1 -1 -10 1 2 3 4 1.5 1.4 3.7 -1000 -1000 -1000 -10\n",
    )
    assert (car.truncation, car.occlusion, car.ignore, car.alpha_rad) == (0.0, 1, False, 1.91)
    for label in (nothing, flat):
        assert label.box is None
        assert label.ignore
        assert label.truncation is label.occlusion is label.alpha_rad is None
    assert nothing.detection.box_px == (724.15, 169.81, 737.73, 180.27)


def test_score_and_classes(tmp_path):
    labels = read(tmp_path, f"{CAR} 0.75\n{CAR.replace('Car', 'Dragon')}\n")
    assert [label.detection.score for label in labels] == [0.75, 1.0]
    assert unknown_classes(labels) == ("Dragon",)


def test_empty_file_has_no_objects(tmp_path):
    assert read(tmp_path, "") == ()
    assert read(tmp_path, "\r\n \n") == ()


def test_byte_order_mark_and_crlf_are_harmless(tmp_path):
    path = tmp_path / "a.txt"
    path.write_bytes(b"\xef\xbb\xbf" + f"{CAR}  \r\n{DONT_CARE}\r\n\r\n".encode())
    labels = read_labels(path, T_left_cam0=T_LEFT_CAM0)
    assert [label.detection.name for label in labels] == ["Car", "DontCare"]


@pytest.mark.parametrize(
    ("line", "where", "got"),
    [
        (CAR.rsplit(" ", 1)[0], "line 2", "14 columns"),
        (f"0 3 {CAR}", "line 2", "17 columns"),
        (CAR.replace("1.44", "-1.44"), "line 2", "size"),
        (CAR.replace("62.98", "nan"), "line 2, column 71", "'nan'"),
        (CAR.replace("62.98", "62,98"), "line 2, column 71", "'62,98'"),
        (CAR.replace(" 1 1.91", " 1.5 1.91"), "line 2, column 10", "'1.5'"),
        (CAR.replace("526.05", "626.05"), "line 2", "image box"),
    ],
)
def test_bad_line_is_named(tmp_path, line, where, got):
    with pytest.raises(LabelError) as caught:
        read(tmp_path, f"{CAR}\n{line}\n")
    assert caught.value.where == where
    assert got in caught.value.got
    assert caught.value.path == str(tmp_path / "000007.txt")


def test_seventeen_columns_are_said_to_be_a_tracking_file(tmp_path):
    with pytest.raises(LabelError, match="tracking"):
        read(tmp_path, f"0 3 {CAR}")


def test_missing_file(tmp_path):
    with pytest.raises(LabelError, match="absent"):
        read_labels(tmp_path / "absent.txt", T_left_cam0=T_LEFT_CAM0)


def test_tracking_labels_by_frame(tmp_path):
    path = tmp_path / "0000.txt"
    path.write_text(f"0 2 {CAR}\n0 -1 {DONT_CARE}\n5 2 {CAR}\n")
    frames = read_tracking_labels(path, T_left_cam0=T_LEFT_CAM0)
    assert [[label.track_id for label in frames[n]] for n in (0, 5)] == [[2, None], [2]]
    assert frames.keys() == {0, 5}


def test_written_to_all_digits_and_read_again(tmp_path):
    labels = read(tmp_path, f"{CAR.replace('62.98', '62.983172319')} 0.123456789\n{DONT_CARE}\n")
    write_labels(tmp_path / "again.txt", labels, T_left_cam0=T_LEFT_CAM0, scores=True)
    again = read_labels(tmp_path / "again.txt", T_left_cam0=T_LEFT_CAM0)
    np.testing.assert_allclose(again[0].box.pose.matrix, labels[0].box.pose.matrix, atol=1e-13)
    assert again[0].detection.box_px == labels[0].detection.box_px
    assert again[0].detection.score == 0.123456789
    assert again[1].box is None
    assert again[1].ignore


def test_alpha_is_derived_where_nobody_annotated_it(tmp_path):
    (label,) = read(tmp_path, CAR.replace("1.91", "-10"))
    write_labels(tmp_path / "again.txt", [label], T_left_cam0=T_LEFT_CAM0, decimals=2)
    words = (tmp_path / "again.txt").read_text().split()
    assert float(words[3]) == pytest.approx(1.82 - math.atan2(-6.0, 62.98), abs=0.005)


@pytest.mark.real
def test_real_labels_come_back_byte_for_byte(real_data, tmp_path):
    folder = real_data / "kitti_object" / "training"
    files = sorted((folder / "label_2").glob("*.txt"))
    assert len(files) == 11
    for path in files:
        T_left_cam0 = read_object_calib(folder / "calib" / path.name).T_left_cam0(COLOUR[0])
        labels = read_labels(path, T_left_cam0=T_left_cam0)
        write_labels(tmp_path / path.name, labels, T_left_cam0=T_left_cam0, decimals=2)
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()


@pytest.mark.real
def test_real_boxes_project_onto_their_image_boxes(real_data):
    folder = real_data / "kitti_object" / "training"
    errors_px = []
    for path in sorted((folder / "label_2").glob("*.txt")):
        calibration = read_object_calib(folder / "calib" / path.name)
        T_left_cam0 = calibration.T_left_cam0(COLOUR[0])
        rig = calibration.rig(COLOUR, size_px=(1242, 375))
        for label in read_labels(path, T_left_cam0=T_left_cam0):
            if label.ignore or label.truncation > 0 or label.box.corners_m()[:, 2].min() < 0:
                continue
            uvw = label.box.corners_m() @ rig.left.K.T
            uv = uvw[:, :2] / uvw[:, 2:]
            box = np.array([*uv.min(axis=0), *uv.max(axis=0)])
            errors_px.append(np.abs(box - label.detection.box_px).max())
    assert len(errors_px) > 40
    # The image boxes were drawn from the 3D ones; both are rounded. A centre taken for the bottom
    # or camera 0 for camera 2 moves them by tens of pixels.
    assert np.median(errors_px) < 2.0


def test_tracks_of_obstacles_come_back_from_a_tracking_file(tmp_path):
    frames = {0: [result_label(car())], 3: [result_label(light()), result_label(car())]}
    path = tmp_path / "0000.txt"
    path.write_bytes(encode_tracking_labels(frames, T_left_cam0=T_LEFT_CAM0, scores=True))
    found = read_tracking_labels(path, T_left_cam0=T_LEFT_CAM0)
    assert [(n, [label.track_id for label in labels]) for n, labels in found.items()] == [
        (0, [7]),
        (3, [None, 7]),
    ]
    again, (signal, _) = found[0][0], found[3]
    assert (again.detection.name, again.detection.score) == ("Car", 0.875)
    assert signal.detection.name == "traffic_light"
    assert again.detection.box_px == car().detection.box_px
    np.testing.assert_allclose(again.box.pose.matrix, car().box.pose.matrix, atol=1e-12)
    assert (again.truncation, again.occlusion) == (None, None)
    # A written file is the same again after it was read.
    twice = encode_tracking_labels(frames, scores=True, decimals=2)
    path.write_bytes(twice)
    back = read_tracking_labels(path, T_left_cam0=Pose.identity("camera_left", FRAME_CAM0))
    assert encode_tracking_labels(back, scores=True, decimals=2) == twice
