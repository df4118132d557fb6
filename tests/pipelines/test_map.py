"""`pseudolidar map` as a user runs it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import av
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from scipy.spatial import cKDTree

from pseudolidar.cli import main
from pseudolidar.formats.map_server import read_map_server
from pseudolidar.formats.meshes.mesh_file import read_mesh
from pseudolidar.formats.points.npz import read_npz
from pseudolidar.formats.points.ply import read_ply
from pseudolidar.formats.trajectory import read_kitti_poses
from pseudolidar.formats.tum import read_tum_trajectory
from pseudolidar.running.mapped import checkpoints
from pseudolidar.running.mapped.frame_table import FRAME_TABLE
from pseudolidar.running.mapped.walk import Walk

# Small pictures that still hold some hundred tracks.
WORLD = ["synthetic:street", "--source.frames", "5", "--source.width-px", "480"]
MADE = [
    *("--to", "ply,mcap", "--frame-clouds", "npz", "--debug-video", "--map.points.sigma", "0.3"),
    *("--mesh", "--mesh-to", "ply,glb", "--occupancy"),
]


def run_map(out: Path, *more: str) -> int:
    return main(["map", *WORLD, str(out), *more])


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("mapped")
    assert run_map(out, *MADE, "--keep-work") == 0
    return out


def test_the_path_is_where_the_world_says(mapped: Path, capsys: pytest.CaptureFixture[str]):
    assert run_map(mapped, *MADE, "--keep-work", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    path = told["trajectory"]
    assert path["frames"] == 5
    assert path["end_error_rel"] < 0.006
    assert path["t_rel"] < 0.006
    assert path["lost"] == []
    assert told["map"]["points"] > 2000
    assert told["map"]["mesh"]["triangles"] > 2000
    assert told["map"]["mesh"]["holes"] > 0
    assert told["map"]["occupancy"]["free"] > 100
    assert told["seconds_per_frame"] > 0


def test_files_of_the_path_agree(mapped: Path):
    times, bodies = read_tum_trajectory(mapped / "trajectory.tum")
    cameras = read_kitti_poses(mapped / "trajectory_kitti.txt")
    assert len(times) == len(bodies) == len(cameras) == 5
    assert np.allclose(bodies[0], np.eye(4))
    # x of the body is z of the camera.
    assert bodies[-1][0, 3] == pytest.approx(cameras[-1][2, 3], abs=0.02)
    assert bodies[-1][0, 3] > 1.0


def test_points_of_the_map_have_what_is_known_of_them(mapped: Path):
    cloud = read_ply(mapped / "map.ply")
    assert cloud.frame == "map"
    assert set(cloud.extra) == {"nx", "ny", "nz", "views"}
    assert cloud.extra["views"].min() >= 2
    assert np.isfinite(cloud.sigma_m).all()
    length = np.linalg.norm([cloud.extra[name] for name in ("nx", "ny", "nz")], axis=0)
    assert np.allclose(length, 1, atol=1e-3)
    tiles = [read_ply(tile) for tile in sorted((mapped / "tiles").glob("*.ply"))]
    assert sum(map(len, tiles)) == len(cloud)
    # The road lies below the camera, and its normals point up.
    road = np.abs(cloud.xyz[:, 2] - np.quantile(cloud.xyz[:, 2], 0.1)) < 0.1
    assert np.median(cloud.extra["nz"][road]) > 0.95


def test_the_page_shows_the_path_and_the_map(mapped: Path):
    page = (mapped / "report.html").read_text()
    doubts = ("Is it as sure as it says?", "What the motion told of the rig")
    for heading in ("The map", "Where a robot can go", "The path", "Drift", *doubts):
        assert f"<h2>{heading}</h2>" in page
    assert page.count("<img") >= 9
    assert "positions hold the turn about a path that is nearly straight" in page


def test_the_recording_has_the_way_and_what_came_into_view(mapped: Path):
    with (mapped / "street.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        read = [(c.topic, m) for _, c, _, m in reader.iter_decoded_messages()]
    found = {topic: [m for t, m in read if t == topic] for topic, _ in read}
    _, bodies = read_tum_trajectory(mapped / "trajectory.tum")
    places = [(p.pose.position.x, p.pose.position.y) for p in found["/pose"]]
    assert np.allclose(places, bodies[:, :2, 3], atol=1e-9)
    assert [len(path.poses) for path in found["/path"]] == [1, 2, 3, 4, 5]
    sizes = [len(m.data) // m.point_stride for m in found["/map/points"]]
    assert sizes == sorted(sizes)
    assert sizes[-1] == len(read_ply(mapped / "map.ply"))
    assert len(found["/stereo/points"]) == 5


def test_clouds_of_frames_lie_on_the_map(mapped: Path):
    whole = read_ply(mapped / "map.ply")
    clouds = [read_npz(file) for file in sorted((mapped / "frames").iterdir())]
    assert [cloud.frame for cloud in clouds] == ["map"] * len(clouds)
    apart, _ = cKDTree(whole.xyz).query(clouds[-1].xyz[::50])
    assert np.median(apart) < 0.1


def test_the_mesh_lies_on_the_points(mapped: Path):
    meshes = [read_mesh(mapped / name) for name in ("mesh.ply", "mesh.glb")]
    assert len(meshes[0]) == len(meshes[1])
    seen = np.concatenate([read_npz(file).xyz for file in (mapped / "frames").iterdir()])
    apart, _ = cKDTree(seen).query(meshes[0].vertices)
    assert np.median(apart) < 0.5  # the largest sigma of its pixels


def test_the_film_shows_every_frame(mapped: Path):
    with av.open(str(mapped / "odometry.mp4")) as film:
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(pictures) == 5
    # Points that agree are blue; the first frame has none.
    blue = [(p[20:140].astype(int) @ (-1, 0, 1) > 80).sum() for p in pictures]
    assert blue[0] == 0
    assert min(blue[1:]) > 100


def test_a_dry_run_tells_and_writes_nothing(
    mapped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    asked = ("--to", "ply", "--frame-clouds", "npz", "--map.points.sigma", "0.3")
    assert run_map(tmp_path / "out", *asked, "--debug-video", "--dry-run", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["frames"] == 5
    # All frames were tried: of what is estimated every byte is known.
    made = [mapped / "map.ply", *mapped.glob("tiles/*"), *mapped.glob("frames/*")]
    assert told["map_bytes"] == sum(file.stat().st_size for file in made)
    kept = [*mapped.glob(".work/*.disparity"), mapped / ".work" / "free_space"]
    assert told["work_bytes"] == pytest.approx(sum(file.stat().st_size for file in kept), abs=5)
    assert told["bytes"] == told["work_bytes"] + told["map_bytes"]
    assert {"report.html", "odometry.mp4"} < set(told["not_estimated"])
    assert not (tmp_path / "out").exists()


def test_a_killed_run_goes_on_and_ends_with_the_same_bytes(
    mapped: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """From the last checkpoint on; the other run has made none."""
    program = f"import sys, {checkpoints.__name__} as own; own.EVERY = 2; "
    program += "from pseudolidar.cli import main; main(sys.argv[1:])"
    command = [sys.executable, "-c", program, "map", *WORLD, str(tmp_path), *MADE]
    child = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    end = time.monotonic() + 60
    while not (tmp_path / checkpoints.CHECKPOINT_FILE).exists():
        assert time.monotonic() < end
        assert child.poll() is None
        time.sleep(0.01)
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    work = tmp_path / ".work"
    done = {file: file.stat().st_mtime_ns for file in work.glob("*.disparity")}
    drawn = {file: file.stat().st_mtime_ns for file in sorted(work.glob("*.tracks.jpg"))[:2]}
    monkeypatch.setattr(checkpoints, "EVERY", 2)
    assert main(["map", *WORLD, str(tmp_path), *MADE, "--keep-work"]) == 0
    # The last may have been written and not yet noted: then it is matched again.
    again = [file for file, before in done.items() if file.stat().st_mtime_ns != before]
    assert len(again) <= 1 < len(done)
    assert {file: file.stat().st_mtime_ns for file in drawn} == drawn
    names = ["trajectory.tum", "trajectory_kitti.txt", "map.ply", "street.mcap", "odometry.mp4"]
    names += ["mesh.ply", "mesh.glb", "occupancy.ply", "grid.yaml", "grid.pgm", "distances.npz"]
    names += [str(cloud.relative_to(mapped)) for cloud in (mapped / "frames").iterdir()]
    names += [str(tile.relative_to(mapped)) for tile in (mapped / "tiles").iterdir()]
    for name in names:
        assert (mapped / name).read_bytes() == (tmp_path / name).read_bytes(), name


def test_the_path_alone(tmp_path: Path):
    assert run_map(tmp_path, "--to", "none", "--odometry", "vision", "--frames", "0:3") == 0
    assert not list(tmp_path.glob("map.*"))
    assert not (tmp_path / ".work").exists()
    assert len(read_tum_trajectory(tmp_path / "trajectory.tum")[0]) == 3


def test_a_run_that_is_done_says_so_and_tells_its_figures_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    some = ("--odometry", "vision", "--frames", "0:3", "--to", "none", "--frame-clouds", "npz")
    assert run_map(tmp_path, *some) == 0
    first = capsys.readouterr().out.splitlines()
    before = (tmp_path / FRAME_TABLE).stat().st_mtime_ns
    with monkeypatch.context() as unwalked:
        unwalked.setattr(Walk, "step", None)
        assert run_map(tmp_path, *some) == 0
        again = capsys.readouterr().out.splitlines()
        assert again[1:] == first[1:]
        assert "already complete" in again[0]
        assert run_map(tmp_path, *some, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["trajectory"]["frames"] == 3
    assert [Path(name).name for name in told["files"]][-1] == "report.html"
    assert (tmp_path / FRAME_TABLE).stat().st_mtime_ns == before
    assert not (tmp_path / ".work").exists()
    # A file that is torn is made again, one in a folder too.
    cloud = next((tmp_path / "frames").iterdir())
    whole = cloud.read_bytes()
    cloud.write_bytes(whole[:-9])
    assert run_map(tmp_path, *some) == 0
    assert cloud.read_bytes() == whole
    # And what is wanted otherwise than before, though its file has the same name.
    with monkeypatch.context() as unwalked:
        unwalked.setattr(Walk, "step", None)
        assert run_map(tmp_path, *some, "--map.mesh.voxel-m", "0.2") == 1


def test_other_outputs_of_what_was_matched(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    some = ("--odometry", "vision", "--frames", "0:3", "--keep-work")
    some += ("--map.points.sigma", "0.3", "--map.points.frames", "2")
    assert run_map(tmp_path, *some) == 0
    stored = {file: file.stat().st_mtime_ns for file in tmp_path.glob(".work/*.disparity")}
    path = (tmp_path / "trajectory.tum").read_bytes()
    robots = ("--to", "none", "--occupancy", "--map.occupancy.cell-m", "0.4")
    assert run_map(tmp_path, *some, *robots) == 0
    assert len(stored) == 3
    assert {file: file.stat().st_mtime_ns for file in stored} == stored
    assert (tmp_path / "trajectory.tum").read_bytes() == path
    assert read_map_server(tmp_path / "grid.yaml").resolution_m == pytest.approx(0.4)
    with np.load(tmp_path / "distances.npz") as distances:
        assert distances["resolution_m"] == pytest.approx(0.4)
    capsys.readouterr()
    assert run_map(tmp_path, *some, "--map.tiles.voxel", "0.1") == 2
    assert "voxel" in capsys.readouterr().err
    assert run_map(tmp_path, "--map.occupancy.cell-m", "0.25") == 2
    assert "whole number of voxels" in capsys.readouterr().err


def test_formats_that_are_none_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert run_map(tmp_path, "--to", "obj") == 2
    assert "ply, pcd, npz, bin" in capsys.readouterr().err
    assert run_map(tmp_path, "--frame-clouds", "mcap") == 2
    assert "--frame-clouds" in capsys.readouterr().err
