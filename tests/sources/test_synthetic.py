import hashlib
import pickle
import subprocess
import sys
import threading
from collections.abc import Iterable

import numpy as np
import pytest

from pseudolidar.errors import SourceUnknown, UsageError
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.frame import StereoFrame

SMALL = 320
WORLDS = ("street", "room", "flight")


def small(world: str, **options: object) -> Synthetic:
    return Synthetic(world, width_px=SMALL, **options)


def digest(frame: StereoFrame) -> str:
    parts = (frame.left, frame.right, frame.truth.values, frame.scan.xyz, frame.scan.reflectance)
    content = hashlib.sha256(b"".join(part.tobytes() for part in parts))
    content.update(frame.pose.matrix.tobytes())
    for label in frame.labels:
        content.update(repr((label.track_id, label.detection.box_px, label.occlusion)).encode())
        content.update(label.box.pose.matrix.tobytes())
    return content.hexdigest()


@pytest.fixture(scope="module", params=WORLDS)
def frame(request: pytest.FixtureRequest) -> StereoFrame:
    return small(request.param).open().load(3)


def test_opening_says_what_it_is() -> None:
    source = small("synthetic:street", frames=3, seed=5).open()
    assert source.summary.kind == "synthetic"
    assert "street" in source.summary.line
    assert "seed 5" in source.summary.line
    assert any(note.startswith("time: synthetic") for note in source.summary.notes)
    assert source.ids == ("000000", "000001", "000002")
    assert source.timestamps_ns == (1_000_000_000, 1_100_000_000, 1_200_000_000)
    assert source.refused == ()


def test_street_has_kittis_cameras_at_full_size() -> None:
    rig = Synthetic("street").open().rig
    assert rig.left.size_px == (1242, 375)
    assert rig.left.focal_px == pytest.approx(721.5377)
    assert rig.baseline_m == pytest.approx(0.54)
    assert rig.is_rectified


@pytest.mark.parametrize(
    ("settings", "error", "said"),
    [
        (Synthetic("moon"), SourceUnknown, "moon"),
        (Synthetic("street", frames=0), UsageError, "0 frames"),
        (Synthetic("street", rate_hz=0.0), UsageError, "0 Hz"),
        (Synthetic("street", width_px=20), UsageError, "20x6"),
    ],
)
def test_impossible_settings_are_named(settings, error, said) -> None:
    with pytest.raises(error, match=said):
        settings.open()


def test_frames_are_whole(frame: StereoFrame) -> None:
    assert frame.left.dtype == np.uint8
    assert frame.left.shape == frame.right.shape
    assert frame.left.shape[1] == SMALL
    assert frame.id == "000003"
    assert frame.timestamp_ns == 1_300_000_000
    assert len(frame.scan) > 5000
    assert frame.pose.dst == "map"
    assert frame.pose.src == "base_link"
    assert 20 < frame.left.std() < 90
    assert 60 < frame.left.mean() < 190


def test_left_and_right_differ_and_so_do_frames_and_seeds() -> None:
    first = small("street").open().load(0)
    assert digest(first) != digest(small("street").open().load(1))
    assert digest(first) != digest(small("street", seed=1).open().load(0))
    assert not np.array_equal(first.left, first.right)


@pytest.mark.parametrize("world", WORLDS)
def test_a_frame_is_a_pure_function_of_its_index(world: str) -> None:
    source = Synthetic(world, width_px=SMALL // 2, frames=400).open()
    code = (
        "import pickle, sys; from tests.sources.test_synthetic import digest;"
        "source = pickle.load(sys.stdin.buffer);"
        "print(digest(source.load(301)), digest(source.load(2)))"
    )
    child = subprocess.run(
        [sys.executable, "-c", code], input=pickle.dumps(source), capture_output=True, check=True
    )
    # Here another frame comes first, and threads ask at once.
    source.load(2)
    found: dict[int, str] = {}
    threads = [
        threading.Thread(target=lambda i=i: found.__setitem__(i, digest(source.load(i))))
        for i in (2, 301)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert child.stdout.decode().split() == [found[301], found[2]]


def test_pose_starts_at_the_map_and_moves_at_the_worlds_speed() -> None:
    source = small("street", frames=200).open()
    np.testing.assert_array_equal(source.pose(0).matrix, np.eye(4))
    poses = source.trajectory.T_world_body
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert steps.mean() == pytest.approx(0.8, abs=0.05)
    assert steps.max() < 1.0
    assert np.all(poses[1:, 0, 3] > poses[:-1, 0, 3])


def test_endless_street_goes_on_far_away() -> None:
    source = small("street", frames=1_000_000).open()
    far = source.load(100_000)  # 80 km down the road
    assert far.left.std() > 20
    assert np.isfinite(far.truth.values).mean() > 0.6


def test_flight_climbs_and_yaws_over_the_ground() -> None:
    matrices = small("flight", frames=200).open().trajectory.T_world_body
    assert np.ptp(matrices[:, 2, 3]) > 3.0
    yaw = np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0])
    assert np.ptp(yaw) > 0.3


@pytest.mark.parametrize(("world", "frames"), [("room", range(0, 620, 31)), ("flight", (0, 180))])
def test_the_camera_keeps_clear_of_things(world: str, frames: Iterable[int]) -> None:
    source = Synthetic(world, frames=1000, width_px=80).open()
    for index in frames:
        assert np.nanmin(source.truth_pair(index).depth_left.values) > 0.3
