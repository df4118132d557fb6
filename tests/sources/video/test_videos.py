"""Videos of two eyes as a source: found by name, unpacked by the rig's size, paired by time."""

from __future__ import annotations

import json
import pickle
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationMissing,
    CalibrationSizeMismatch,
    ImageMissing,
    PairMismatch,
    SequenceTime,
    SourceEmpty,
    SourceUnknown,
    UsageError,
    VideoDamaged,
)
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.video.frames import VideoSource
from pseudolidar.sources.video.videos import Video
from tests.videos import H264, pictures, write_video

WIDTH, HEIGHT, FRAMES = 64, 48, 12
LEFT, RIGHT = pictures(FRAMES, seed=1), pictures(FRAMES, seed=2)
RIG = {
    "schema": 1,
    "width_px": WIDTH,
    "height_px": HEIGHT,
    "left": {"fx": 60, "cx": 32, "cy": 24},
    "baseline_m": 0.1,
}
MS = Fraction(1, 1000)


def with_rig(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rig.json").write_text(json.dumps(RIG))
    return folder


def two_videos(folder: Path, left: str = "left.mkv", right: str = "right.mkv", **how) -> Path:
    with_rig(folder)
    write_video(folder / left, LEFT, **how)
    write_video(folder / right, RIGHT, **how)
    return folder


def packed(folder: Path, layout: str, name: str = "both.mkv", **how) -> Path:
    with_rig(folder)
    stack = np.hstack if layout == "side-by-side" else np.vstack
    both = [stack([a, b]) for a, b in zip(LEFT, RIGHT, strict=True)]
    return write_video(folder / name, both, **how)


def is_pair(source: VideoSource, index: int, left: int, right: int) -> bool:
    frame = source.load(index)
    return np.array_equal(frame.left, LEFT[left]) and np.array_equal(frame.right, RIGHT[right])


# --- two videos ----------------------------------------------------------------------------

NAMES = [
    ("left.mkv", "right.mkv"),
    ("left_cam.avi", "right_cam.avi"),
    ("drive_l.mkv", "drive_r.mkv"),
    ("Drive-L.MKV", "Drive-R.MKV"),
    ("cam0.mkv", "cam1.mkv"),
    ("video_0.mkv", "video_1.mkv"),
    ("image_02.mkv", "image_03.mkv"),
]


@pytest.mark.parametrize(("left", "right"), NAMES)
def test_two_videos_are_found_by_name(tmp_path: Path, left: str, right: str) -> None:
    two_videos(tmp_path, left, right)
    for place in (tmp_path, tmp_path / left, tmp_path / right):
        settings = recognise(str(place))
        assert isinstance(settings, Video)
        source = settings.open()
        assert source.ids == tuple(f"{n:06d}" for n in range(FRAMES))
        assert is_pair(source, 7, 7, 7)
        assert left in source.summary.line
    assert source.refused == ()


def test_two_videos_of_any_name_and_place(tmp_path: Path) -> None:
    one = write_video(tmp_path / "a" / "one.mkv", LEFT)
    other = write_video(tmp_path / "b" / "other.mkv", RIGHT)
    rig = with_rig(tmp_path / "c") / "rig.json"
    source = Video(str(one), right=str(other), rig=str(rig)).open()
    assert is_pair(source, 3, 3, 3)
    swapped = Video(str(other), right=str(one), rig=str(rig), swap=True).open()
    assert is_pair(swapped, 3, 3, 3)
    again = opened_with_rig(Video(str(one), right=str(other)), rig)
    assert is_pair(again, 3, 3, 3)
    with pytest.raises(CalibrationMissing):
        Video(str(one), right=str(other)).open()


def test_several_pairs_are_not_guessed_at(tmp_path: Path) -> None:
    two_videos(tmp_path, "a_l.mkv", "a_r.mkv")
    two_videos(tmp_path, "b_l.mkv", "b_r.mkv")
    with pytest.raises(SourceUnknown, match="4 videos and 2 pairs"):
        recognise(str(tmp_path)).open()
    assert is_pair(recognise(str(tmp_path / "b_l.mkv")).open(), 0, 0, 0)


def test_videos_of_two_sizes_are_refused(tmp_path: Path) -> None:
    two_videos(tmp_path)
    write_video(tmp_path / "right.mkv", pictures(FRAMES, WIDTH + 2, HEIGHT))
    with pytest.raises(PairMismatch, match="66x48"):
        Video(str(tmp_path)).open()


def test_another_size_than_the_rig(tmp_path: Path) -> None:
    two_videos(tmp_path)
    rig = RIG | {"width_px": 2 * WIDTH, "height_px": 2 * HEIGHT}
    (tmp_path / "rig.json").write_text(json.dumps(rig))
    with pytest.raises(CalibrationSizeMismatch, match="64x48"):
        Video(str(tmp_path)).open()
    source = opened_with_rig(Video(str(tmp_path)), None, scale_calibration=True)
    assert source.rig.left.focal_px == 30


# --- both eyes in one ----------------------------------------------------------------------


@pytest.mark.parametrize("layout", ["side-by-side", "top-bottom"])
def test_the_rig_tells_how_one_video_is_packed(tmp_path: Path, layout: str) -> None:
    path = packed(tmp_path, layout)
    for place in (path, tmp_path):
        source = recognise(str(place)).open()
        assert is_pair(source, 5, 5, 5)
        assert source.rig.left.size_px == (WIDTH, HEIGHT)
        assert source.summary.line.startswith(f"{layout} video both.mkv: {FRAMES} pairs")
    assert f"eyes: {layout} (by the rig's size), each 64x48 px" in source.summary.notes


def test_one_eye_is_not_taken_for_two(tmp_path: Path) -> None:
    """A picture as large as one eye: it is that eye, or both squeezed into it."""
    with_rig(tmp_path)
    path = write_video(tmp_path / "one.mkv", LEFT)
    with pytest.raises(SourceUnknown, match="a rig for eyes of 64x48") as caught:
        Video(str(path)).open()
    assert "--right" in caught.value.fix
    assert "--scale-calibration" in caught.value.fix
    with pytest.raises(CalibrationSizeMismatch):
        Video(str(path), layout="side-by-side").open()


def test_squeezed_eyes_are_used_as_stored_and_told(tmp_path: Path) -> None:
    with_rig(tmp_path)
    halves = [np.hstack([a[:, ::2], b[:, ::2]]) for a, b in zip(LEFT, RIGHT, strict=True)]
    path = write_video(tmp_path / "half.mkv", halves)
    source = Video(str(path), layout="side-by-side", scale_calibration=True).open()
    assert source.rig.left.size_px == (WIDTH // 2, HEIGHT)
    assert (source.rig.left.K[0, 0], source.rig.left.K[1, 1]) == (30, 60)
    assert source.rig.is_rectified
    assert np.array_equal(source.load(2).right, RIGHT[2][:, ::2])
    assert any(note.startswith("squeezed: an eye is 0.5 times") for note in source.summary.notes)


def test_a_resized_video_is_known_by_its_shape(tmp_path: Path) -> None:
    path = packed(tmp_path, "side-by-side")
    rig = RIG | {"width_px": 2 * WIDTH, "height_px": 2 * HEIGHT}
    (tmp_path / "rig.json").write_text(json.dumps(rig))
    source = Video(str(path), scale_calibration=True).open()
    assert is_pair(source, 0, 0, 0)
    assert source.rig.left.focal_px == 30


def test_the_right_eye_may_come_first(tmp_path: Path) -> None:
    path = packed(tmp_path, "side-by-side")
    frame = Video(str(path), swap=True).open().load(4)
    assert np.array_equal(frame.left, RIGHT[4])
    named = packed(tmp_path, "side-by-side", "n.mkv", metadata={"stereo_mode": "right_left"})
    source = Video(str(named)).open()
    assert np.array_equal(source.load(4).left, RIGHT[4])
    assert any("as the file says" in note for note in source.summary.notes)


def test_what_cannot_be_halved_is_refused(tmp_path: Path) -> None:
    with_rig(tmp_path)
    path = write_video(tmp_path / "odd.mkv", pictures(3, 129, 48))
    with pytest.raises(SourceUnknown, match="cannot be halved"):
        Video(str(path), layout="side-by-side").open()


# --- time ----------------------------------------------------------------------------------


def at(folder: Path, left_ms: list[int], right_ms: list[int], name: str = "{}.mkv") -> Path:
    """Two videos whose frame n of either eye is that of 100 ms times n, shown when said."""
    with_rig(folder)
    for eye, shown, times in (("left", LEFT, left_ms), ("right", RIGHT, right_ms)):
        kept = [shown[round(ms / 100)] for ms in times]
        write_video(folder / name.format(eye), kept, ticks=times, time_base=MS)
    return folder


def test_dropped_frames_are_refused_and_never_shift_the_others(tmp_path: Path) -> None:
    lefts = [100 * k for k in range(10) if k not in (3, 4)]
    rights = [100 * k + 2 for k in range(10) if k != 7]
    source = Video(str(at(tmp_path, lefts, rights))).open()
    kept = [k for k in range(10) if k not in (3, 4, 7)]
    # Moments keep their numbers: those of one eye alone are counted.
    assert source.ids == tuple(f"{k:06d}" for k in kept)
    assert all(is_pair(source, i, k, k) for i, k in enumerate(kept))
    assert source.timestamps_ns == tuple(10**9 + k * 10**8 for k in kept)
    assert [name for name, _ in source.refused] == ["000003", "000004", "000007"]
    assert all(isinstance(error, ImageMissing) for _, error in source.refused)
    assert "the left eye" in source.refused[0][1].got
    assert "the nearest is -98.000 ms away" in source.refused[2][1].got
    assert any("3 frames of one eye alone" in note for note in source.summary.notes)
    assert any("largest difference 2 ms" in note for note in source.summary.notes)


def test_variable_rates_pair(tmp_path: Path) -> None:
    times = [0, 110, 190, 320, 400, 480, 610]
    source = Video(str(at(tmp_path, times, [t + 3 for t in times]))).open()
    assert source.timestamps_ns == tuple(10**9 + t * 10**6 for t in times)
    assert is_pair(source, 6, 6, 6)


def test_eyes_that_began_at_other_times(tmp_path: Path) -> None:
    lefts = [100 * k for k in range(8)]
    place = str(at(tmp_path, lefts, [t + 40 for t in lefts]))
    with pytest.raises(SourceEmpty, match=r"the nearest is \+40\.000 ms away") as caught:
        Video(place).open()
    assert "--source.right-delay-s" in caught.value.fix
    assert len(Video(place, right_delay_s=-0.04).open().ids) == 8
    assert len(Video(place, tolerance_s=0.041).open().ids) == 8


def test_files_of_times_replace_those_of_the_videos(tmp_path: Path) -> None:
    two_videos(tmp_path)
    stamps = [10**18 + k * 33_333_333 for k in range(FRAMES)]
    (tmp_path / "t.txt").write_text("".join(f"{stamp}\n" for stamp in stamps))
    (tmp_path / "u.txt").write_text("".join(f"{stamp + 5_000_000}\n" for stamp in stamps[1:]))
    (tmp_path / "u.txt").write_text("1000000000.3\n" + (tmp_path / "u.txt").read_text())
    source = Video(str(tmp_path), times=str(tmp_path / "t.txt")).open()
    assert source.timestamps_ns == tuple(stamps)
    rights = [f"{stamp + 5_000_000}\n" for stamp in stamps[1:]] + [f"{stamps[-1] + 10**9}\n"]
    (tmp_path / "u.txt").write_text("".join(rights))
    both = Video(
        str(tmp_path), times=str(tmp_path / "t.txt"), right_times=str(tmp_path / "u.txt")
    ).open()
    assert both.ids[0] == "000001"
    assert is_pair(both, 0, 1, 0)
    assert both.timestamps_ns[0] == stamps[1]
    with pytest.raises(UsageError):
        Video(str(tmp_path), right_times=str(tmp_path / "u.txt")).open()


def test_a_file_of_times_in_the_folder_is_used_and_checked(tmp_path: Path) -> None:
    two_videos(tmp_path)
    dates = [f"2011-09-26 13:02:25.{k:02d}4389445\n" for k in range(FRAMES)]
    (tmp_path / "timestamps.txt").write_text("".join(dates))
    source = Video(str(tmp_path)).open()
    assert source.timestamps_ns[1] == 1_317_042_145_014_389_445
    assert "time: of timestamps.txt, dates in UTC" in source.summary.notes
    (tmp_path / "timestamps.txt").write_text("".join(dates[:-1]))
    with pytest.raises(SequenceTime, match="11 stamps"):
        Video(str(tmp_path)).open()


def test_a_stream_without_times_gets_made_up_ones(tmp_path: Path) -> None:
    both = [np.hstack([a, b]) for a, b in zip(LEFT, RIGHT, strict=True)]
    how = {"codec": "mjpeg", "pix_fmt": "yuvj420p"}
    path = write_video(with_rig(tmp_path) / "raw.mjpeg", both, **how)
    source = Video(str(path), rate_hz=4).open()
    assert source.timestamps_ns[:3] == (1_000_000_000, 1_250_000_000, 1_500_000_000)
    assert any(note.startswith("time: synthetic") for note in source.summary.notes)
    want = Video(str(path)).open()
    frames = [want.load(n).left for n in range(FRAMES)]
    for n in (7, 2, 11, 0, 5):
        assert np.array_equal(source.load(n).left, frames[n])


# --- as a source ---------------------------------------------------------------------------


def test_a_selection_decodes_no_more_than_key_frames_force(tmp_path: Path) -> None:
    with_rig(tmp_path)
    many = pictures(120, seed=1)
    how = H264 | {"gop": 30}
    for eye in ("left", "right"):
        write_video(tmp_path / f"{eye}.mp4", many, **how)
    whole = Video(str(tmp_path)).open()
    chosen = select(whole, FrameSelection.parse("60:64"), FrameSelection.parse("62"))
    assert chosen.ids == ("000060", "000061", "000063")
    before = whole.left.packets_decoded
    for index in range(3):
        assert chosen.load(index).id == chosen.ids[index]
    assert whole.left.packets_decoded - before < 12


def test_an_opened_video_travels(tmp_path: Path) -> None:
    source = pickle.loads(pickle.dumps(Video(str(packed(tmp_path, "top-bottom"))).open()))
    assert is_pair(source, 9, 9, 9)


def test_a_video_that_ends_early_refuses_the_rest(tmp_path: Path) -> None:
    import av

    path = packed(tmp_path, "side-by-side", "both.mp4")
    front = tmp_path / "front.mp4"
    options = {"movflags": "faststart"}
    with av.open(str(path)) as old, av.open(str(front), "w", options=options) as new:
        stream = new.add_stream_from_template(old.streams.video[0])
        for packet in old.demux(video=0):
            if packet.size:
                packet.stream = stream
                new.mux(packet)
    data = front.read_bytes()
    front.write_bytes(data[: round(0.6 * len(data))])
    source = Video(str(front)).open()
    name, error = source.refused[-1]
    assert isinstance(error, VideoDamaged)
    assert "after it are not in the file" in error.got
    assert 3 < int(name) < FRAMES
    assert is_pair(source, 2, 2, 2)


def test_pictures_are_preferred_to_a_video_beside_them(tmp_path: Path) -> None:
    from pseudolidar.formats.pictures.image import encode_png

    two_videos(tmp_path)
    for eye, shown in (("left", LEFT), ("right", RIGHT)):
        (tmp_path / eye).mkdir()
        (tmp_path / eye / "1.png").write_bytes(encode_png(shown[0]))
    assert isinstance(recognise(str(tmp_path)), Folders)
