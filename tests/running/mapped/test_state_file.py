"""States of odometry as bytes, and bytes that are none."""

import pickle
from array import array
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pseudolidar.geometry.twists import exp_twist
from pseudolidar.mapping.kiss_library import load_kiss
from pseudolidar.mapping.loops import LoopFinder
from pseudolidar.mapping.odometry import Fused, Kiss, Vision
from pseudolidar.mapping.place_store import PlaceFile
from pseudolidar.mapping.visual_odometry import VisualOdometry
from pseudolidar.running.mapped.state_file import decode_state, encode_state
from pseudolidar.running.mapped.walk import Walk
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.box import Detection
from pseudolidar.structures.disparity import DisparityMap


@dataclass
class Harmful:
    """Runs something when it is read."""

    file: Path

    def __reduce__(self):
        return Path.touch, (self.file,)


def test_what_is_no_data_is_not_read(tmp_path: Path):
    data = pickle.dumps(Harmful(tmp_path / "harmed"))
    with pytest.raises(ValueError, match="no data"):
        decode_state(data, {})
    assert not (tmp_path / "harmed").exists()
    # A class that opens files is none, though its package holds data.
    with pytest.raises(ValueError, match="no data"):
        decode_state(pickle.dumps(PlaceFile), {})
    with pytest.raises(ValueError, match="EOFError"):
        decode_state(encode_state([1, 2, 3], {})[:-2], {})


@pytest.mark.parametrize(
    "begins",
    [
        b"cpseudolidar.running.mapped.walk\nWalk\n",
        b"cpseudolidar.mapping.kiss_library\nmap_with\n",
        b"X\x06\x00\x00\x00placesQ",
    ],
    ids=["class", "function", "outside"],
)
@pytest.mark.parametrize("state", [b"N}X\x05\x00\x00\x00whole\x88s\x86b.", b"}b."])
def test_attributes_of_what_was_there_before_are_not_set(begins: bytes, state: bytes):
    with pytest.raises(ValueError, match="no data"):
        decode_state(b"\x80\x04" + begins + state, {"places": SimpleNamespace()})
    assert isinstance(Walk.whole, property)


def test_what_was_one_stays_one_and_what_is_outside_is_put_in():
    picture, outside = np.arange(6.0), {"file": object()}
    state = {"keyframe": picture, "last": picture, "file": outside["file"]}
    state |= {"recent": deque([1]), "words": {3: array("i", [7])}}
    again = decode_state(encode_state(state, outside), outside)
    assert again["keyframe"] is again["last"]
    assert again["file"] is outside["file"]
    assert np.array_equal(again["last"], picture)
    assert (again["recent"], again["words"]) == (state["recent"], state["words"])


def test_the_map_and_the_threshold_come_back():
    kiss = load_kiss(voxel_m=0.5, farthest_m=40.0, threshold_m=0.15)
    voxels, threshold = kiss.voxel_map(), kiss.threshold()
    rng = np.random.default_rng(0)
    for _ in range(3):
        T = np.eye(4)
        T[:3, 3] = rng.normal(0, 5, 3)
        voxels.update(rng.uniform(-20, 20, (4000, 3)), T)
        threshold.update_model_deviation(T)
    again, learnt = decode_state(encode_state((voxels, threshold), {}), {})
    assert learnt.get_threshold() == threshold.get_threshold() > 0.15
    points = [one.point_cloud() for one in (voxels, again)]
    assert len(points[0]) > 5000
    assert np.array_equal(*(one[np.lexsort(one.T)] for one in points))


def test_a_threshold_keeps_what_it_learnt_from_alone():
    threshold = load_kiss(voxel_m=0.5, farthest_m=40.0, threshold_m=0.15).threshold()
    rng, sizes, told = np.random.default_rng(1), [], []
    for step_m in (0.5, 0.05, 0.01):  # from 0.1 m on they count
        for _ in range(100):
            T = exp_twist(np.append(step_m * rng.normal(size=3), 1e-5 * rng.normal(size=3)))
            threshold.update_model_deviation(T)
            told.append(threshold.get_threshold())
        sizes.append(len(encode_state(threshold, {})))
    again = decode_state(encode_state(threshold, {}), {})
    assert again.get_threshold() == threshold.get_threshold()
    assert encode_state(again, {}) == encode_state(threshold, {})
    assert 100 > len(set(told[100:200])) > 10  # some do
    assert sizes[1] - sizes[0] < 0.6 * sizes[0]
    assert sizes[2] == sizes[1]


def test_where_a_path_ended_comes_back(street):
    rig, frames = street
    walk = Walk(Vision(VisualOdometry(reach=1)).start(rig), rig)
    for index, frame in enumerate(frames[:4]):
        nothing = DisparityMap(np.full_like(frame.truth.values, np.nan))
        walk.step(frame, nothing if index in (1, 2) else frame.truth, [])
    again = decode_state(encode_state(walk, {}), {})
    assert [one.status for one in again.placed] == ["first", "lost", "lost", "first"]
    ended = again.placed[2].ended
    assert ended.as_dict() == walk.placed[2].ended.as_dict()
    assert ended.where == f"frame {frames[0].id}"


@pytest.fixture(scope="module")
def street():
    source = Synthetic("street", frames=6, width_px=320, height_px=128).open()
    return source.rig, [source.load(index) for index in range(6)]


@pytest.mark.parametrize("odometry", [Vision(), Kiss(), Fused()], ids=["vision", "kiss", "fused"])
def test_a_walk_goes_on_as_if_it_had_never_stopped(odometry, street):
    rig, frames = street
    file = PlaceFile()
    loops = LoopFinder(apart_m=1.0, similarity=0.0).start(rig, file)
    walk = Walk(odometry.start(rig), rig, loops)
    car = Detection("car", (0.0, 0.0, 20.0, 20.0), mask=np.zeros((128, 320), np.bool_))
    for index, frame in enumerate(frames):
        walk.step(frame, frame.truth, [car])
        if index == 3:
            data = encode_state(walk, {"places": file})
            walk = decode_state(data, {"places": file})
            again = decode_state(data, {"places": file})
        elif index > 3:
            again.step(frame, frame.truth, [car])
    one, other = (side.walked().pieces[0] for side in (walk, again))
    assert len(one.frames) == 6
    assert np.array_equal(one.T_odom_camera, other.T_odom_camera)
    assert [frame.inliers for frame in one.frames] == [frame.inliers for frame in other.frames]
