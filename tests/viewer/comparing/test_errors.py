"""What the panel tells of two clouds: the figures of `compare`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pseudolidar.pipelines.view import View as ViewJob

from pseudolidar.cli import main
from pseudolidar.evaluation.cloud_distances import CloudDistances
from pseudolidar.evaluation.comparison.bins import DepthBins
from pseudolidar.formats.points.pcd import write_pcd
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.comparing.errors import AROUND_M, RangeRow, errors_by_range, evidence
from pseudolidar.viewer.comparing.pool import Pool, choices
from pseudolidar.viewer.comparing.range_plot import told
from pseudolidar.viewer.moment import STEREO, VELODYNE, Moment

BINS = DepthBins((5, 10, 20))


def clouds() -> tuple[PointCloud, PointCloud]:
    rng = np.random.default_rng(3)
    own = rng.uniform((4, -6, -1), (18, 6, 2), (2000, 3)).astype(np.float32)
    other = own[rng.permutation(2000)[:1500]] + rng.normal(0, 0.05, (1500, 3)).astype(np.float32)
    return PointCloud(own, "velodyne"), PointCloud(other, "velodyne")


def test_clouds_have_the_figures_of_compare(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    names = ("ours", "theirs")
    for name, cloud in zip(names, clouds(), strict=True):
        (tmp_path / name).mkdir()
        write_pcd(tmp_path / name / "000000.pcd", cloud)
    capsys.readouterr()
    places = [str(tmp_path / name) for name in names]
    assert main(["compare", *places, "--bins", str(BINS), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    moment = Moment("000000", 0, clouds=dict(zip(names, clouds(), strict=True)))
    found = evidence(moment, {}, *names)
    assert found is not None
    shown = errors_by_range(*names, [found], BINS)
    assert shown is not None
    assert shown.way == "distance"
    for row, told_ in zip((shown.overall, *shown.rows), (figures, *figures["bins"]), strict=True):
        assert row.n == told_["n"]
        assert row.median == pytest.approx(told_["accuracy_median_m"], rel=1e-6)
        assert row.p90 == pytest.approx(told_["accuracy_p90_m"], rel=1e-6)
        assert row.covered == pytest.approx(told_["recall_0_2"], rel=1e-6)
        assert row.bias is None


def test_depths_have_the_figures_of_compare(capsys: pytest.CaptureFixture[str]):
    size = ["--source.frames", "1", "--source.width-px", "256"]
    assert main(["compare", "synthetic:street", *size, "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["reference"] == "LiDAR scans"
    job = ViewJob()
    pool = Pool(STEREO, VELODYNE)
    pool.add(job.reel_of(Synthetic("street", frames=1, width_px=256)).load(0), {})
    (shown,) = pool.told()
    assert (shown.way, shown.frames) == ("depth", 1)
    for row, told_ in zip((shown.overall, *shown.rows), (figures, *figures["bins"]), strict=True):
        names = ("n", "median_rel", "p90_rel", "bias_rel", "density")
        said = (row.n, row.median, row.p90, row.bias, row.covered)
        assert said == tuple(told_[name] for name in names)


def test_of_many_frames_some_points_are_kept(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("pseudolidar.viewer.comparing.pool.MOST_POINTS", 1000)
    names = ("ours", "theirs")
    moment = Moment("000000", 0, clouds=dict(zip(names, clouds(), strict=True)))
    pool = Pool(*names, frames=2)
    for _ in range(2):
        pool.add(moment, {})
    for frame in pool._found["ours"]:
        assert isinstance(frame, CloudDistances)
        assert 400 < len(frame.accuracy_m) <= 500
        assert 300 < len(frame.completeness_m) <= 500
    (shown,) = pool.told()
    assert shown.overall.median == pytest.approx(0.08, abs=0.02)


def test_a_map_is_seen_as_far_as_the_rig_sees():
    own, _ = clouds()
    ends = np.full((200, 3), (AROUND_M, 0, 0), np.float32)
    ends[::2, 0], ends[1::2, 0] = AROUND_M - 1, AROUND_M + 1
    xyz = np.concatenate([own.xyz, ends])
    moment = Moment("a", 0, clouds={"points": own}, T_map_forward=np.eye(4))
    found = evidence(moment, {"map.ply": PointCloud(xyz, "map")}, "map.ply", "map.ply")
    assert isinstance(found, CloudDistances)
    assert found.estimate_range_m.max() == pytest.approx(AROUND_M - 1)


def test_a_map_is_seen_from_the_rig():
    own, _ = clouds()
    T = np.eye(4)
    T[:3, 3] = (4.5e5, 5.4e6, 100)
    T[:2, :2] = [[0, -1], [1, 0]]
    placed = replace(own, xyz=own.xyz.astype(float) @ T[:3, :3].T + T[:3, 3], frame="map")
    moment = Moment("a", 0, clouds={"points": own}, T_map_forward=T)
    pool = Pool("points", "map.ply")
    pool.add(moment, {"map.ply": placed})
    (shown,) = pool.told()
    assert shown.overall.p90 == pytest.approx(0, abs=1e-3)
    assert shown.overall.covered == 1


def test_what_is_not_there_is_not_compared():
    own, _ = clouds()
    pool = Pool("points", "gone")
    pool.add(Moment("a", 0, clouds={"points": own}), {})
    pool.add(Moment("b", 1, fault="cannot be read"), {})
    assert pool.told() == ()
    assert pool.faults == ["b: cannot be read"]
    assert choices(Moment("a", 0, clouds={"points": own}), {"m.ply": own}) == (
        ("points", "m.ply"),
        ("points", "m.ply"),
    )


def test_an_empty_cloud_has_no_figures():
    own, _ = clouds()
    moment = Moment("a", 0, clouds={"points": own, "none": own[:0]})
    pool = Pool("points", "none")
    pool.add(moment, {})
    (shown,) = pool.told()
    assert shown.overall == RangeRow(5, 80, 0, None, None, None, None)
    assert "-" in told([shown])


def test_what_is_told_is_no_markup():
    own, _ = clouds()
    name = "<script>alert(1)</script>"
    pool = Pool(name, "b")
    pool.add(Moment("a", 0, clouds={name: own, "b": own}), {})
    page = told(pool.told())
    assert "<script" not in page
    assert page.count("<svg") == 2  # distances have no sign
