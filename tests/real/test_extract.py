"""KITTI's unrectified drive: rows within 0.3 px after the correction, and Velodyne's metres."""

from __future__ import annotations

import json

import pytest

from pseudolidar.cli import main

pytestmark = pytest.mark.real
# What the drive is asked for.
ROWS_PX, LIDAR_SHARE = 0.3, 0.02


@pytest.fixture(scope="module")
def mended(real_data, tmp_path_factory):
    """The rig that `check` writes, from all pairs."""
    out = tmp_path_factory.mktemp("extract") / "rig.json"
    source = str(real_data / "kitti_raw_unrectified")
    assert main(["check", source, "--frames", "0::1", "--out", str(out)]) == 0
    return source, out


def test_rows_meet_after_a_small_correction(mended, capsys):
    source, rig = mended
    rows_px = []
    for given in ([], ["--rig", str(rig)]):
        capsys.readouterr()
        assert main(["check", source, "--frames", "0::3", "--json", *given]) == 0
        findings = json.loads(capsys.readouterr().out)["findings"]
        turn = next(f for f in findings if f["name"] == "rotation")
        rows_px.append(turn["rows_before_px"])
    assert rows_px[0] > 0.4
    assert rows_px[1] < ROWS_PX
    assert turn["severity"] == "good"


def test_metres_agree_with_the_velodyne(mended, capsys):
    source, rig = mended
    capsys.readouterr()
    call = ["compare", source, "--rig", str(rig), "--scan-offset", "2", "--frames", "33", "--json"]
    assert main(call) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["median_rel"] <= LIDAR_SHARE
    assert report["n"] > 10_000
