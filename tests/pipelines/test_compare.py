"""The verb from end to end: figures as JSON and CSV, what is left out, where results go."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.errors import SOME_SKIPPED
from pseudolidar.evaluation.comparison.figures import FIGURES
from pseudolidar.formats.points.cloud_file import read_cloud
from pseudolidar.formats.points.npz import read_npz
from pseudolidar.formats.points.ply import write_ply
from pseudolidar.structures.cloud import PointCloud

STREET = ("synthetic:street:4", "--width-px", "480")


def compare(*args: object) -> int:
    return main(["compare", *map(str, args)])


def result(capsys: pytest.CaptureFixture[str], *args: object, code: int = 0) -> dict:
    capsys.readouterr()
    assert compare(*args, "--json") == code
    return json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of four frames of a street; not to be changed."""
    out = tmp_path_factory.mktemp("street") / "out"
    assert compare(*STREET, out, "--to", "npz,mcap,together") == 0
    return out


def test_figures_as_json_and_in_the_folder_are_the_same(street, capsys):
    told = result(capsys, *STREET)
    assert told["frames"] == 4
    assert [(b["from_m"], b["to_m"]) for b in told["bins"]] == [
        (5, 10),
        (10, 20),
        (20, 30),
        (30, 50),
        (50, 80),
    ]
    for each in told["bins"]:
        assert {"median_rel", "p90_rel", "bias_rel", "density", "n"} <= each.keys()
        assert 0 < each["n"] <= each["reference_points"]
        assert each["density"] == pytest.approx(each["n"] / each["reference_points"])
        assert each["intervals"].keys() == set(FIGURES)
    assert told["n"] == sum(each["n"] for each in told["bins"])
    assert 0.5 < told["within_1_sigma"] <= told["within_95"] <= 1
    assert told["reference"] == "LiDAR scans"
    # a rendered rig is exact: what is left is matching
    assert told["median_rel"] < 0.02
    assert abs(told["bins"][0]["bias_rel"]) < 0.01
    stored = json.loads((street / "compare.json").read_text())
    assert stored["settings"]["matcher"]["kind"] == "census"
    assert stored["bins"] == told["bins"]
    assert stored["by_column"] == told["by_column"]
    # scans are clouds, too; a resumed or stored run has them as one that writes nothing
    assert stored["clouds"] == told["clouds"]
    assert (told["clouds"]["frames"], told["clouds"]["reference"]) == (4, "LiDAR scans")
    assert 0 < told["clouds"]["bins"][0]["accuracy_median_m"] < 0.1


def test_the_table_has_a_row_for_every_frame_and_bin(street):
    with (street / "compare.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 5 * 6  # four frames and all of them; five bins and all of them
    stored = json.loads((street / "compare.json").read_text())
    pooled = rows[-6:]
    assert {row["frame"] for row in pooled} == {"all"}
    for row, each in zip(pooled, stored["bins"], strict=False):
        assert float(row["median_rel"]) == each["median_rel"]
        low, high = each["intervals"]["median_rel"]
        assert (float(row["median_rel_low"]), float(row["median_rel_high"])) == (low, high)
    by_bin = [sum(int(r["n"]) for r in rows[b : 4 * 6 : 6]) for b in range(6)]
    assert by_bin == [int(row["n"]) for row in pooled]
    assert rows[0]["median_rel_low"] == ""


def test_clouds_carry_their_errors(street):
    cloud = read_npz(street / "npz" / "000002.npz")
    error_m = cloud.extra["error_m"]
    known = np.isfinite(error_m)
    assert 0.02 < known.mean() < 0.9
    # x of the Velodyne's frame is forward, within a degree of the camera's axis
    reference_m = cloud.xyz[known, 0] - error_m[known]
    relative = error_m[known] / reference_m
    red, _, blue = cloud.rgb[known].astype(int).T
    assert (red > blue)[relative > 0.02].all()
    assert (blue > red)[relative < -0.02].all()


def test_both_clouds_together(street):
    both = read_cloud(street / "together" / "000002.ply")
    source = both.extra["source"]
    assert set(np.unique(source)) == {0, 1}
    stereo = read_npz(street / "npz" / "000002.npz")
    assert (source == 0).sum() == len(stereo)
    np.testing.assert_allclose(both.xyz[source == 0], stereo.xyz, atol=1e-4)
    assert (both.rgb[source == 1] == (0, 200, 255)).all()
    # the scan lies where stereo is: nearest neighbours of its points ahead
    from scipy.spatial import cKDTree

    scan = both.xyz[source == 1]
    ahead = scan[(scan[:, 0] > 6) & (scan[:, 0] < 15) & (np.abs(scan[:, 1]) < 3)]
    assert np.median(cKDTree(stereo.xyz).query(ahead)[0]) < 0.15


def test_a_complete_folder_is_left_alone_and_a_torn_one_is_completed(street, tmp_path, capsys):
    out = tmp_path / "out"
    shutil.copytree(street, out)
    before = (out / "compare.json").read_bytes()
    args = (*STREET, out, "--to", "npz,mcap,together")
    assert compare(*args) == 0
    assert "already complete" in capsys.readouterr().out
    (out / ".compared" / "000001.npz").unlink()
    (out / "compare.json").unlink()
    (out / "compare.csv").unlink()
    assert compare(*args, "--workers", 1) == 0
    assert (out / "compare.json").read_bytes() == before
    for name in ("compare.csv", "npz/000001.npz", ".compared/000001.npz"):
        assert (out / name).read_bytes() == (street / name).read_bytes()
    recordings = [next(folder.glob("*.mcap")).read_bytes() for folder in (out, street)]
    assert recordings[0] == recordings[1]


def test_bins_of_ones_own(capsys):
    told = result(capsys, *STREET, "--frames", "0", "--bins", "0,15,400")
    assert [(b["from_m"], b["to_m"]) for b in told["bins"]] == [(0, 15), (15, 400)]
    assert told["intervals"] == {}  # of one frame
    assert compare(*STREET, "--bins", "15,5") == 2
    assert "increasing" in capsys.readouterr().err


def test_the_truth_where_it_is_asked_for(capsys):
    told = result(capsys, *STREET, "--frames", "0,1", "--reference", "truth")
    assert told["reference"] == "ground-truth disparities"
    assert told["time_offset"] is None
    assert told["n"] > 50_000
    assert told["clouds"] is None


def test_a_source_without_a_reference_is_refused(drive, capsys):
    told = result(capsys, drive, "--rig", drive / "rig.json", code=3)
    assert told["error"]["code"] == "ReferenceMissing"


def test_bad_frames_are_left_out_and_named(tmp_path, capsys):
    kitti = tmp_path / "kitti"
    assert main(["synth", str(kitti), "--frames", "4", "--width-px", "480"]) == 0
    next(kitti.rglob("image_02/data/*1.png")).write_bytes(b"not a picture")
    for out in ((), (tmp_path / "out",)):
        told = result(capsys, kitti, *out, code=SOME_SKIPPED)
        assert [(each["id"], each["code"]) for each in told["skipped"]] == [
            ("0000000001", "ImageUnreadable")
        ]
        assert told["frames"] == 3


@pytest.fixture(scope="module")
def kitti(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two drives and something else; not to be changed."""
    root = tmp_path_factory.mktemp("drives")
    for seed, name in ((1, "one"), (2, "two")):
        args = ("--frames", "2", "--width-px", "480", "--seed", str(seed))
        assert main(["synth", str(root / name), *args]) == 0
    (root / "notes").mkdir()
    (root / "notes" / "readme.txt").write_text("no drive")
    return root


@pytest.mark.slow
def test_all_drives_of_a_folder_with_one_table(kitti, tmp_path, capsys):
    out = tmp_path / "out"
    told = result(capsys, kitti, out, "--all", "--to", "none")
    assert [drive["drive"] for drive in told["drives"]] == ["one", "two"]
    assert told["frames"] == 4
    assert told["n"] == sum(drive["n"] for drive in told["drives"])
    alone = result(capsys, kitti / "two")
    assert told["drives"][1]["bins"] == alone["bins"]
    with (out / "compare.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["drive"] for row in rows] == [n for n in ("one", "two", "all") for _ in range(6)]
    assert {path.name for path in out.iterdir() if path.is_dir()} == {"one", "two"}
    assert compare(kitti, out, "--all", "--to", "none") == 0  # the folder is still OUT
    table = capsys.readouterr().out
    assert table.index("\n  one ") < table.index("\n  two ") < table.index("\n  all ")


def test_a_folder_of_drives_needs_to_be_asked_for(kitti, capsys):
    assert compare(kitti) == 3
    assert "SourceUnknown" in capsys.readouterr().err


def test_a_drive_without_reference_is_named_and_the_others_go_on(kitti, tmp_path, capsys):
    root = tmp_path / "drives"
    shutil.copytree(kitti / "one", root / "one")
    shutil.copytree(kitti / "two", root / "two")
    shutil.rmtree(next(root.glob("two/**/velodyne_points")))
    told = result(capsys, root, "--all", code=SOME_SKIPPED)
    assert [drive["drive"] for drive in told["drives"]] == ["one"]
    assert [(each["drive"], each["code"]) for each in told["failed"]] == [
        ("two", "ReferenceMissing")
    ]


@pytest.fixture(scope="module")
def converted(kitti, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Clouds, maps and a recording of the first drive; not to be changed."""
    out = tmp_path_factory.mktemp("converted") / "out"
    args = ("--to", "ply,disparity,mcap", "--mcap.images", "png")
    assert main(["convert", str(kitti / "one"), str(out), *args]) == 0
    return out


@pytest.mark.parametrize("what", ["ply", "disparity", "*.mcap"])
def test_another_source_as_second_argument_is_compared_with(kitti, converted, capsys, what):
    other = next(converted.glob(what))
    told = result(capsys, kitti / "one", other)
    assert told["reference"] == str(other)
    assert told["frames"] == 2
    # the same matcher made them: what is left is rounding of 1/256 px
    assert told["abs_rel"] < 1e-3
    assert told["density"] > 0.999


def test_errors_of_the_other_source_are_found(kitti, converted, tmp_path, capsys):

    for path in sorted((converted / "ply").iterdir()):
        cloud = read_cloud(path)
        (tmp_path / "ply").mkdir(exist_ok=True)
        scaled = PointCloud((cloud.xyz * 1.25).astype(np.float32), cloud.frame, cloud.timestamp_ns)
        write_ply(tmp_path / "ply" / path.name, scaled)
    told = result(capsys, kitti / "one", tmp_path / "ply", "--bins", "10,30")
    # seen from the Velodyne the cloud is a quarter farther away: stereo is a fifth too near
    assert told["bias_rel"] == pytest.approx(-0.2, abs=0.02)


def test_what_the_second_argument_is_taken_for(kitti, converted, tmp_path, capsys):
    first = ("--frames", "0")
    assert compare(kitti / "one", tmp_path / "nowhere.mcap") == 2
    assert "no such file" in capsys.readouterr().err
    assert compare(kitti / "one", converted / "ply", *first) == 0
    assert "compared with" in capsys.readouterr().err
    out = tmp_path / "out"
    assert compare(kitti / "one", out, "--to", "ply", *first) == 0
    assert "results" in capsys.readouterr().err
    assert compare(kitti / "one", out, "--to", "ply", *first) == 0  # clouds in it, and still OUT
    assert "results" in capsys.readouterr().err
    both = ("--out", tmp_path / "both")
    assert compare(kitti / "one", converted / "ply", *both, *first) == 0
    stored = json.loads((tmp_path / "both" / "compare.json").read_text())
    assert stored["reference"] == str(converted / "ply")
    assert compare(kitti / "one", out, "--out", out, "--reference", "scan") == 2


def test_a_source_that_holds_results_is_still_a_source(kitti, tmp_path, capsys):
    shutil.copytree(kitti / "one", tmp_path / "one")
    assert compare(tmp_path / "one", tmp_path / "one" / "out", "--to", "none") == 0
    before = {path for path in (tmp_path / "one").rglob("*") if "out" not in path.parts}
    told = result(capsys, tmp_path / "one", tmp_path / "one", code=2)
    assert told["error"]["got"] == "the source as its own reference"
    told = result(capsys, kitti / "one", tmp_path / "one")
    assert told["reference"] == str(tmp_path / "one")
    assert {p for p in (tmp_path / "one").rglob("*") if "out" not in p.parts} == before


def test_frames_that_do_not_belong_together_are_refused(kitti, tmp_path, capsys):
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "other.pfm").write_bytes(b"Pf\n1 1\n-1\n\0\0\0\0")
    told = result(capsys, kitti / "one", "--reference", tmp_path / "maps", code=3)
    assert told["error"]["code"] == "SourceEmpty"


def mirrored(folder: Path, into: Path) -> Path:
    """Clouds as of a sensor that looks the other way."""
    into.mkdir()
    for path in sorted(folder.iterdir()):
        cloud = read_cloud(path)
        write_ply(into / path.name, replace(cloud, xyz=-cloud.xyz))
    return into


def test_what_has_no_view_in_common_is_refused(kitti, converted, tmp_path, capsys):
    behind = mirrored(converted / "ply", tmp_path / "behind")
    told = result(capsys, converted / "ply", "--reference", behind, code=3)
    assert "have a view in common" in told["error"]["got"]
    told = result(capsys, kitti / "one", "--reference", behind, code=3)
    assert "no point of its references is in the left camera's view" in told["error"]["got"]
    assert told["error"]["code"] == "ReferenceMissing"


def test_results_of_something_else_are_not_replaced(kitti, converted, tmp_path, capsys):
    clouds, out = converted / "ply", tmp_path / "out"
    moved = tmp_path / "moved"
    shutil.copytree(clouds, moved)
    page = (converted / "report.html").read_bytes()
    told = result(capsys, moved, "--reference", clouds, "--out", converted, code=2)
    assert told["error"]["got"] == "the folder holds another run"
    assert (converted / "report.html").read_bytes() == page
    for _ in range(2):  # again the same
        assert compare(moved, "--reference", clouds, "--out", out) == 0
    told = result(capsys, moved, "--reference", clouds, "--out", out, "--bins", "5,9", code=2)
    assert (told["error"]["where"], told["error"]["code"]) == ("bins", "OutputSettings")
    args = ("--reference", clouds, "--out", out, "--bins", "5,9", "--overwrite")
    assert compare(moved, *args) == 0
    told = result(capsys, kitti, "--out", out, "--all", "--to", "none", code=2)
    assert told["error"]["code"] == "OutputSettings"
    (out / "compare.json").write_text("[]")
    told = result(capsys, moved, "--reference", clouds, "--out", out, code=2)
    assert told["error"]["got"] == "results that cannot be read"


def test_clouds_with_clouds(converted, tmp_path, capsys):
    recording = next(converted.glob("*.mcap"))
    for path in sorted((converted / "ply").iterdir()):
        cloud = read_cloud(path)
        (tmp_path / "moved").mkdir(exist_ok=True)
        moved = cloud.xyz + np.array([0, 0, 0.15], np.float32)
        write_ply(tmp_path / "moved" / path.name, replace(cloud, xyz=moved))
    told = result(capsys, tmp_path / "moved", recording, "--bins", "5,30")
    assert told["frames"] == 2
    assert told["reference"] == str(recording)
    assert 0 < told["accuracy_median_m"] <= 0.15 + 1e-3
    assert told["f_score_0_2"] > 0.95
    assert told["f_score_0_1"] < told["f_score_0_2"] <= told["f_score_0_5"]
    same = result(capsys, recording, converted / "ply", "--out", tmp_path / "out")
    assert same["chamfer_m"] < 0.02  # thinned in the recording
    with (tmp_path / "out" / "compare.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6
    assert float(rows[-1]["chamfer_m"]) == same["chamfer_m"]
    assert json.loads((tmp_path / "out" / "compare.json").read_text())["bins"] == same["bins"]
