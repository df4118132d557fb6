"""Cameras read in threads: real videos played, real pipes written by real processes."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import (
    CameraChanged,
    CameraLost,
    CameraStalled,
    CameraUnavailable,
    CaptureEnded,
    PseudolidarError,
    UsageError,
    VideoUnreadable,
)
from pseudolidar.formats.video.pixels import to_pixels
from pseudolidar.sources.capture.address import CameraAddress
from pseudolidar.sources.capture.cameras import Cameras, CameraSettings, Capture
from pseudolidar.sources.capture.shots import ShotPair
from pseudolidar.structures.image_size import ImageSize
from tests.cameras import MJPEG, damaged, eyes, number_of, write_eyes, writer
from tests.sources.capture.test_pair_buffer import adds_up
from tests.videos import H264, decoded, pictures, write_video

FRAMES = 30
LEFT, RIGHT = eyes(FRAMES)
PLAYED = CameraSettings(speed=2.0)
PATIENT = CameraSettings(patience_s=10.0, clock="stream")


def pixels(pair: ShotPair) -> list[np.ndarray]:
    return [to_pixels(shot.picture, rotated=False).pixels for shot in pair.shots]


def drained(capture: Capture, pause_s: float = 0.0) -> tuple[list[ShotPair], PseudolidarError]:
    """Every pair, for somebody who takes a while for each, and what ended them."""
    found = []
    while True:
        try:
            found.append(capture.take())
        except PseudolidarError as error:
            return found, error
        time.sleep(pause_s)


def all_pairs(capture: Capture, pause_s: float = 0.0) -> list[ShotPair]:
    """Every pair of videos that are played to their end."""
    found, error = drained(capture, pause_s)
    assert isinstance(error, CaptureEnded)
    return found


@pytest.fixture(scope="module")
def videos(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    left, right = write_eyes(tmp_path_factory.mktemp("videos"), LEFT, RIGHT)
    return str(left), str(right)


# --- played videos -------------------------------------------------------------------------


@pytest.mark.parametrize("pause_s", [0.0, 0.05])
def test_pairs_are_whole_in_order_and_of_one_moment(videos, pause_s: float) -> None:
    with Cameras(*videos, realtime=True, settings=PLAYED).open().begin() as capture:
        found = all_pairs(capture, pause_s)
        counts = capture.counts
    numbers = []
    for pair in found:
        left, right = pixels(pair)
        number = number_of(left, LEFT)
        assert number_of(right, RIGHT) == number
        assert pair.time_ns == 1_000_000_000 + number * 20_000_000
        numbers.append(number)
    assert numbers == sorted(set(numbers))
    assert numbers[-1] == FRAMES - 1, "the newest is there at the end"
    assert adds_up(counts)
    assert counts.taken == len(found)
    assert counts.formed == FRAMES
    assert counts.dropped == FRAMES - len(found)


def test_who_takes_nothing_holds_up_nobody_and_gets_the_newest(videos) -> None:
    with (
        Cameras(*videos, realtime=True, settings=CameraSettings(speed=20.0))
        .open()
        .begin() as capture
    ):
        while capture.counts.formed < FRAMES:
            time.sleep(0.01)
        assert capture.counts.dropped == FRAMES - 1
        assert number_of(pixels(capture.take())[0], LEFT) == FRAMES - 1


def test_pictures_of_one_eye_alone_are_left_out(tmp_path: Path) -> None:
    times = [20 * n for n in range(FRAMES)]
    kept = [n for n in range(FRAMES) if n not in (4, 5, 17)]
    late = {9: 8}  # 8 ms off, beyond a quarter of 20 ms
    ticks = [times[n] + late.get(n, 0) for n in kept]
    videos = write_eyes(tmp_path, LEFT, [RIGHT[n] for n in kept], right_ticks=ticks)
    settings = CameraSettings(speed=2.0, kept=FRAMES)
    with Cameras(*map(str, videos), realtime=True, settings=settings).open().begin() as capture:
        found = [pixels(pair) for pair in all_pairs(capture)]
    numbers = [number_of(left, LEFT) for left, _ in found]
    assert numbers == [n for n in kept if n != 9]
    assert numbers == [number_of(right, RIGHT) for _, right in found]
    assert adds_up(capture.counts)
    assert [eye.alone for eye in capture.counts.eyes] == [4, 1]


def test_the_pace_is_that_of_the_video(videos) -> None:
    """No machine is too slow for this: a picture is never there before it is due."""
    with (
        Cameras(*videos, realtime=True, settings=CameraSettings(kept=FRAMES))
        .open()
        .begin() as capture
    ):
        taken_ns = [pair.taken_ns for pair in all_pairs(capture)]
        slipped_ns = capture.slipped_s * 1e9
    assert taken_ns[-1] - taken_ns[0] >= (FRAMES - 1) * 20_000_000 - slipped_ns - 1


def test_a_damaged_jpeg_is_left_out_and_its_neighbours_are_not(tmp_path: Path) -> None:
    whole = write_video(tmp_path / "whole.mkv", LEFT, rate=50, **MJPEG)
    known = [to_pixels(frame, rotated=False).pixels for frame in decoded(whole)]
    bad = {3: 0.5, 8: 0.9, 20: 0.999}
    path = whole
    for number, keep in bad.items():
        path = damaged(path, tmp_path / f"{number}.mkv", [number], keep)
    settings = CameraSettings(speed=2.0, kept=FRAMES)
    with Cameras(str(path), realtime=True, settings=settings).open().begin() as capture:
        numbers = [number_of(pixels(pair)[0], known) for pair in all_pairs(capture)]
    assert numbers == [n for n in range(FRAMES) if n not in bad]
    assert capture.counts.eyes[0].damaged == len(bad)
    assert capture.counts.eyes[0].damage


@pytest.mark.parametrize("lost", [[5], [0], [5, 17]])
def test_what_is_predicted_from_a_damaged_picture_is_left_out(
    tmp_path: Path, lost: list[int]
) -> None:
    """Key frames stand at 0, 12 and 24."""
    whole = write_video(tmp_path / "whole.mkv", LEFT, rate=50, options={"bf": "0"}, **H264)
    known = [to_pixels(frame, rotated=False).pixels for frame in decoded(whole)]
    path = damaged(whole, tmp_path / "bad.mkv", lost, 0.5)
    settings = CameraSettings(speed=2.0, kept=FRAMES)
    with Cameras(str(path), realtime=True, settings=settings).open().begin() as capture:
        numbers = [number_of(pixels(pair)[0], known) for pair in all_pairs(capture)]
    spoilt = {n for bad in lost for n in range(bad, 12 * (bad // 12 + 1))}
    assert numbers == [n for n in range(FRAMES) if n not in spoilt]
    arrived, damage = capture.counts.eyes[0].arrived, capture.counts.eyes[0].damaged
    assert arrived == FRAMES - len(spoilt)
    assert damage >= len(lost) or lost == [0], "before the first whole picture nothing is missed"


def test_a_camera_that_changes_its_size_is_told(tmp_path: Path) -> None:
    """Two JPEG streams behind one another: what a camera sends that was told another size."""
    small = write_video(tmp_path / "a.mjpeg", pictures(6, 64, 48), **MJPEG)
    large = write_video(tmp_path / "b.mjpeg", pictures(6, 96, 48), **MJPEG)
    both = tmp_path / "both.mjpeg"
    both.write_bytes(small.read_bytes() + large.read_bytes())
    settings = CameraSettings(kept=20, speed=5)
    with Cameras(str(both), realtime=True, settings=settings).open().begin() as capture:
        found, error = drained(capture)
    assert isinstance(error, CameraChanged)
    assert "96x48" in error.got
    assert len(found) == capture.counts.eyes[0].arrived == 6


# --- pipes ---------------------------------------------------------------------------------


def test_a_pipe_that_a_process_writes(tmp_path: Path, videos) -> None:
    pipes = [tmp_path / "left", tmp_path / "right"]
    for pipe in pipes:
        os.mkfifo(pipe)
    process = writer(videos[0], pipes[0], videos[1], pipes[1])
    settings = CameraSettings(patience_s=10.0, clock="stream", kept=FRAMES)
    with Cameras(*map(str, pipes), settings=settings).open().begin() as capture:
        found = [pixels(capture.take()) for _ in range(FRAMES)]
    assert [number_of(left, LEFT) for left, _ in found] == list(range(FRAMES))
    assert [number_of(right, RIGHT) for _, right in found] == list(range(FRAMES))
    process.communicate(timeout=60)


def test_a_camera_that_vanishes_is_back_when_it_is_back(tmp_path: Path, videos) -> None:
    """One pipe, a writer that is killed in the middle of a picture's life, then another one."""
    os.mkfifo(tmp_path / "pipe")
    with Cameras(str(tmp_path / "pipe"), settings=PATIENT).open().begin() as capture:
        first = writer(videos[0], tmp_path / "pipe", count=10)
        before = capture.take()
        first.stdout.readline()
        first.kill()
        first.communicate()
        while not capture.counts.eyes[0].fault:
            time.sleep(0.02)
        second = writer(videos[0], tmp_path / "pipe")
        after = []
        while not after or number_of(pixels(after[-1])[0], LEFT) < FRAMES - 1:
            after.append(capture.take())
        second.communicate(timeout=60)
        counts = capture.counts
    times = [before.time_ns, *(pair.time_ns for pair in after)]
    assert times == sorted(set(times)), "its clock begins anew; ours goes on"
    assert counts.eyes[0].reopened == 1
    assert adds_up(counts)


def test_a_camera_that_does_not_come_back_ends_the_capture(tmp_path: Path, videos) -> None:
    os.mkfifo(tmp_path / "pipe")
    process = writer(videos[0], tmp_path / "pipe")
    settings = CameraSettings(patience_s=2.0, kept=FRAMES)
    with Cameras(str(tmp_path / "pipe"), settings=settings).open().begin() as capture:
        assert capture.seen().time_ns > 0
        process.communicate(timeout=60)
        _, error = drained(capture)
    assert isinstance(error, CameraLost | CameraStalled)
    assert error.exit_code == 5
    assert adds_up(capture.counts)


def test_a_pipe_that_nobody_writes_does_not_wait_for_ever(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    settings = CameraSettings(patience_s=0.3)
    with Cameras(str(tmp_path / "pipe"), settings=settings).open().begin() as capture:
        with pytest.raises(CameraStalled):
            capture.take()
        capture.stop()
        with pytest.raises((CameraStalled, CaptureEnded)):
            capture.take()


# --- what is no camera ---------------------------------------------------------------------


def test_a_camera_that_is_not_there_says_which_are() -> None:
    with pytest.raises(CameraUnavailable, match="/dev/video97: no such camera or file; th"):
        Cameras("97").open()


def test_a_device_that_is_no_camera() -> None:
    with (
        Cameras("/dev/null").open().begin() as capture,
        pytest.raises(CameraUnavailable, match=r"/dev/null.*wanted a camera"),
    ):
        capture.take()


def test_a_file_is_played_only_if_that_is_meant(videos, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--realtime"):
        Cameras(*videos).open()
    with pytest.raises(UsageError, match="neither"):
        Cameras(str(tmp_path), realtime=True).open()
    (tmp_path / "text.mp4").write_text("no video")
    with (
        Cameras(str(tmp_path / "text.mp4"), realtime=True).open().begin() as capture,
        pytest.raises(VideoUnreadable),
    ):
        capture.take()


def test_one_camera_is_not_two(videos) -> None:
    with pytest.raises(UsageError, match="both eyes"):
        Cameras(videos[0], videos[0], realtime=True).open()


@pytest.mark.parametrize("url", ["file:///etc/passwd", "concat://a|b", "pipe://0", "data://x"])
def test_an_address_reads_networks_and_nothing_else(url: str) -> None:
    with pytest.raises(UsageError):
        CameraAddress.of(url)
    assert CameraAddress.of("rtsp://camera/1").kind == "stream"


def test_a_network_address_where_nobody_answers() -> None:
    with (
        Cameras("tcp://127.0.0.1:9").open().begin() as capture,
        pytest.raises(CameraUnavailable, match="refused"),
    ):
        capture.take()


@pytest.mark.parametrize("text", ["1280", "x720", "0x720", "1280x", "1280 x 720", "١٢x٣"])
def test_sizes_that_are_none(text: str) -> None:
    with pytest.raises(UsageError):
        ImageSize.parse(text)
    assert str(ImageSize.parse("1280x720")) == "1280x720"


@pytest.mark.parametrize("name", ["rate", "tolerance_s", "patience_s", "kept", "speed"])
def test_numbers_that_mean_nothing(name: str) -> None:
    with pytest.raises(UsageError, match="above 0"):
        CameraSettings(**{name: -1})
