"""The kind of a source by its content."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import SourceUnknown, UsageError
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.kitti.object import KittiObject
from pseudolidar.sources.kitti.odometry import KittiOdometry
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.sources.synthetic import Synthetic

PICTURE = encode_png(np.zeros((4, 4), np.uint8))


def pictures(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(PICTURE)
    return folder


@pytest.mark.real
@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("kitti_raw/2011_09_26/2011_09_26_drive_0002_sync", KittiRaw),
        ("kitti_raw/2011_09_26", KittiRaw),
        ("kitti_raw", KittiRaw),
        ("kitti_object/training", KittiObject),
        ("kitti_object", KittiObject),
        ("kitti_stereo2015/training", KittiStereo),
        ("kitti_stereo2015", KittiStereo),
        ("kitti_odometry", KittiOdometry),
        ("kitti_odometry/sequences/06", KittiOdometry),
        ("chessboard/swapped_640x512", Folders),
        ("middlebury/motorcycle", Folders),
        ("bike_avoidance", Folders),
    ],
)
def test_real_layouts(real_data: Path, path: str, kind: type) -> None:
    source = recognise(str(real_data / path))
    assert type(source) is kind
    assert source.path == str(real_data / path)


@pytest.mark.real
@pytest.mark.parametrize("path", ["trajectories", "devkit_disparity", "README.md"])
def test_what_is_no_source(real_data: Path, path: str) -> None:
    with pytest.raises(SourceUnknown):
        recognise(str(real_data / path))


@pytest.mark.parametrize(
    "names",
    [
        ("left/1.png", "right/1.png"),
        ("1_l.png", "1_r.png"),
        ("scene/im0.png", "scene/im1.png"),
        ("image_0/000000.png", "image_1/000000.png"),
    ],
)
def test_folders(tmp_path: Path, names: tuple[str, ...]) -> None:
    folder = pictures(tmp_path, *names)
    (folder / "rig.json").write_text(json.dumps({}))
    assert recognise(str(folder)) == Folders(str(folder))


def test_synthetic() -> None:
    assert recognise("synthetic:room") == Synthetic("room")
    assert recognise("synthetic:street:40") == Synthetic("street", frames=40)
    for text in ("synthetic:street:x", "synthetic:street:0", "synthetic:street:"):
        with pytest.raises(UsageError):
            recognise(text)
        with pytest.raises(UsageError):
            Synthetic(text).open()


@pytest.mark.parametrize("path", ["room:3", "synthetic:room:3"])
def test_a_forced_world_takes_its_number_of_frames_too(path: str) -> None:
    opened = Synthetic(path).open()
    assert (opened.name, len(opened.ids)) == ("room", 3)
    assert opened.summary.line == recognise("synthetic:room:3").open().summary.line


def test_unknown_says_what_was_looked_for_and_seen(tmp_path: Path) -> None:
    folder = pictures(tmp_path, "a.png", "b.png", "sub/c.png")
    with pytest.raises(SourceUnknown) as caught:
        recognise(str(folder))
    assert "2 pictures and 1 folders (sub/, a.png, b.png" in caught.value.got
    assert "KITTI" in caught.value.want
    assert "left-pattern" in caught.value.fix
    assert caught.value.exit_code == 3


def test_a_folder_with_one_recording_is_that_recording(tmp_path: Path) -> None:
    """As `convert --to mcap` leaves it; of several, such as split ones, one has to be named."""
    (tmp_path / "run.json").write_text("{}")
    (tmp_path / "notes.mcap").write_text("no recording")
    (tmp_path / "a_clouds.mcap").write_bytes(b"\x89MCAP0\r\n")
    assert recognise(str(tmp_path)) == Recording(str(tmp_path / "a_clouds.mcap"))
    (tmp_path / "a_images.mcap").write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(SourceUnknown, match=r"2 recordings: a_clouds\.mcap, a_images\.mcap"):
        recognise(str(tmp_path))


def test_absent_names_the_nearest(tmp_path: Path) -> None:
    (tmp_path / "drive_0002").mkdir()
    with pytest.raises(SourceUnknown) as caught:
        recognise(str(tmp_path / "drive_002"))
    assert "drive_0002" in caught.value.fix
    with pytest.raises(SourceUnknown):
        recognise(str(tmp_path / "no" / "where"))


def test_recognising_imports_nothing_heavy() -> None:
    code = (
        "import sys; import pseudolidar.sources.recognise as r; r.recognise('synthetic:street'); "
        "print([m for m in ('cv2', 'open3d', 'numba', 'scipy', 'matplotlib') if m in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
