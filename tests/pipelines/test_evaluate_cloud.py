"""evaluate cloud: pairs against their scans, clouds against clouds."""

from __future__ import annotations

import json

import pytest
from pseudolidar.pipelines.evaluate import Evaluate, Maps, run

from pseudolidar.cli import main
from pseudolidar.errors import UsageError
from pseudolidar.stereo.sgbm import Bm

STREET = ("synthetic:street:2", "--width-px", "640")


@pytest.fixture(scope="module")
def converted(tmp_path_factory):
    out = tmp_path_factory.mktemp("evaluate_cloud")
    assert main(["convert", *STREET, str(out), "--to", "ply"]) == 0
    return out


def told(capsys, *args: object, code: int = 0) -> dict:
    capsys.readouterr()
    assert main(["evaluate", "cloud", *map(str, args), "--json"]) == code
    return json.loads(capsys.readouterr().out)


def test_pairs_against_their_scans(capsys):
    found = told(capsys, *STREET)
    assert (found["frames"], found["reference"]) == (2, "LiDAR scans")
    assert found["subject"].startswith("census (quality fast) + clean on ")
    assert [(b["from_m"], b["to_m"]) for b in found["bins"]][:2] == [(5, 10), (10, 20)]
    # farther is worse, and near the cloud is good to a hand's width
    near, middle = found["bins"][0], found["bins"][2]
    assert near["accuracy_median_m"] < 0.1 < middle["accuracy_median_m"] + 0.1
    assert near["f_score_0_2"] > middle["f_score_0_2"]
    assert found["n"] > 10_000
    worse = told(capsys, *STREET, "--frames", "0", "--matcher", "bm", "--clean", "none")
    assert worse["f_score_0_2"] < found["f_score_0_2"]


def test_clouds_in_files_against_themselves_and_against_pairs_clouds(converted, capsys):
    same = told(capsys, converted / "ply", "--reference", converted / "ply")
    assert (same["accuracy_m"], same["completeness_m"], same["f_score_0_1"]) == (0, 0, 1)
    # pairs whose reference are the clouds that `convert` made of them
    pairs = told(capsys, *STREET, "--reference", converted / "ply", "--bins", "5,10,20")
    assert pairs["frames"] == 2
    assert pairs["accuracy_p90_m"] < 1e-3
    assert len(pairs["bins"]) == 2


def test_what_cannot_be_judged_is_refused(converted, tmp_path, capsys):
    error = told(capsys, converted / "ply", code=3)["error"]
    assert "no frame has a reference" in error["got"]
    assert error["want"] == "LiDAR scans of its frames"
    error = told(capsys, *STREET, "--reference", STREET[0], code=3)["error"]
    assert error["want"] == "point clouds"
    with pytest.raises(UsageError, match="disparity maps, which have no points"):
        run(Evaluate("cloud", Maps(tmp_path), Bm()))
