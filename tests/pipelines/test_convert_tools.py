"""Cloud tools look from where a cloud was seen, whatever frame it is handed over in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.points.cloud_file import read_cloud
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import RecordedCloud
from tests.recordings import START_NS, write_own

# A sensor that has gone far and turned: its origin is nowhere near the map's.
T_MAP_LIDAR = Pose.from_rotation(
    "map", "lidar", np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([120.0, 40.0, 1.7])
)
TREES = {
    "with a body": (
        Pose("map", "base_link", T_MAP_LIDAR.matrix),
        Pose.identity("base_link", "lidar"),
    ),
    "alone": (T_MAP_LIDAR,),
}


@pytest.fixture(scope="module", params=TREES)
def recording(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A level road and a wall beside it, seen from 1.7 m above the road, with a stray."""
    rng = np.random.default_rng(1)
    road = np.column_stack([rng.uniform((2, -6), (30, 6), (6000, 2)), np.full(6000, -1.7)])
    side = rng.uniform((2, -1.7), (30, 3), (4000, 2))
    wall = np.column_stack([side[:, 0], np.full(4000, 6.0), side[:, 1]])
    points = np.concatenate([road, wall, [[9.0, -3.0, 2.5]]]).astype(np.float32)
    points += rng.normal(0, 0.01, points.shape).astype(np.float32)
    cloud = PointCloud(points, "lidar", START_NS, extra={"row": np.arange(len(points))})
    frame = RecordedCloud(cloud, "a", 0, START_NS, TREES[request.param])
    return write_own(tmp_path_factory.mktemp("tools") / "drive.mcap", [frame])


def converted(recording: Path, out: Path, *flags: str) -> PointCloud:
    assert main(["convert", str(recording), str(out), "--to", "npz", *flags]) == 0
    return read_cloud(out / "npz" / "a.npz")


@pytest.mark.parametrize(
    "flags",
    [
        ("--crop", "range:3:10"),
        ("--ground", "remove"),
        ("--outliers", "lonely"),
        ("--beams", "16"),
    ],
)
def test_the_same_points_stay_in_the_sensors_frame_and_in_the_map(
    flags: tuple[str, ...], recording: Path, tmp_path: Path
) -> None:
    own = converted(recording, tmp_path / "own", *flags)
    mapped = converted(recording, tmp_path / "map", "--frame", "map", *flags)
    assert 0 < len(own) <= 10_000
    assert (own.frame, mapped.frame) == ("lidar", "map")
    both = np.isin(own.extra["row"], mapped.extra["row"]).mean()
    assert both > 0.995  # points on the limit may fall to either side by rounding
    assert abs(len(own) - len(mapped)) < 0.005 * len(own) + 1


def test_normals_face_the_sensor_in_the_map_too(recording: Path, tmp_path: Path) -> None:
    cloud = converted(recording, tmp_path / "map", "--frame", "map", "--normals")
    normals = np.stack([cloud.extra[name] for name in ("nx", "ny", "nz")], axis=1)
    towards = T_MAP_LIDAR.translation_m - cloud.xyz
    known = np.isfinite(normals[:, 0])
    assert known.mean() > 0.99
    assert ((normals * towards).sum(axis=1)[known] > 0).all()
    road = cloud.extra["row"] < 6000
    assert np.median(normals[road & known, 2]) > 0.95


def test_a_box_of_the_map_is_exact_far_from_its_origin(recording: Path, tmp_path: Path) -> None:
    box = ("--crop", "box", "--crop.frame", "map", "--crop.x", "114.5:118.5")
    own = converted(recording, tmp_path / "own", *box)
    x = T_MAP_LIDAR.apply(own.xyz.astype(np.float64))[:, 0]
    assert len(own) > 100
    assert x.min() >= 114.5
    assert x.max() <= 118.5


def test_a_box_in_an_unknown_frame_lists_the_sources_own(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    box = ["--crop", "box", "--crop.frame", "mars", "--crop.x", "0:1"]
    assert main(["convert", str(recording), str(out), *box]) == 3
    said = capsys.readouterr().err
    assert "lidar, map" in said
    assert "seen_from" not in said


def test_a_recording_of_a_recording_has_its_name(recording: Path, tmp_path: Path) -> None:
    assert main(["convert", str(recording), str(tmp_path), "--to", "mcap"]) == 0
    assert [path.name for path in tmp_path.glob("*.mcap")] == ["drive.mcap"]
