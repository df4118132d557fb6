"""`convert --video`: what the preview shows, its pace, and its bytes after kills."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import av
import numpy as np
import pytest
from pseudolidar.pipelines.convert import Convert, run

from pseudolidar.cli import main
from pseudolidar.evaluation.pictures import disparity_picture
from pseudolidar.evaluation.preview_picture import CAPTION_PX
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.running.journal.journal_file import JOURNAL_NAME
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.running.products.preview import LONGEST_S, PREVIEW_NAME, Preview, steps_ticks
from pseudolidar.sources.recognise import recognise
from tests.pipelines.conftest import DISPARITY_PX, FRAMES

PANEL_PX = (318, 636)  # the tiny drive is twice as wide as high


def made(source: Path, out: Path, **settings) -> Path:
    to = Outputs(("npz",))
    assert run(Convert(recognise(str(source)), out, to, video=True, **settings)).exit_code == 0
    return out / PREVIEW_NAME


def frames_of(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


@pytest.fixture(scope="module")
def preview(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(drive, tmp_path_factory.mktemp("preview"), workers=1)


def test_it_shows_photo_disparity_and_the_cloud(preview: Path, drive: Path) -> None:
    shown = frames_of(preview)
    assert len(shown) == FRAMES
    height, width, _ = shown[0].shape
    rows, columns = PANEL_PX
    side = 2 * rows + 4
    assert (height, width) == (side + CAPTION_PX, columns + 4 + side)
    assert not height % 2
    assert not width % 2
    for index in (0, 9):
        import cv2

        photo = read_image(drive / "left" / f"{index:06d}.png").pixels
        large = cv2.resize(photo, (columns, rows), interpolation=cv2.INTER_LINEAR)
        got = shown[index][:rows, :columns].astype(int)
        assert np.abs(got - large)[30:].mean() < 14  # noise is hard to compress
        other = cv2.resize(read_image(drive / "left" / "000003.png").pixels, (columns, rows))
        assert np.abs(got - other)[30:].mean() > 40
    near = np.full((1, 1), DISPARITY_PX, np.float32)
    red = disparity_picture(near, float(DISPARITY_PX))[0, 0].astype(int)
    middle = shown[5][rows + 100 : rows + 200, 300:500].astype(int)
    assert np.abs(np.median(middle, axis=(0, 1)) - red).max() < 12
    view = shown[5][30:side, columns + 4 :]
    assert (view.max(axis=2) > 60).mean() > 0.001
    bar = shown[5][side + 4 :]
    assert bar.max() > 180
    assert not np.array_equal(shown[4][side + 4 :], bar)


def test_the_report_shows_it(preview: Path) -> None:
    page = (preview.parent / "report.html").read_text()
    assert (
        f'<video controls loop muted playsinline preload="metadata" src="{PREVIEW_NAME}">' in page
    )
    assert main(["convert", "--settings", str(preview.parent / "run.json")]) == 0


def test_any_number_of_workers_gives_the_same_bytes(preview: Path, drive: Path, tmp_path) -> None:
    assert made(drive, tmp_path, workers=3).read_bytes() == preview.read_bytes()


def test_killed_and_continued_it_is_the_same(long_drive: Path, tmp_path: Path) -> None:
    whole = made(long_drive, tmp_path / "whole", workers=1)
    out = tmp_path / "out"
    line = ["convert", str(long_drive), str(out), "--to", "npz", "--video"]
    journal = out / JOURNAL_NAME
    for lines in (8, 30):
        child = subprocess.Popen([sys.executable, "-m", "pseudolidar.cli", *line])
        deadline = time.monotonic() + 60
        while not (journal.exists() and journal.read_bytes().count(b"\n") > lines):
            assert time.monotonic() < deadline, "waited in vain"
            assert child.poll() is None, "it was done before it could be killed"
            time.sleep(0.001)
        child.kill()
        assert child.wait() == -signal.SIGKILL
        assert not (out / PREVIEW_NAME).exists()
    assert main(line) == 0
    assert (out / PREVIEW_NAME).read_bytes() == whole.read_bytes()
    assert not list(out.glob("*.tmp"))


def test_a_complete_preview_is_left_alone_and_a_lost_one_made_again(drive, tmp_path) -> None:
    path = made(drive, tmp_path)
    before, data = path.stat().st_mtime_ns, path.read_bytes()
    made(drive, tmp_path)
    assert path.stat().st_mtime_ns == before
    path.unlink()
    assert made(drive, tmp_path).read_bytes() == data


def test_frames_keep_their_pace(own_drive: Path, tmp_path: Path) -> None:
    times = (0.5, 0.6, 0.85, 0.9, 50.0, 50.1)
    (own_drive / "times.txt").write_text("".join(f"{time_s}\n" for time_s in times))
    path = made(own_drive, tmp_path / "out")
    with av.open(str(path)) as container:
        got = [float(frame.pts * frame.time_base) for frame in container.decode(video=0)]
    assert got == pytest.approx([0, 0.1, 0.35, 0.4, 0.4 + LONGEST_S, 0.5 + LONGEST_S], abs=1e-4)
    fast = made(own_drive, tmp_path / "fast", preview=Preview(speed=2))
    with av.open(str(fast)) as container:
        assert container.duration == pytest.approx((0.25 + LONGEST_S + 0.05) * 1e6, rel=0.1)


def test_steps_sum_up_without_drift() -> None:
    stamps = [round(k * 1e9 / 30) for k in range(3001)]
    assert abs(sum(steps_ticks(stamps, 1.0)[:-1]) - 9_000_000) <= 1
    assert steps_ticks([5], 1.0) == [90_000]


def test_a_source_of_clouds_is_seen_from_above(drive: Path, tmp_path: Path) -> None:
    clouds = tmp_path / "clouds"
    run(Convert(recognise(str(drive)), clouds, Outputs(("pcd",))))
    path = made(clouds / "pcd", tmp_path / "out")
    shown = frames_of(path)
    assert len(shown) == FRAMES
    assert shown[0].shape == (640 + CAPTION_PX, 640, 3)
    assert (shown[3][30:640].max(axis=2) > 60).mean() > 0.001


def test_skipped_frames_are_not_in_it(own_drive: Path, tmp_path: Path) -> None:
    (own_drive / "left" / "000000.png").write_bytes(b"damaged")
    (own_drive / "left" / "000003.png").write_bytes(b"damaged")
    out = tmp_path / "out"
    assert main(["convert", str(own_drive), str(out), "--to", "npz", "--video"]) == 4
    assert len(frames_of(out / PREVIEW_NAME)) == 4


def test_settings_without_meaning_are_refused(drive: Path, tmp_path: Path, capsys) -> None:
    line = ["convert", str(drive), str(tmp_path), "--video", "--preview.speed", "0", "--json"]
    assert main(line) == 2
    assert json.loads(capsys.readouterr().out)["error"]["where"] == "preview.speed"


def test_a_folder_without_a_preview_is_not_continued_with_one(drive, tmp_path, capsys) -> None:
    line = ["convert", str(drive), str(tmp_path), "--to", "npz"]
    assert main(line) == 0
    assert main([*line, "--video"]) == 2
    assert "video = false, this one has true" in capsys.readouterr().err
