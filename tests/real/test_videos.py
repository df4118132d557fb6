"""A real drive as lossless video: the cloud on the other side is the same cloud."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipelines.convert import Convert, run
from pseudolidar.formats.points.npz import read_npz
from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.formats.timestamps import write_timestamps
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.selection import FrameSelection
from pseudolidar.structures.cloud import PointCloud
from tests.videos import write_video

FRAMES = FrameSelection.parse("3:5")


def clouds(place: Path, out: Path) -> list[PointCloud]:
    job = Convert(recognise(str(place)), out, Outputs(("npz",)), frames=FRAMES)
    assert run(job).exit_code == 0
    return [read_npz(path) for path in sorted((out / "npz").iterdir())]


@pytest.fixture(scope="module")
def drive(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The drive and a folder with videos of it."""
    place = real_data / "kitti_raw" / "2011_09_26"
    source = KittiRaw(str(place)).open()
    pairs = [source.load(index) for index in range(len(source.ids))]
    folder = tmp_path_factory.mktemp("videos")
    lefts, rights = [pair.left for pair in pairs], [pair.right for pair in pairs]
    both = [np.hstack(eyes) for eyes in zip(lefts, rights, strict=True)]
    write_video(folder / "two" / "left.mkv", lefts, gop=1)
    write_video(folder / "two" / "right.mkv", rights, gop=1)
    write_video(folder / "one" / "drive.mkv", both, gop=4)
    for kind in ("two", "one"):
        write_rig(folder / kind / "rig.json", source.rig)
        write_timestamps(folder / kind / "timestamps.txt", source.timestamps_ns)
    return place, folder


@pytest.mark.real
def test_videos_of_a_drive_give_its_clouds_column_by_column(drive, tmp_path: Path) -> None:
    place, folder = drive
    want = clouds(place, tmp_path / "pictures")
    for kind in ("two", "one"):
        for cloud, same in zip(clouds(folder / kind, tmp_path / kind), want, strict=True):
            assert (cloud.timestamp_ns, cloud.frame) == (same.timestamp_ns, same.frame)
            for name in ("xyz", "rgb", "intensity", "sigma_m", "uv"):
                ours, theirs = getattr(cloud, name), getattr(same, name)
                assert (ours is None) == (theirs is None), name
                if ours is not None:
                    assert np.array_equal(ours, theirs, equal_nan=ours.dtype.kind == "f"), name
