"""The film of obstacles: what a frame commits, and what is drawn into it."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import OutputError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.products.obstacle_film import ObstacleArtist, read_picture
from pseudolidar.running.products.preview import Scales
from pseudolidar.running.sighting import Seen
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DepthMap, DisparityMap
from pseudolidar.structures.frame import StereoFrame
from tests.formats.made_obstacles import car, light
from tests.formats.mcap.test_messages import bare_frame
from tests.obstacles.scene import CAMERA, HEIGHT, WIDTH, sight


@pytest.fixture(scope="module")
def seen() -> Seen:
    """A street with a car, as it comes from two eyes."""
    view = sight([("Car", -2.0, 18.0, 1.8, 1.5)])
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    z = view.depth.values.ravel()
    x = (u.ravel() - CAMERA.K[0, 2]) * z / CAMERA.K[0, 0]
    y = (v.ravel() - CAMERA.K[1, 2]) * z / CAMERA.K[1, 1]
    xyz = np.stack([x, y, z], axis=1).astype(np.float32)
    cloud = PointCloud(xyz, "camera_left", shape=(HEIGHT, WIDTH))
    return Seen(view, cloud, DisparityMap((200.0 / view.depth.values).astype(np.float32)))


@pytest.fixture(scope="module")
def frame() -> StereoFrame:
    grey = np.full((HEIGHT, WIDTH), 120, np.uint8)
    rig = replace(bare_frame().rig, left=CAMERA, right=replace(CAMERA, frame="camera_right"))
    return StereoFrame(grey, grey, rig, "000001", 1, 10**18)


def committed(folder, frame, seen) -> None:
    artist = pickle.loads(pickle.dumps(ObstacleArtist(Scales(ahead_m=60.0))))
    for file in artist.files(frame, seen):
        write_atomic(folder / file.name, file.data)


def test_obstacles_are_drawn_into_what_a_frame_has_committed(tmp_path, frame, seen) -> None:
    committed(tmp_path, frame, seen)
    before = {path: path.read_bytes() for path in tmp_path.rglob("0*")}
    assert {path.name for path in before} == {"000001.jpg", "000001.json"}
    empty = read_picture(tmp_path, "000001", (), time_s=0.5)
    full = read_picture(tmp_path, "000001", (car(), light()), time_s=0.5)
    assert empty.shape == full.shape
    assert (empty != full).any(axis=2).mean() > 0.002
    committed(tmp_path, frame, seen)
    assert before == {path: path.read_bytes() for path in tmp_path.rglob("0*")}
    assert (read_picture(tmp_path, "000001", (car(), light()), time_s=0.5) == full).all()


def test_a_frame_without_disparity_shows_its_depth(tmp_path, frame, seen) -> None:
    depth = DepthMap(np.where(seen.sight.is_ground, seen.sight.depth.values, np.nan))
    alone = replace(seen, disparity=None, sight=replace(seen.sight, depth=depth))
    committed(tmp_path, frame, alone)
    assert read_picture(tmp_path, "000001", (), time_s=0.0).ndim == 3


def test_files_that_somebody_changed_are_named(tmp_path, frame, seen) -> None:
    committed(tmp_path, frame, seen)
    path = next(tmp_path.rglob("*.json"))
    for broken in ("{", "[]", json.dumps({"photo_px": [1], "K": 3})):
        path.write_text(broken)
        with pytest.raises(OutputError) as raised:
            read_picture(tmp_path, "000001", (), time_s=0.0)
        assert raised.value.path == str(path)
