"""Selecting frames, and another rig on a source."""

from __future__ import annotations

import datetime
import json
import pickle
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationSizeMismatch,
    ImageMissing,
    NotRectified,
    UsageError,
)
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.rigs.rig_json import parse_rig
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.other_rig import calibration_date, with_rig
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import FrameSource
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose

STEREO_IDS = ("000002_10", "000013_10", "000035_10", "000041_10")
RIG = {
    "schema": 1,
    "origin": "bench, 2026-11-01",
    "width_px": 64,
    "height_px": 48,
    "left": {"fx": 60, "cx": 32, "cy": 24},
    "baseline_m": 0.1,
}


def rig_of(**fields: object) -> StereoRig:
    return parse_rig(json.dumps(RIG | fields), "rig.json")


def source_of(folder: Path, ids: tuple[str, ...], rig: StereoRig | None = None) -> FrameSource:
    """A source with these frames, and with frames 90 and 91 that lack an eye."""
    for eye in ("left", "right"):
        (folder / eye).mkdir(parents=True)
        for place, name in enumerate(ids):
            pixels = np.full((48, 64), place + 100 * (eye == "right"), np.uint8)
            (folder / eye / f"{name}.png").write_bytes(encode_png(pixels))
    for name in ("90", "91"):
        (folder / "left" / f"{name}.png").write_bytes(b"")
    (folder / "rig.json").write_text(json.dumps(RIG))
    source = Folders(str(folder)).open()
    return source if rig is None else replace(source, rigs=(rig,))


TEN = tuple(str(number) for number in range(10))


@pytest.mark.parametrize(
    ("text", "ids", "want"),
    [
        ("2:8:3", TEN, "2 5"),
        ("0::2", TEN, "0 2 4 6 8"),
        ("1::2", STEREO_IDS, "000013_10 000041_10"),
        ("-2:", TEN, "8 9"),
        (":3", TEN, "0 1 2"),
        ("100:400:2", TEN, ""),
        ("13,35,41", STEREO_IDS, "000013_10 000035_10 000041_10"),
        ("41,13", STEREO_IDS, "000013_10 000041_10"),
        ("000013_10", STEREO_IDS, "000013_10"),
        ("7, 0:2,7", TEN, "0 1 7"),
        ("11", ("cam0_10", "cam0_11"), "cam0_11"),
    ],
)
def test_selections(text: str, ids: tuple[str, ...], want: str) -> None:
    selection = FrameSelection.parse(text)
    assert [ids[i] for i in sorted(selection.positions(ids))] == want.split()
    assert FrameSelection.parse(str(selection)) == selection


@pytest.mark.parametrize("text", ["", ",", "1:2:0", "1:2:-1", "1:2:3:4", "a:b", "@/nowhere/file"])
def test_illegal_selections(text: str) -> None:
    with pytest.raises(UsageError):
        FrameSelection.parse(text)


def test_unknown_id_names_the_nearest() -> None:
    for text, near in (("14", "000013_10"), ("1000", "000041_10"), ("000014_10", "000041_10")):
        with pytest.raises(UsageError) as caught:
            FrameSelection.parse(text).positions(STEREO_IDS)
        assert caught.value.exit_code == 2
        assert near in caught.value.want
        assert text in caught.value.got


def test_a_number_that_fits_several_ids_is_refused() -> None:
    with pytest.raises(UsageError):
        FrameSelection.parse("7").positions(("7_left_7", "07_b_7"))


def test_file_is_read_at_once(tmp_path: Path) -> None:
    file = tmp_path / "good frames.txt"
    file.write_text("\ufeff13, 35 # chosen by eye\r\n\n0:1\n", encoding="utf-8")
    selection = FrameSelection.parse(f"@{file}")
    file.unlink()
    assert sorted(selection.positions(STEREO_IDS)) == [0, 1, 2]
    assert str(selection) == "13,35,0:1"


def test_selected_source_keeps_ids_times_and_indices(tmp_path: Path) -> None:
    whole = source_of(tmp_path / "a", TEN)
    part = select(whole, FrameSelection.parse("1::3"), FrameSelection.parse("4"))
    assert part.ids == ("1", "7")
    assert part.timestamps_ns == (whole.timestamps_ns[1], whole.timestamps_ns[7])
    frame = pickle.loads(pickle.dumps(part)).load(1)
    assert (frame.id, frame.index, int(frame.left[0, 0])) == ("7", 7, 7)
    assert part.rig is whole.rig
    assert "frames: 2 of 10 selected" in part.summary.notes
    assert select(whole) is whole


def test_unusable_frames_follow_the_selection(tmp_path: Path) -> None:
    whole = source_of(tmp_path / "a", ("5", "89", "95"))

    def refused(frames: str | None, exclude: str | None = None) -> list[str]:
        chosen = [
            None if text is None else FrameSelection.parse(text) for text in (frames, exclude)
        ]
        return [name for name, _ in select(whole, *chosen).refused]

    assert [name for name, _ in whole.refused] == ["90", "91"]
    assert isinstance(whole.refused[0][1], ImageMissing)
    assert refused("5,90") == ["90"]
    assert refused("91") == ["91"]
    assert refused("0:2") == []
    assert refused("0::2") == ["90", "91"]
    assert refused(None, "90") == ["91"]


def test_nothing_left(tmp_path: Path) -> None:
    whole = source_of(tmp_path / "a", TEN)
    with pytest.raises(UsageError, match="no frame"):
        select(whole, FrameSelection.parse("100:200"))
    with pytest.raises(UsageError):
        select(whole, FrameSelection.parse("3"), FrameSelection.parse("3"))


# --- another rig ---------------------------------------------------------------------------


def posed(rig: StereoRig) -> StereoRig:
    pose = Pose.from_rotation("camera_left", "velodyne", np.eye(3), np.array([0.1, 0.2, 0.3]))
    return replace(rig, T_left_velodyne=pose)


def test_rig_replaces_cameras_and_keeps_the_velodyne(tmp_path: Path) -> None:
    source = source_of(tmp_path / "a", TEN, posed(rig_of()))
    correction = DisparityCorrection(np.arange(10.0), 0.2)
    given = rig_of(baseline_m=0.2, left={"fx": 61, "cx": 30, "cy": 24}, origin="refined")
    seen = with_rig(source, given.with_correction(correction))
    for rig in (seen.rig, pickle.loads(pickle.dumps(seen)).load(3).rig):
        assert rig.baseline_m == 0.2
        assert rig.left.focal_px == 61
        assert rig.correction is not None
        assert rig.correction.residual_px == 0.2
        assert rig.T_left_velodyne is not None
        assert rig.T_left_velodyne.translation_m.tolist() == [0.1, 0.2, 0.3]
        assert rig.origin == "refined"
    assert seen.ids == source.ids
    assert seen.refused == source.refused
    assert seen.load(3).index == 3
    assert "rig: refined" in " ".join(seen.summary.notes)


def test_velodyne_of_the_rig_where_the_source_has_none(tmp_path: Path) -> None:
    source = source_of(tmp_path / "a", TEN)
    assert with_rig(source, posed(rig_of())).rig.T_left_velodyne is not None


def test_poses_follow_the_body_that_the_rig_places_elsewhere(tmp_path: Path) -> None:
    """With a Velodyne or an IMU that only the rig knows, these become `base_link`."""
    source = source_of(tmp_path / "a", TEN)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    T_map_base = Pose.from_rotation("map", "base_link", turn, np.array([5.0, 1.0, 0.0]))
    own = replace(source.load(0), pose=T_map_base)
    seen = replace(with_rig(source, posed(rig_of())), source=OneFrame(source, own)).load(0)
    assert seen.pose is not None
    T_base_left = [left_in_base_link(frame.rig).matrix for frame in (own, seen)]
    assert not np.allclose(*T_base_left)
    # The path of the left camera from where it started is the same.
    before, after = (
        np.linalg.inv(T) @ pose.matrix @ T
        for T, pose in zip(T_base_left, (T_map_base, seen.pose), strict=True)
    )
    np.testing.assert_allclose(after, before, atol=1e-12)
    same = replace(with_rig(source, rig_of()), source=OneFrame(source, own)).load(0)
    assert same.pose is T_map_base


@dataclass(frozen=True)
class OneFrame:
    """A source whose every frame is `frame`."""

    source: FrameSource
    frame: StereoFrame

    def load(self, index: int) -> StereoFrame:  # noqa: ARG002 -- all are the same
        return self.frame


def test_rig_of_another_size(tmp_path: Path) -> None:
    source = source_of(tmp_path / "a", TEN)
    half = rig_of(width_px=32, height_px=24, left={"fx": 30, "cx": 16, "cy": 12})
    half = half.with_correction(DisparityCorrection(np.ones(10), 0.25))
    with pytest.raises(CalibrationSizeMismatch) as caught:
        with_rig(source, half)
    assert "32x24" in caught.value.got
    assert "64x48" in caught.value.want
    rig = with_rig(source, half, scale_calibration=True).load(0).rig
    assert rig.left.size_px == (64, 48)
    assert rig.left.focal_px == 60
    assert rig.correction is not None
    # Twice the pixels: twice the disparity and its error.
    at = np.array([10.0]), np.array([40.0]), np.array([20.0])
    twice = 2 * at[0], 2 * at[1] + 0.5, 2 * at[2] + 0.5
    assert half.correction is not None
    small = half.correction.offset_px(*at, (32, 24))
    large = rig.correction.offset_px(*twice, (64, 48))
    assert large == pytest.approx(2 * small, rel=0.05)  # corners scale by 31/32, not 1/2
    assert rig.correction.residual_px == 0.5


def test_unrectified_rig(tmp_path: Path) -> None:
    bent = rig_of(left=RIG["left"] | {"distortion": [0.1, 0, 0, 0]})
    with pytest.raises(NotRectified):
        with_rig(source_of(tmp_path / "a", TEN), bent)


def test_another_date_is_warned(tmp_path: Path) -> None:
    source = source_of(tmp_path / "a", TEN)

    def warnings(origin: str) -> list[str]:
        notes = with_rig(source, rig_of(origin=origin)).summary.notes
        return [note for note in notes if note.startswith("warning")]

    assert warnings("KITTI 2011_09_26")[0].count("20") >= 2
    assert warnings("bench, again, 2026_11_01") == []
    assert warnings("no date") == []


def test_calibration_date() -> None:
    assert calibration_date("KITTI raw 2011_09_26, refined") == datetime.date(2011, 9, 26)
    assert calibration_date("9999-99-99 or 2020.01.02") == datetime.date(2020, 1, 2)
    assert calibration_date("serial 12011-09-261") is None
