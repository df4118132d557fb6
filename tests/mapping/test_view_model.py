"""A handful of views of a rendered room, whose cameras are known exactly."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.errors import OverlapInsufficient, SourceEmpty
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.points.ply import read_ply
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.similarity import similarity_of
from pseudolidar.mapping.view_features import ViewFeatures
from pseudolidar.mapping.view_model import ViewModel
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.views import SparseModel

pytest.importorskip("pycolmap", reason="pycolmap is not installed")


@pytest.fixture(scope="module")
def frames() -> list[StereoFrame]:
    source = Synthetic("room", frames=11, width_px=480).open()
    return [source.load(index) for index in (0, 3, 6, 10)]


@pytest.fixture(scope="module")
def model(frames: list[StereoFrame]) -> SparseModel:
    return ViewModel().made(
        {frame.id: frame.left for frame in frames}, {frame.id: frame.rig.left for frame in frames}
    )


def truth(frames: list[StereoFrame]) -> np.ndarray:
    return np.stack(
        [frame.pose.matrix @ left_in_base_link(frame.rig).matrix for frame in frames if frame.pose]
    )


def test_cameras_are_where_they_were(frames: list[StereoFrame], model: SparseModel):
    assert model.names == tuple(frame.id for frame in frames)
    assert model.left_out == ()
    assert model.error_px < 0.5
    true = truth(frames)
    there = similarity_of(model.T_world_camera[:, :3, 3], true[:, :3, 3], scaled=True)
    found = there.poses(model.T_world_camera)
    path_m = np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1).sum()
    assert np.linalg.norm(found[:, :3, 3] - true[:, :3, 3], axis=1).max() < 0.02 * path_m
    # A path that is a straight line leaves a turn about it open: turns against the first are not.
    own, right = (
        np.einsum("ji,njk->nik", T[0, :3, :3], T[:, :3, :3]) for T in (model.T_world_camera, true)
    )
    turned = np.einsum("nji,njk->nik", own, right)
    angles = np.degrees(np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    assert angles.max() < 0.5


def test_the_world_begins_at_the_first_picture_with_x_ahead(model: SparseModel):
    assert np.allclose(model.T_world_camera[0][:3, 3], 0)
    assert np.allclose(model.T_world_camera[0][:3, 2], (1, 0, 0))
    assert (model.points.xyz[:, 0] > 0).mean() > 0.98
    assert model.views.min() >= 2


def test_a_known_distance_makes_metres(frames: list[StereoFrame], model: SparseModel):
    first, last = frames[0].id, frames[-1].id
    true = truth(frames)
    apart_m = float(np.linalg.norm(true[-1][:3, 3] - true[0][:3, 3]))
    scaled = model.times(apart_m / model.distance(first, last))
    assert scaled.scaled
    assert not model.scaled
    step_m = float(np.linalg.norm(true[1][:3, 3] - true[0][:3, 3]))
    assert scaled.distance(first, frames[1].id) == pytest.approx(step_m, rel=0.03)
    assert len(scaled.points) == len(model.points)


def test_the_same_pictures_give_the_same_model(frames: list[StereoFrame], model: SparseModel):
    again = ViewModel().made(
        {frame.id: frame.left for frame in frames}, {frame.id: frame.rig.left for frame in frames}
    )
    assert np.array_equal(again.T_world_camera, model.T_world_camera)
    assert len(again.points) == len(model.points)


def test_pictures_that_share_nothing_are_said_to(frames: list[StereoFrame]):
    rng = np.random.default_rng(0)
    noise = {name: rng.integers(0, 255, (120, 160, 3)).astype(np.uint8) for name in "ab"}
    with pytest.raises(OverlapInsufficient, match="2 pictures"):
        ViewModel(ViewFeatures("orb")).made(noise, None)
    with pytest.raises(SourceEmpty):
        ViewModel().made({"a": noise["a"]}, None)
    plain = {name: np.full((64, 64), 90, np.uint8) for name in "ab"}
    with pytest.raises(OverlapInsufficient):
        ViewModel().made(plain, None)


def test_pairs_are_metres_and_dense(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    world = ["synthetic:room:7", str(tmp_path / "out")]
    assert main(["reconstruct", *world, "--frames", "0::6", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["metres"]
    assert told["placed"] == [f"{name} {eye}" for name in ("000000", "000006") for eye in EYES]
    dense = read_ply(tmp_path / "out" / "dense.ply")
    assert len(dense) == told["dense_points"] > 10_000
    cameras = json.loads((tmp_path / "out" / "cameras.json").read_text())["cameras"]
    left, right = (np.array(camera["T_world_camera"])[:3, 3] for camera in cameras[:2])
    baseline_m = Synthetic("room", frames=1).open().load(0).rig.baseline_m
    assert np.linalg.norm(left - right) == pytest.approx(baseline_m, rel=0.02)
    assert "<h2>Where they were taken</h2>" in (tmp_path / "out" / "report.html").read_text()
    assert main(["reconstruct", *world]) == 2  # nothing is written over unasked


EYES = ("left", "right")


def test_a_folder_with_a_bad_picture(frames: list[StereoFrame], tmp_path: Path, capsys):
    for frame in frames:
        (tmp_path / f"{frame.id}.png").write_bytes(encode_png(frame.left))
    (tmp_path / "broken.png").write_bytes(b"\x89PNG\r\n\x1a\n and no more")
    rig = {
        "schema": 1, "width_px": frames[0].size_px[0], "height_px": frames[0].size_px[1],
        "baseline_m": 1.0,
    }  # fmt: skip
    K = frames[0].rig.left.K
    eye = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
    (tmp_path / "rig.json").write_text(json.dumps({**rig, "left": eye, "right": eye}))
    args = [
        "reconstruct",
        str(tmp_path),
        str(tmp_path / "out"),
        "--rig",
        str(tmp_path / "rig.json"),
    ]
    assert main(args) == 4  # one cannot be read
    said = capsys.readouterr().out
    assert "4 of 4 pictures placed" in said
    assert "broken.png" in said
    assert "have no unit" in said
    assert main([*args, "--overwrite", "--distance", "x.png,y.png=1"]) == 2
