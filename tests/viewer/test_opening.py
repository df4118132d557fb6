"""What paths are that somebody wants to look at."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import PseudolidarError, SourceUnknown
from pseudolidar.formats.points.pcd import write_pcd
from pseudolidar.formats.points.ply import write_ply
from pseudolidar.formats.trajectory import write_kitti_poses
from pseudolidar.formats.tum import write_tum_trajectory
from pseudolidar.sources.cloud_files import CloudFiles
from pseudolidar.sources.recognise import Source
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.opening import Opened, Opening
from pseudolidar.viewer.reel import NoFrames
from pseudolidar.viewer.stills import StillCloud, StillPath, middle_m

POINTS = np.float32([[1, 2, 3], [4, 5, 6], [np.nan, 0, 0]])


def cloud(frame: str = "map"):

    return PointCloud(POINTS, frame)


def poses() -> np.ndarray:
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, 2, 3] = (0, 1, 3)
    return T


def opened(*paths: object) -> tuple[Opened, list[Source]]:
    asked: list[Source] = []

    def reel_of(source: Source) -> NoFrames:
        asked.append(source)
        return NoFrames(str(source))

    return Opening(reel_of).all_of([str(path) for path in paths]), asked


def test_nothing_is_nothing():
    assert opened() == (Opened(), [])


def test_files_of_clouds_and_poses_lie_still(tmp_path: Path):
    write_pcd(tmp_path / "a.pcd", cloud())
    write_ply(tmp_path / "b.ply", cloud("camera_left"))
    write_tum_trajectory(tmp_path / "path.tum", [0, 1, 2], poses())
    write_kitti_poses(tmp_path / "06.txt", poses())
    names = ("a.pcd", "b.ply", "path.tum", "06.txt")
    found, asked = opened(*(tmp_path / name for name in names))
    assert asked == []
    a, b, tum, kitti = found.stills
    assert isinstance(a, StillCloud)
    assert isinstance(b, StillCloud)
    assert len(a.cloud) == 2
    # A camera's axes are turned: ahead is x.
    assert np.allclose(b.cloud.xyz[0], (3, -1, -2))
    assert isinstance(tum, StillPath)
    assert isinstance(kitti, StillPath)
    assert tum.length_m == kitti.length_m == 3
    assert np.allclose(tum.places_m[-1], (0, 0, 3))
    assert np.allclose(kitti.places_m[-1], (3, 0, 0))


def test_a_runs_folder_shows_its_map_and_path(tmp_path: Path):
    (tmp_path / "run.json").write_text("{}")
    write_ply(tmp_path / "map.ply", cloud())
    write_tum_trajectory(tmp_path / "trajectory.tum", [0, 1, 2], poses())
    found, asked = opened(tmp_path)
    assert [still.name for still in found.stills] == ["map.ply", "trajectory.tum"]
    assert asked == []


def test_a_runs_folder_shows_its_clouds_frame_by_frame(tmp_path: Path):
    (tmp_path / "run.json").write_text("{}")
    for folder in ("ply", "pcd"):
        (tmp_path / folder).mkdir()
    write_ply(tmp_path / "ply" / "1.ply", cloud())
    write_pcd(tmp_path / "pcd" / "1.pcd", cloud())
    found, asked = opened(tmp_path)
    assert asked == [CloudFiles(str(tmp_path / "pcd"))]
    assert len(found.reels) == 1


def test_what_leaves_nothing_to_look_at_is_named(tmp_path: Path):
    (tmp_path / "run.json").write_text("{}")
    with pytest.raises(SourceUnknown, match="nothing to look at"):
        opened(tmp_path)
    (tmp_path / "disparity").mkdir()  # maps are no clouds, but tell where they were made of
    frames = NoFrames("the pairs")
    assert Opening(lambda _: NoFrames(), lambda _: frames).all_of([str(tmp_path)]).reels == (
        frames,
    )
    with pytest.raises(SourceUnknown):
        opened(tmp_path / "absent")
    (tmp_path / "cut.pcd").write_bytes(b"VERSION 0.7\nFIELDS x y")
    with pytest.raises(PseudolidarError, match=r"cut\.pcd"):
        opened(tmp_path / "cut.pcd")


def test_places_on_earth_are_kept_in_double(tmp_path: Path):

    utm = np.array([[4.5e5, 5.4e6, 110.0], [4.5e5 + 0.01, 5.4e6 + 0.02, 110.5]])
    still = StillCloud("utm", PointCloud(utm, "map"))
    near = (utm - middle_m(still)).astype(np.float32)
    assert np.allclose(near[1] - near[0], utm[1] - utm[0], atol=1e-6)


def test_a_run_that_found_obstacles_is_opened_with_the_frames_that_it_saw(tmp_path: Path):
    (tmp_path / "run.json").write_text("{}")
    (tmp_path / "obstacles.jsonl").write_bytes(b"")
    with pytest.raises(SourceUnknown, match="the source of the run"):
        opened(tmp_path)
    (tmp_path / "pcd").mkdir()
    write_pcd(tmp_path / "pcd" / "1.pcd", cloud())
    assert opened(tmp_path)[1] == [CloudFiles(str(tmp_path / "pcd"))]
    asked: list[Path] = []

    def reel_of_run(folder: Path) -> NoFrames:
        asked.append(folder)
        return NoFrames("the source")

    found = Opening(lambda _source: NoFrames(), reel_of_run).all_of([str(tmp_path)])
    assert asked == [tmp_path]
    assert [reel.name for reel in found.reels] == ["the source"]
    (tmp_path / "obstacles.jsonl").write_text('{"frame": "1"}\n')
    with pytest.raises(PseudolidarError, match=r"obstacles\.jsonl"):
        opened(tmp_path)
