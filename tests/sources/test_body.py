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
from pseudolidar.geometry.rectification import rectification
from pseudolidar.running.body_clouds import body_tree
from pseudolidar.sources.body import Body, rectified_place
from pseudolidar.sources.recognise import recognise
from pseudolidar.structures.body import BodyRig, MountedPair
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
    assert source.summary.notes[0] == "column source: 0 front, 1 left, 2 right"
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
