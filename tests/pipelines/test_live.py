"""`live`: videos played through the code that reads cameras, by the path of `convert`."""

from __future__ import annotations

import json
import os
import pty
import resource
import select
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from pseudolidar.pipelines.convert import Convert
from pseudolidar.pipelines.convert import run as convert
from pseudolidar.pipelines.live import Live, run

from pseudolidar.cli import main
from pseudolidar.errors import (
    CalibrationMissing,
    CalibrationSizeMismatch,
    CameraUnavailable,
    EyesApart,
    OutputError,
    OutputSettings,
    PairIdentical,
    PairSwapped,
    SourceEmpty,
    UsageError,
)
from pseudolidar.formats.atomic import is_temporary
from pseudolidar.formats.mcap.log import frames_in, part_path
from pseudolidar.formats.points.pcd import read_pcd
from pseudolidar.formats.rigs.rig_json import read_rig
from pseudolidar.formats.rigs.rig_json import write_rig as write_whole_rig
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.sources.capture.cameras import CameraSettings
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.rectified import Rectify
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import RowCorrection
from tests.cameras import (
    HEIGHT,
    RIG,
    WIDTH,
    damaged,
    eyes,
    number_of,
    send_until,
    write_eyes,
    write_rig,
    writer,
)
from tests.videos import pictures, write_video

FRAMES = 24
LEFT, RIGHT = eyes(FRAMES)
# Every pair waits for its worker: what is to be compared must not depend on how fast this is.
ALL = CameraSettings(speed=4.0, kept=FRAMES)


@pytest.fixture(scope="module")
def videos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("videos")
    write_rig(folder)
    write_eyes(folder, LEFT, RIGHT)
    return folder


def job(folder: Path, out: Path, *, to: str = "pcd,mcap", **options) -> Live:
    left, right = str(folder / "left.mkv"), str(folder / "right.mkv")
    defaults = {"realtime": True, "camera": ALL, "check": False}
    return Live(left, right, out, to=Outputs.parse(to), **defaults | options)


def report_of(out: Path) -> dict:
    return json.loads((out / "run.json").read_text())


def adds_up(live: dict) -> bool:
    pairs = live["formed"] == live["taken"] + live["dropped"] + live["waiting"]
    return pairs and all(
        eye["arrived"] == live["formed"] + eye["alone"] + eye["waiting"]
        for eye in live["cameras"].values()
    )


def child(*arguments: object, **how) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "pseudolidar.cli", "live", *map(str, arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **how
    )


def wait_for(condition, seconds: float = 100.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.01)


def journal_lines(out: Path) -> int:
    path = out / "journal.jsonl"
    return path.read_bytes().count(b"\n") if path.exists() else 0


# --- the same as convert -------------------------------------------------------------------


def bent(rig: StereoRig) -> StereoRig:
    """Lenses with a little distortion: the pictures are not rectified."""
    lens = np.array([0.02, 0.0, 0.0, 0.0, 0.0])
    left, right = (replace(camera, distortion=lens) for camera in (rig.left, rig.right))
    return replace(rig, left=left, right=right)


def uneven(rig: StereoRig) -> StereoRig:
    """Right pictures lie half a row too low."""
    return rig.with_rows(RowCorrection(0.5 * np.eye(9)[0], 0.1))


@pytest.mark.parametrize("change", [lambda rig: rig, bent, uneven])
def test_the_clouds_are_those_of_convert(videos: Path, tmp_path: Path, change) -> None:
    write_whole_rig(tmp_path / "rig.json", change(read_rig(videos / "rig.json")))
    rig = tmp_path / "rig.json"
    report = run(job(videos, tmp_path / "live", rig=rig, preview=True))
    assert report.exit_code == 0
    picture = cv2.imread(str(tmp_path / "live/live.jpg"))
    assert picture.shape[0] > 100
    assert picture.std() > 20
    every = Convert(
        recognise(str(videos)), tmp_path / "all", to=Outputs.parse("pcd"), rig=rig, check=False
    )
    convert(every)
    names = [path.name for path in sorted((tmp_path / "all/pcd").iterdir())]
    assert [path.name for path in sorted((tmp_path / "live/pcd").iterdir())] == names
    assert len(names) == FRAMES
    for name in names:
        live, whole = (tmp_path / place / "pcd" / name for place in ("live", "all"))
        assert live.read_bytes() == whole.read_bytes()
    assert frames_in(tmp_path / "live/left.mkv.mcap") == tuple(name[:-4] for name in names)
    live = report_of(tmp_path / "live")["live"]
    assert adds_up(live)
    assert live["frames"] == live["taken"] == FRAMES
    assert 0 < live["latency_p50_s"] <= live["latency_p95_s"]
    assert report.as_dict()["live"]["cameras"]["left"]["arrived"] == FRAMES
    assert set(report_of(tmp_path / "live")["source"]["notes"]) <= set(
        report_of(tmp_path / "all")["source"]["notes"]
    )


def test_who_is_too_slow_drops_pairs_and_writes_the_others_whole(
    videos: Path, tmp_path: Path
) -> None:
    camera = CameraSettings(speed=50.0)
    report = run(job(videos, tmp_path, camera=camera, workers=1))
    live = report.as_dict()["live"]
    assert adds_up(live)
    assert live["formed"] == FRAMES
    assert live["taken"] == live["frames"] < FRAMES
    assert len(list((tmp_path / "pcd").iterdir())) == live["frames"]
    names = frames_in(tmp_path / "left.mkv.mcap")
    assert names == tuple(f"{index:06d}" for index in range(live["frames"]))


def test_half_the_size_with_a_rig_of_half_the_size(videos: Path, tmp_path: Path) -> None:
    run(job(videos, tmp_path, to="disparity,pcd", scale=0.5, frames_count=1))
    small = cv2.imread(str(tmp_path / "disparity/000000.png"), cv2.IMREAD_UNCHANGED)
    assert small.shape == (HEIGHT // 2, WIDTH // 2)
    assert np.median(small[small > 0]) / 256 == pytest.approx(4.5, abs=0.2)
    z = read_pcd(tmp_path / "pcd/000000.pcd").xyz[:, 2]
    assert np.nanmedian(z) == pytest.approx(100 * 0.5 / 9, rel=0.05)


@pytest.mark.parametrize(("right", "layout"), [("side-by-side", 1), ("top-bottom", 0), (None, 1)])
def test_one_camera_with_both_eyes(tmp_path: Path, right: str | None, layout: int) -> None:
    both = [np.concatenate(pair, axis=layout) for pair in zip(LEFT[:4], RIGHT[:4], strict=True)]
    path = write_video(tmp_path / "both.mkv", both, rate=50)
    write_rig(tmp_path)
    settings = Live(
        str(path), right, tmp_path / "out", to=Outputs.parse("disparity"), realtime=True, camera=ALL
    )
    assert len(run(settings).result.committed) == 4
    found = cv2.imread(str(tmp_path / "out/disparity/000003.png"), cv2.IMREAD_UNCHANGED)
    assert np.median(found[found > 0]) / 256 == pytest.approx(9, abs=0.1)


def test_limits(videos: Path, tmp_path: Path) -> None:
    assert len(run(job(videos, tmp_path / "a", frames_count=3)).result.committed) == 3
    slow = CameraSettings(speed=0.04)  # a picture every half second
    report = run(job(videos, tmp_path / "b", camera=slow, seconds=1.7))
    assert 1 <= len(report.result.committed) <= 4
    assert report.exit_code == 0


def test_damaged_and_lonely_pictures_are_counted(videos: Path, tmp_path: Path) -> None:
    write_rig(tmp_path)
    (tmp_path / "right.mkv").write_bytes((videos / "right.mkv").read_bytes())
    damaged(videos / "left.mkv", tmp_path / "left.mkv", [15], 0.5)
    report = run(job(tmp_path, tmp_path / "out"))
    live = report.as_dict()["live"]
    assert adds_up(live)
    assert live["cameras"]["left"]["damaged"] >= 1
    assert live["frames"] == live["cameras"]["left"]["arrived"] < FRAMES
    other = live["cameras"]["right"]
    assert other["alone"] + other["waiting"] == FRAMES - live["frames"]


def test_a_frame_in_which_nothing_is_to_be_seen_is_skipped(videos: Path, tmp_path: Path) -> None:
    dark = [np.zeros_like(picture) for picture in LEFT[:2]]
    write_eyes(tmp_path, LEFT[:5] + dark, RIGHT[:5] + dark)
    write_rig(tmp_path)
    report = run(job(tmp_path, tmp_path / "out"))
    assert report.exit_code == 4
    assert [record.id for record in report.result.skipped] == ["000005", "000006"]
    assert "2 skipped" in report.text()
    write_eyes(tmp_path, dark, dark)
    with pytest.raises(PairIdentical):
        run(job(tmp_path, tmp_path / "dark"))


# --- ended from outside --------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_all_that_was_written_whole(
    videos: Path, tmp_path: Path, number: signal.Signals
) -> None:
    out = tmp_path / "out"
    places = videos / "left.mkv", videos / "right.mkv", out
    process = child(*places, "--realtime", "--to", "pcd,mcap", "--camera.speed", "0.05", "--json")
    wait_for(lambda: journal_lines(out) > 2 or process.poll() is not None)
    process.send_signal(number)
    said, told = process.communicate(timeout=100)
    assert process.returncode == 128 + number, told
    report = json.loads(said)
    assert report["ended_early"]
    assert adds_up(report["live"])
    names = frames_in(out / "left.mkv.mcap")
    assert not part_path(out / "left.mkv.mcap").exists()
    assert {path.stem for path in (out / "pcd").iterdir()} == set(names)
    assert len(names) == report["committed"] >= 2
    for path in (out / "pcd").iterdir():
        assert len(read_pcd(path)) > 1000


def test_killed_in_the_middle_the_same_command_adds_to_it(tmp_path: Path) -> None:
    """Pipes are cameras: the second run goes on with new frames behind those of the first."""
    folder, out = tmp_path / "cameras", tmp_path / "out"
    write_rig(folder)
    both = [np.hstack(pair) for pair in zip(LEFT, RIGHT, strict=True)]
    video = write_video(folder / "both.mkv", both * 20, rate=50)
    os.mkfifo(folder / "pipe")
    arguments = [
        folder / "pipe", "side-by-side", out, "--rig", folder / "rig.json", "--to", "pcd,mcap",
        "--camera.kept", 50, "--camera.patience-s", 100, "--no-check",
    ]  # fmt: skip
    feed = writer(video, folder / "pipe", count=3)
    process = child(*arguments)
    send_until(feed, lambda: journal_lines(out) > 3 or process.poll() is not None)
    process.kill()
    process.communicate()
    feed.kill()
    feed.wait()
    before = {path.name: path.read_bytes() for path in (out / "pcd").iterdir()}
    committed = journal_lines(out) - 1
    assert committed >= 3
    feed = writer(video, folder / "pipe", count=3)
    process = child(*arguments, "--frames-count", 4)
    send_until(feed, lambda: process.poll() is not None)
    said, told = process.communicate(timeout=100)
    feed.kill()
    feed.wait()
    assert process.returncode == 0, told
    assert f"{committed + 4} frames, {committed} of them from before" in said
    names = frames_in(out / "pipe.mcap")
    assert names == tuple(f"{index:06d}" for index in range(committed + 4))
    after = {path.name: path.read_bytes() for path in (out / "pcd").iterdir()}
    assert sorted(after) == [f"{name}.pcd" for name in names]
    whole = [name for name in before if name[:-4] in names[:committed]]
    assert all(after[name] == before[name] for name in whole)


def test_videos_do_not_add_to_what_is_there(videos: Path, tmp_path: Path) -> None:
    run(job(videos, tmp_path, frames_count=2))
    with pytest.raises(OutputSettings, match="begin anew"):
        run(job(videos, tmp_path))
    with pytest.raises(OutputSettings, match=r"calibration.*and 1 more"):
        run(job(videos, tmp_path, scale=0.5))
    assert len(run(job(videos, tmp_path, frames_count=3, overwrite=True)).result.committed) == 3
    assert len(list((tmp_path / "pcd").iterdir())) == 3


# --- saving pairs --------------------------------------------------------------------------


def test_pairs_are_saved_every_so_often(videos: Path, tmp_path: Path) -> None:
    """24 pictures at 50 Hz; every 0.1 s is every fifth, by the clock of the cameras."""
    report = run(job(videos, Path("nowhere"), capture=tmp_path / "pairs", every=0.1))
    assert report.exit_code == 0
    assert not Path("nowhere").exists()
    saved = sorted((tmp_path / "pairs/left").iterdir())
    numbers = []
    for path in saved:
        left = cv2.imread(str(path))[..., ::-1]
        right = cv2.imread(str(tmp_path / "pairs/right" / path.name))[..., ::-1]
        numbers.append(number_of(left, LEFT))
        assert number_of(right, RIGHT) == numbers[-1]
    assert numbers == [0, 5, 10, 15, 20]
    source = recognise(str(tmp_path / "pairs"))
    assert type(source).__name__ == "Folders"


def test_keys_save_pairs_and_end_the_run(videos: Path, tmp_path: Path) -> None:
    """A real terminal: space twice, then q."""
    master, slave = pty.openpty()
    pairs = tmp_path / "pairs"
    process = child(
        videos / "left.mkv", videos / "right.mkv", "--realtime", "--capture", pairs,
        "--camera.speed", "0.02", stdin=slave, preexec_fn=_takes_the_terminal,
    )  # fmt: skip
    os.close(slave)
    wait_for(lambda: (pairs / ".lock").exists() or process.poll() is not None)
    deadline = time.monotonic() + 100
    while journal_lines(pairs) < 3 and time.monotonic() < deadline and process.poll() is None:
        os.write(master, b" ")
        select.select([], [], [], 0.2)
    os.write(master, b"q")
    said, told = process.communicate(timeout=100)
    os.close(master)
    assert process.returncode == 0, told
    lefts, rights = (sorted(p.name for p in (pairs / eye).iterdir()) for eye in ("left", "right"))
    assert lefts == rights
    assert len(lefts) >= 2
    assert f"{len(lefts)} frames" in said


def _takes_the_terminal() -> None:
    import fcntl
    import termios

    os.setsid()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


# --- what cannot be meant ------------------------------------------------------------------


def test_no_calibration_and_one_of_another_size(videos: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    bare.mkdir()
    for name in ("left.mkv", "right.mkv"):
        (bare / name).write_bytes((videos / name).read_bytes())
    with pytest.raises(CalibrationMissing):
        run(job(bare, tmp_path / "out"))
    rig = json.loads((videos / "rig.json").read_text()) | {"width_px": 2 * WIDTH}
    (tmp_path / "rig.json").write_text(json.dumps(rig))
    with pytest.raises(CalibrationSizeMismatch, match="256x64"):
        run(job(bare, tmp_path / "out", rig=tmp_path / "rig.json"))
    assert not (tmp_path / "out").exists()


def test_videos_that_make_no_pair_are_told(videos: Path, tmp_path: Path) -> None:
    write_rig(tmp_path)
    write_eyes(tmp_path, LEFT[:5], RIGHT[:5], right_ticks=[9, 29, 49, 69, 89])
    with pytest.raises(EyesApart, match="9 ms apart"):
        run(job(tmp_path, tmp_path / "out"))
    damaged(videos / "left.mkv", tmp_path / "left.mkv", range(FRAMES), 0.3)
    with pytest.raises(SourceEmpty, match="left video"):
        run(job(tmp_path, tmp_path / "none"))
    assert not (tmp_path / "none").exists()


def test_swapped_cameras_are_named_before_anything_is_written(tmp_path: Path) -> None:
    folder = tmp_path / "cameras"
    wide = pictures(3, 480 + 9, 270, seed=8)
    left, right = ([np.ascontiguousarray(p[:, a:b]) for p in wide] for a, b in ((0, 480), (9, 489)))
    write_eyes(folder, right, left, rate=5)
    eye = {"fx": 400.0, "fy": 400.0, "cx": 239.5, "cy": 134.5}
    rig = RIG | {"width_px": 480, "height_px": 270, "left": eye, "right": eye}
    (folder / "rig.json").write_text(json.dumps(rig))
    with pytest.raises(PairSwapped, match="--swap"):
        run(job(folder, tmp_path / "out", check=True))
    assert not (tmp_path / "out").exists()
    report = run(job(folder, tmp_path / "out", check=True, swap=True))
    assert report.exit_code == 0
    assert report.as_dict()["live"]["eyes"] == "right"


@pytest.mark.parametrize(
    "options",
    [
        {"scale": 0.0},
        {"scale": 1.5},
        {"seconds": -1.0},
        {"frames_count": 0},
        {"every": 2.0},
        {"to": "kitti"},
        {"rectify": Rectify(views=3)},
    ],
)
def test_settings_that_mean_nothing(videos: Path, tmp_path: Path, options: dict) -> None:
    with pytest.raises(UsageError):
        job(videos, tmp_path, **options)


def test_a_camera_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_rig(tmp_path)
    arguments = ["live", "97", "98", str(tmp_path / "out"), "--rig", str(tmp_path / "rig.json")]
    assert main([*arguments, "--json"]) == CameraUnavailable.exit_code == 5
    error = json.loads(capsys.readouterr().out)["error"]
    assert (error["code"], error["path"]) == ("CameraUnavailable", "/dev/video97")
    assert not (tmp_path / "out").exists()


def test_a_camera_that_ends_for_good_leaves_whole_files_and_says_so(tmp_path: Path) -> None:
    folder, out = tmp_path / "cameras", tmp_path / "out"
    write_rig(folder)
    both = [np.hstack(pair) for pair in zip(LEFT, RIGHT, strict=True)]
    video = write_video(folder / "both.mkv", both * 20, rate=50)
    os.mkfifo(folder / "pipe")
    feed = writer(video, folder / "pipe", count=3)
    process = child(
        folder / "pipe", "side-by-side", out, "--rig", folder / "rig.json", "--no-check",
        "--camera.kept", 50, "--camera.patience-s", 3, "--json",
    )  # fmt: skip
    send_until(feed, lambda: journal_lines(out) > 3 or process.poll() is not None)
    feed.kill()
    feed.wait()
    said, told = process.communicate(timeout=100)
    assert process.returncode == 5, told
    error = json.loads(said)["error"]
    assert error["code"] in ("CameraLost", "CameraStalled")
    assert report_of(out)["exit_code"] == 5
    assert len(frames_in(out / "pipe.mcap")) == report_of(out)["committed"] >= 3
    assert not part_path(out / "pipe.mcap").exists()


def test_a_full_disk_ends_it_with_whole_files(videos: Path, tmp_path: Path) -> None:
    """A file may grow to four frames of the recording: each cloud fits in."""
    out = tmp_path / "out"

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (600_000, 600_000))

    process = child(
        videos / "left.mkv", videos / "right.mkv", out, "--realtime", "--to", "pcd,mcap",
        "--camera.kept", FRAMES, "--no-check", "--preview", "--json", preexec_fn=limited,
    )  # fmt: skip
    said, told = process.communicate(timeout=100)
    assert process.returncode == OutputError.exit_code == 5, told
    assert json.loads(said)["error"]["code"] == "OutputError"
    clouds = sorted((out / "pcd").iterdir())
    assert len(clouds) == report_of(out)["committed"] < FRAMES
    assert all(len(read_pcd(path)) > 1000 for path in clouds)
    assert not [path for path in out.rglob("*") if is_temporary(path.name)]


def test_no_picture_of_anybody_is_written_over(videos: Path, tmp_path: Path) -> None:
    (tmp_path / "left").mkdir()
    mine = tmp_path / "left" / "000000.png"
    mine.write_bytes(b"mine")
    for overwrite in (False, True):
        saving = job(videos, Path("out"), capture=tmp_path, every=0.1, overwrite=overwrite)
        with pytest.raises(UsageError, match="no run has written it"):
            run(saving)
    assert mine.read_bytes() == b"mine"
    mine.rename(tmp_path / "live.jpg")
    with pytest.raises(UsageError, match="no run has written it"):
        run(job(videos, tmp_path))
    (tmp_path / "live.jpg").rename(mine := tmp_path / "left0.png")  # left/ and right/ would hide it
    with pytest.raises(UsageError, match="no run has written it"):
        run(job(videos, Path("out"), capture=tmp_path, every=0.1))
