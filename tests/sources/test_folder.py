"""Folders of pictures: layouts, pairs by name or time, names of any bytes, rig, times, sizes."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow

from pseudolidar.errors import (
    CalibrationMissing,
    CalibrationSizeMismatch,
    ImageMissing,
    ImageTruncated,
    ImageUnreadable,
    LimitError,
    NotRectified,
    PairMismatch,
    SequenceTime,
    SourceEmpty,
    SourceUnknown,
    UsageError,
)
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.pictures.image import decode_image, encode_jpeg, encode_png
from pseudolidar.formats.rigs.rig_json import read_rig, write_rig
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.folder_frames import FolderSource
from pseudolidar.sources.names import LONGEST_ID_BYTES, natural_key, safe_id
from pseudolidar.structures.frame import RawPair

WIDTH, HEIGHT = 64, 48
RIG = {
    "schema": 1,
    "width_px": WIDTH,
    "height_px": HEIGHT,
    "left": {"fx": 60, "cx": 32, "cy": 24},
    "baseline_m": 0.1,
}


def picture(name: str, *, width: int = WIDTH, height: int = HEIGHT) -> bytes:
    """A picture that tells by its pixels which one it is."""
    rng = np.random.default_rng(list(name.encode("utf-8", "surrogateescape")))
    return encode_png(rng.integers(0, 256, (height, width, 3), dtype=np.uint8))


def fill(
    folder: Path, *names: str, rig: bool = True, width: int = WIDTH, height: int = HEIGHT
) -> Path:
    for name in names:
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(picture(name, width=width, height=height))
    if rig:
        (folder / "rig.json").write_text(json.dumps(RIG))
    return folder


def pairs_of(source: FolderSource) -> list[tuple[str, str]]:
    return [(a.name, b.name) for a, b in zip(source.lefts, source.rights, strict=True)]


def is_pair(source: FolderSource, index: int, left: str, right: str) -> bool:
    """Whether frame `index` holds the pixels of those two files."""
    frame = source.load(index)
    wants = (decode_image(picture(name), "a.png").pixels for name in (left, right))
    return all(
        np.array_equal(got, want)
        for got, want in zip((frame.left, frame.right), wants, strict=True)
    )


# --- layouts -------------------------------------------------------------------------------

LAYOUTS = {
    "left and right": ("left/{}.png", "right/{}.png"),
    "image_0 and image_1": ("image_0/{}.png", "image_1/{}.png"),
    "image_02 and image_03": ("image_02/data/{}.png", "image_03/data/{}.png"),
    "cam0 and cam1": ("cam0/{}.png", "cam1/{}.png"),
    "L and R": ("L/{}.png", "R/{}.png"),
    "left_images": ("left_images/l_{}.png", "right_images/r_{}.png"),
    "image_left, named twice": ("image_left/{}_left.png", "image_right/{}_right.png"),
    "one folder, words": ("left{}.png", "right{}.png"),
    "one folder, words at the end": ("{}_left.png", "{}_right.png"),
    "one folder, capitals": ("Left_{}.PNG", "Right_{}.PNG"),
    "one folder, letters": ("{}_l.png", "{}_r.png"),
    "one folder, letters first": ("L{}.png", "R{}.png"),
    "one folder, numbered eyes": ("im0_{}.png", "im1_{}.png"),
    "one folder, numbered cameras": ("cam0-{}.png", "cam1-{}.png"),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts_pair_by_name(tmp_path: Path, layout: str) -> None:
    left, right = LAYOUTS[layout]
    numbers = ("0009", "0010", "0011")
    fill(tmp_path, *(eye.format(n) for eye in (left, right) for n in numbers))
    source = Folders(str(tmp_path)).open()
    assert source.ids == numbers
    assert source.refused == ()
    assert is_pair(source, 1, left.format("0010"), right.format("0010"))
    assert source.load(2).id == "0011"
    assert source.load(2).index == 2
    rule = next(note for note in source.summary.notes if note.startswith("pairs: "))
    assert rule.removeprefix("pairs: ") in source.summary.line


def test_scene_folders(tmp_path: Path) -> None:
    fill(tmp_path, "b/im0.png", "b/im1.png", "a/im0.png", "a/im1.png", "notes/readme.png")
    (tmp_path / "loop").symlink_to(tmp_path)
    source = Folders(str(tmp_path)).open()
    assert source.ids == ("a", "b")
    assert is_pair(source, 0, "a/im0.png", "a/im1.png")
    assert any("left out" in note for note in source.summary.notes)


def test_scene_folders_with_their_own_rigs(tmp_path: Path) -> None:
    fill(tmp_path, "a/im0.png", "a/im1.png")
    fill(tmp_path, "b/im0.png", "b/im1.png", width=80, rig=False)
    (tmp_path / "b" / "rig.json").write_text(json.dumps(RIG | {"width_px": 80}))
    source = Folders(str(tmp_path)).open()
    assert [source.load(i).rig.left.width_px for i in (0, 1)] == [64, 80]


def test_one_scene_is_named_by_its_folder(tmp_path: Path) -> None:
    scene = fill(tmp_path / "motorcycle", "im0.png", "im1.png", "disp0.png")
    source = Folders(str(scene)).open()
    assert source.ids == ("motorcycle",)
    assert any("1 other" in note for note in source.summary.notes)


def test_numbered_frames_of_one_camera_are_no_pair(tmp_path: Path) -> None:
    fill(tmp_path, *(f"img{n}.png" for n in range(4)))
    with pytest.raises(SourceEmpty) as caught:
        Folders(str(tmp_path)).open()
    assert "4 pictures" in caught.value.got
    assert "--left-pattern" in caught.value.fix


def test_two_folders_given(tmp_path: Path) -> None:
    fill(tmp_path / "x", "1.png", "2.png")
    fill(tmp_path / "y", "1.png", "2.png")
    source = Folders(str(tmp_path / "x"), right=str(tmp_path / "y")).open()
    assert source.lefts[1] == tmp_path / "x" / "2.png"
    assert source.rights[1] == tmp_path / "y" / "2.png"


def test_patterns_override_what_would_be_found(tmp_path: Path) -> None:
    fill(tmp_path, "left1.png", "right1.png", "cam_a_7.png", "cam_b_7.png", "cam_b_8.png")
    patterns = {"left_pattern": "cam_a_*.png", "right_pattern": "cam_b_*.png"}
    source = Folders(str(tmp_path), **patterns).open()
    assert pairs_of(source) == [("cam_a_7.png", "cam_b_7.png")]
    assert source.ids == ("7",)
    assert [name for name, _ in source.refused] == ["8"]
    assert "'cam_a_*.png'" in source.summary.notes[0]


def test_patterns_into_folders_and_wrong_ones(tmp_path: Path) -> None:
    fill(tmp_path, "a/x1.png", "b/y1.png")
    source = Folders(str(tmp_path), left_pattern="a/x*.png", right_pattern="b/y*.png").open()
    assert pairs_of(source) == [("x1.png", "y1.png")]
    with pytest.raises(UsageError):
        Folders(str(tmp_path), left_pattern="a/x1.png", right_pattern="b/*.png").open()
    with pytest.raises(UsageError):
        Folders(str(tmp_path), left_pattern="a/*.png").open()
    with pytest.raises(SourceUnknown, match="no pair"):
        Folders(str(tmp_path), left_pattern="q*.png", right_pattern="b/*.png").open()


def test_no_folder(tmp_path: Path) -> None:
    with pytest.raises(SourceUnknown):
        Folders(str(tmp_path / "nowhere")).open()


# --- row 45: one eye missing; row 49: numeric order ----------------------------------------


def test_unpaired_pictures_are_refused_and_never_shift_the_others(tmp_path: Path) -> None:
    fill(tmp_path, *(f"left/{n}.png" for n in (1, 2, 4)), *(f"right/{n}.png" for n in (2, 3, 4)))
    source = Folders(str(tmp_path)).open()
    assert source.ids == ("2", "4")
    assert is_pair(source, 0, "left/2.png", "right/2.png")
    assert is_pair(source, 1, "left/4.png", "right/4.png")
    assert [(name, type(error)) for name, error in source.refused] == [
        ("1", ImageMissing),
        ("3", ImageMissing),
    ]
    assert source.refused[0][1].path == str(tmp_path / "left" / "1.png")
    assert "right" in source.refused[0][1].got


def test_two_pictures_of_one_moment(tmp_path: Path) -> None:
    fill(tmp_path, "left/1.png", "left/2.png", "right/1.png", "right/2.png")
    (tmp_path / "left" / "1.jpg").write_bytes(b"")
    source = Folders(str(tmp_path)).open()
    assert source.ids == ("2",)
    assert {type(error) for _, error in source.refused} == {PairMismatch, ImageMissing}


def test_numeric_order_and_mixed_widths(tmp_path: Path) -> None:
    fill(tmp_path, *(f"{eye}{n}.png" for eye in ("left", "right") for n in (10, 2, 1, 33)))
    source = Folders(str(tmp_path)).open()
    assert source.ids == ("1", "2", "10", "33")
    assert any("1 and 2 digits" in note for note in source.summary.notes)
    assert not any("leading zeros" in note for note in source.summary.notes)


def test_mixed_padding_is_warned(tmp_path: Path) -> None:
    fill(tmp_path, *(f"{eye}{n}.png" for eye in ("left", "right") for n in ("007", "7", "08")))
    source = Folders(str(tmp_path)).open()
    assert source.ids == ("7", "007", "08")
    assert any("leading zeros" in note for note in source.summary.notes)


def test_natural_key() -> None:
    names = ["a10b2", "a2b10", "a2b9", "a", "b1", "a10b02"]
    assert sorted(names, key=natural_key) == ["a", "a2b9", "a2b10", "a10b2", "a10b02", "b1"]


# --- by time -------------------------------------------------------------------------------

T0 = 1_403_636_579_763_555_584  # ns, of a real recording's order


@pytest.mark.parametrize(
    ("unit_ns", "form"),
    [(1, "{}"), (1000, "{}"), (10**9, "{:.6f}")],
    ids=["ns", "us", "s"],
)
def test_names_that_are_times_are_paired_by_time(tmp_path: Path, unit_ns: int, form: str) -> None:
    def name(time_ns: int) -> str:
        return form.format(time_ns / unit_ns if unit_ns == 10**9 else time_ns // unit_ns)

    lefts = [T0 + k * 50_000_000 for k in range(5)]
    # The right eye is 1 ms late, misses the second moment, and has one of its own at the end.
    rights = [t + 1_000_000 for k, t in enumerate(lefts) if k != 1] + [T0 + 10**9]
    left_names = [f"cam0/{name(t)}.png" for t in lefts]
    right_names = [f"cam1/{name(t)}.png" for t in rights]
    fill(tmp_path, *left_names, *right_names)
    source = Folders(str(tmp_path)).open()
    assert len(source.ids) == 4
    assert is_pair(source, 1, left_names[2], right_names[1])
    assert len(source.refused) == 2
    assert abs(source.timestamps_ns[1] - lefts[2]) <= unit_ns
    assert np.diff(source.timestamps_ns).min() > 0
    assert "time: from the names of the pictures" in source.summary.notes
    assert "times within 10 ms" in source.summary.line


def test_times_outside_the_tolerance_do_not_pair(tmp_path: Path) -> None:
    fill(tmp_path, f"left/{T0}.png", f"right/{T0 + 3_000_000}.png")
    assert len(Folders(str(tmp_path)).open().ids) == 1
    with pytest.raises(SourceEmpty):
        Folders(str(tmp_path), tolerance_s=0.002).open()


def test_two_left_pictures_never_share_a_right_one(tmp_path: Path) -> None:
    fill(tmp_path, f"left/{T0}.png", f"left/{T0 + 6_000_000}.png", f"right/{T0 + 5_000_000}.png")
    source = Folders(str(tmp_path)).open()
    assert source.ids == (str(T0 + 6_000_000),)
    assert [name for name, _ in source.refused] == [str(T0)]


def test_ten_digit_frame_numbers_are_no_times(tmp_path: Path) -> None:
    fill(tmp_path, *(f"{eye}/{n:010d}.png" for eye in ("left", "right") for n in (0, 5)))
    source = Folders(str(tmp_path)).open()
    assert source.timestamps_ns[0] == 10**9
    assert any(note.startswith("time: synthetic") for note in source.summary.notes)


# --- row 46: times.txt ---------------------------------------------------------------------


def three_frames(folder: Path) -> Path:
    return fill(folder, *(f"{eye}/{n}.png" for eye in ("left", "right") for n in (1, 2, 3)))


def test_times_file_belongs_to_the_left_pictures(tmp_path: Path) -> None:
    three_frames(tmp_path)
    (tmp_path / "right" / "2.png").unlink()
    (tmp_path / "times.txt").write_text("1.5\n1.600000001e+00\n1.75\n")
    source = Folders(str(tmp_path)).open()
    assert source.ids == ("1", "3")
    assert source.timestamps_ns == (1_500_000_000, 1_750_000_000)


def test_times_from_0_are_put_after_0(tmp_path: Path) -> None:
    three_frames(tmp_path)
    (tmp_path / "left" / "times.txt").write_text("0\n0.1\n0.2\n")
    source = Folders(str(tmp_path)).open()
    assert source.timestamps_ns == (1_000_000_000, 1_100_000_000, 1_200_000_000)
    assert any("plus 1 s" in note for note in source.summary.notes)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("1\n2\n", "index 2"),
        ("1\n3\n2\n", "index 2"),
        ("1\n1\n2\n", "index 1"),
        ("1\nx\n2\n", "line 2"),
        ("1\nnan\n2\n", "line 2"),
    ],
    ids=["too few", "backwards", "equal", "word", "nan"],
)
def test_wrong_times_are_refused_by_place(tmp_path: Path, text: str, where: str) -> None:
    three_frames(tmp_path)
    (tmp_path / "times.txt").write_text(text)
    with pytest.raises(SequenceTime) as caught:
        Folders(str(tmp_path)).open()
    assert where in caught.value.where


def test_gap_is_told(tmp_path: Path) -> None:
    names = [f"{eye}/{n}.png" for eye in ("left", "right") for n in range(6)]
    fill(tmp_path, *names)
    (tmp_path / "times.txt").write_text("1\n1.1\n1.2\n1.3\n9\n9.1\n")
    assert any("gap" in note for note in Folders(str(tmp_path)).open().summary.notes)


def test_rate(tmp_path: Path) -> None:
    three_frames(tmp_path)
    source = Folders(str(tmp_path), rate_hz=25).open()
    assert source.timestamps_ns == (1_000_000_000, 1_040_000_000, 1_080_000_000)
    with pytest.raises(UsageError):
        Folders(str(tmp_path), rate_hz=0).open()


# --- row 50: names of any bytes; row 52: links ---------------------------------------------

NAMES = ["größe 1", "line\nbreak", "\U0001f468\u200d\U0001f469\U0001f697", "bad\udcff\udc80", "a%b"]


@pytest.mark.parametrize("name", NAMES)
def test_names_of_any_bytes(tmp_path: Path, name: str) -> None:
    folder = fill(tmp_path / f"in {name}", f"left/{name}.png", f"right/{name}.png")
    source = Folders(str(folder)).open()
    assert is_pair(source, 0, f"left/{name}.png", f"right/{name}.png")
    (frame_id,) = source.ids
    frame_id.encode()
    assert (tmp_path / f"{frame_id}.pcd").parent == tmp_path
    (tmp_path / f"{frame_id}.pcd").write_bytes(b"")
    assert "\n" not in frame_id


def test_ids_are_safe_and_stay_different() -> None:
    hard = ["..", ".", "", "a/b", "a\\b", "CON", "nul.x", "a%2Fb", "a/b%", "x,y", "x:y", "x\0y"]
    hard += ["é" * 200, "é" * 200 + "x", "bad\udcff", "bad%FF", "_", "_CON"]
    ids = [safe_id(name) for name in hard]
    for frame_id in ids:
        assert len(frame_id.encode()) <= LONGEST_ID_BYTES
        assert not set(frame_id) & set('/\\:\0,*?"<>|')
        assert not frame_id.startswith(".")
    assert len(set(ids)) == len(ids)
    assert safe_id("000007_10") == "000007_10"
    assert safe_id("größe 1") == "größe 1"


def test_links(tmp_path: Path) -> None:
    fill(tmp_path / "elsewhere", "left/1.png", "right/1.png")
    folder = fill(tmp_path / "seq", "left/2.png", "right/2.png")
    for eye in ("left", "right"):
        (folder / eye / "1.png").symlink_to(tmp_path / "elsewhere" / eye / "1.png")
        (folder / eye / "3.png").symlink_to(folder / eye / "3.png")
        (folder / eye / "loop").symlink_to(folder)
    source = Folders(str(folder)).open()
    assert source.ids == ("1", "2", "3")
    assert is_pair(source, 0, "left/1.png", "right/1.png")
    with pytest.raises(ImageUnreadable, match="symbolic links"):
        source.load(2)


# --- frames: rows 1-4, 8, 9 ----------------------------------------------------------------


def test_bad_frames_fail_alone(tmp_path: Path) -> None:
    names = [f"{eye}/{n}.png" for eye in ("left", "right") for n in range(6)]
    fill(tmp_path, *names)
    left, right = tmp_path / "left", tmp_path / "right"
    source = Folders(str(tmp_path)).open()
    (right / "0.png").unlink()
    (left / "1.png").write_bytes(b"")
    (left / "2.png").write_bytes((left / "2.png").read_bytes()[:-100])
    (right / "3.png").write_bytes(picture("x", width=32))
    (right / "4.png").write_bytes(encode_png(np.zeros((HEIGHT, WIDTH), np.uint8)))
    kinds = (ImageMissing, ImageUnreadable, ImageTruncated, PairMismatch, PairMismatch)
    for index, kind in enumerate(kinds):
        with pytest.raises(kind) as caught:
            source.load(index)
        assert f"{index}.png" in (caught.value.path or "")
    assert source.load(5).id == "5"


def test_mixed_depths_are_a_mismatch(tmp_path: Path) -> None:
    fill(tmp_path, "left/0.png", "right/0.png")
    deep = np.zeros((HEIGHT, WIDTH, 3), np.uint16)
    (tmp_path / "right" / "0.png").write_bytes(encode_png(deep))
    with pytest.raises(PairMismatch, match="uint16"):
        Folders(str(tmp_path)).open().load(0)


def test_cut_jpeg_is_refused(tmp_path: Path) -> None:
    fill(tmp_path)
    photo = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    (tmp_path / "left0.jpg").write_bytes(encode_jpeg(photo, 90))
    (tmp_path / "right0.jpg").write_bytes(encode_jpeg(photo, 90)[:1500])
    with pytest.raises(ImageTruncated, match=r"right0\.jpg"):
        Folders(str(tmp_path)).open().load(0)


def test_notes_of_the_pictures_reach_the_frame(tmp_path: Path) -> None:
    fill(tmp_path)
    for eye in ("left", "right"):
        Pillow.new("RGBA", (WIDTH, HEIGHT), (1, 2, 3, 0)).save(tmp_path / f"{eye}0.png")
    frame = Folders(str(tmp_path)).open().load(0)
    assert frame.notes == ("alpha channel dropped",)
    assert frame.left[0, 0].tolist() == [1, 2, 3]


def test_all_frames_of_another_size_are_refused_at_once(tmp_path: Path) -> None:
    fill(
        tmp_path,
        *(f"{eye}/{n}.png" for eye in ("left", "right") for n in range(3)),
        width=80,
        height=60,
    )
    with pytest.raises(CalibrationSizeMismatch) as caught:
        Folders(str(tmp_path)).open()
    assert caught.value.exit_code == 3
    assert "80x60" in caught.value.got
    assert "64x48" in caught.value.want
    assert "--scale-calibration" in caught.value.fix
    source = Folders(str(tmp_path), scale_calibration=True).open()
    assert source.load(0).rig.left.size_px == (80, 60)
    assert source.load(0).rig.left.focal_px == pytest.approx(75)


def test_one_frame_of_another_size_fails_alone(tmp_path: Path) -> None:
    fill(tmp_path, "left/0.png", "right/0.png", width=80)
    fill(tmp_path, "left/1.png", "right/1.png")
    source = Folders(str(tmp_path)).open()
    with pytest.raises(CalibrationSizeMismatch, match=r"left.0\.png"):
        source.load(0)
    assert source.load(1).size_px == (WIDTH, HEIGHT)


def test_limits_reach_the_pictures(tmp_path: Path) -> None:
    three_frames(tmp_path)
    source = Folders(str(tmp_path), limits=Limits(pixels=100)).open()
    with pytest.raises(LimitError):
        source.load(0)


# --- the rig -------------------------------------------------------------------------------


def test_rig_missing(tmp_path: Path) -> None:
    fill(tmp_path, "left/0.png", "right/0.png", rig=False)
    with pytest.raises(CalibrationMissing) as caught:
        Folders(str(tmp_path)).open()
    assert caught.value.path == str(tmp_path / "rig.json")
    assert '"baseline_m"' in caught.value.fix


def test_rig_given_and_rig_beside(tmp_path: Path) -> None:
    three_frames(tmp_path)
    (tmp_path / "other.json").write_text(json.dumps(RIG | {"baseline_m": 0.2}))
    assert Folders(str(tmp_path)).open().rig.baseline_m == 0.1
    other = str(tmp_path / "other.json")
    assert Folders(str(tmp_path), rig=other).open().rig.baseline_m == 0.2
    with pytest.raises(CalibrationMissing):
        Folders(str(tmp_path), rig=str(tmp_path / "none.json")).open()


def test_unrectified_rig(tmp_path: Path) -> None:
    three_frames(tmp_path)
    left = RIG["left"] | {"distortion": [0.1, 0, 0, 0]}
    (tmp_path / "rig.json").write_text(json.dumps(RIG | {"left": left}))
    source = Folders(str(tmp_path)).open()
    assert source.yields is RawPair
    assert isinstance(source.load(0), RawPair)
    with pytest.raises(NotRectified) as caught:
        Folders(str(tmp_path), pictures="rectified").open()
    assert "--rectify.pictures" in caught.value.fix


def test_pickle_and_rounded_rotation_note(tmp_path: Path) -> None:
    three_frames(tmp_path)
    R = [[1, 5e-5, 0], [0, 1, 0], [0, 0, 1]]
    rig = json.dumps(RIG | {"T_left_velodyne": {"R": R, "t_m": [0, 0, 0]}})
    (tmp_path / "rig.json").write_text(rig)
    source = pickle.loads(pickle.dumps(Folders(str(tmp_path)).open()))
    assert np.array_equal(source.load(1).left, Folders(str(tmp_path)).open().load(1).left)
    assert any("orthonormal" in note for note in source.summary.notes)


@pytest.mark.real
def test_real_pairs(real_data: Path, tmp_path: Path) -> None:
    for name, size, ids in (
        ("kitti_odometry/sequences/06", (1226, 370), ("000000", "000050")),
        ("chessboard/pinhole_640x360_square_0.02423m", (640, 360), ("1", "29")),
        ("middlebury/motorcycle", (741, 500), ("motorcycle", "motorcycle")),
    ):
        rig = RIG | {"width_px": size[0], "height_px": size[1]}
        file = tmp_path / "rig.json"
        file.write_text(json.dumps(rig))
        source = Folders(str(real_data / name), rig=str(file)).open()
        assert (source.ids[0], source.ids[-1]) == ids
        assert source.load(0).size_px == size
        write_rig(tmp_path / "again.json", source.rig)
        assert np.array_equal(read_rig(tmp_path / "again.json").left.K, source.rig.left.K)
