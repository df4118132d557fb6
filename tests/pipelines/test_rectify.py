"""Unrectified pairs through the program: the same clouds by every way, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.pictures.image import encode_png, read_image
from pseudolidar.formats.points.pcd import read_pcd
from pseudolidar.formats.rigs.rig_json import read_rig, write_rig
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.worlds.room import HEIGHT_M
from pseudolidar.structures.frame import RawPair
from tests.lens_worlds import raw_pair, world_rig
from tests.videos import write_video

MOMENTS_S = (0.0, 0.6, 1.2)
MATCHED = ("--min-depth", "0.6", "--to", "pcd,disparity")


@pytest.fixture(scope="module")
def raw() -> list[RawPair]:
    rig = world_rig("pinhole", (288, 216), focal_px=190.0)
    return [raw_pair(rig, t_s, name=f"{i:03d}", index=i) for i, t_s in enumerate(MOMENTS_S)]


@pytest.fixture(scope="module")
def wide() -> RawPair:
    return raw_pair(world_rig("fisheye", (320, 240), focal_px=78.0))


def stored(pairs: list[RawPair], folder: Path) -> Path:
    for eye in ("left", "right"):
        (folder / eye).mkdir(parents=True)
    for pair in pairs:
        (folder / "left" / f"{pair.id}.png").write_bytes(encode_png(pair.left))
        (folder / "right" / f"{pair.id}.png").write_bytes(encode_png(pair.right))
    write_rig(folder / "rig.json", pairs[0].rig)
    return folder


@pytest.fixture(scope="module")
def folder(raw: list[RawPair], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return stored(raw, tmp_path_factory.mktemp("raw") / "pictures")


def tree(out: Path) -> dict[str, bytes]:
    return {str(file.relative_to(out)): file.read_bytes() for file in sorted(out.glob("[dp]*/*"))}


@pytest.fixture(scope="module")
def want(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Clouds and disparities of the raw pairs, one worker, some pixels that nobody saw."""
    out = tmp_path_factory.mktemp("want") / "out"
    line = ["convert", str(folder), str(out), *MATCHED, "--rectify.alpha", "0.7"]
    assert main([*line, "--workers", "1"]) == 0
    return tree(out)


def test_what_rectify_writes_gives_the_clouds_of_the_raw_pairs(
    folder: Path, want: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "rectified"
    capsys.readouterr()
    assert main(["rectify", str(folder), str(out), "--alpha", "0.7", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["committed"] == 3
    (view,) = told["views"]
    assert 0.5 < view["seen_left"] < 0.98
    assert told["row_difference_px"] < 0.2
    assert told["matches"] > 100
    assert read_image(out / "rows.png").pixels.shape[1] == 2 * 288
    rig = read_rig(out / "rig.json")
    assert rig.is_rectified
    assert rig.left.focal_px == pytest.approx(view["f_px"])
    assert main(["convert", str(out), str(tmp_path / "again"), *MATCHED]) == 0
    assert tree(tmp_path / "again") == want
    # Without its mask black is matched with black.
    for eye in ("left", "right"):
        (out / "valid" / f"{eye}.png").unlink()
    assert main(["convert", str(out), str(tmp_path / "without"), *MATCHED]) == 0
    assert tree(tmp_path / "without") != want


@pytest.mark.parametrize("crew", [("--workers", "3"), ("--isolate", "--workers", "2")])
def test_the_same_bytes_by_any_crew(
    crew: tuple[str, ...], folder: Path, want: dict[str, bytes], tmp_path: Path
) -> None:
    line = ["convert", str(folder), str(tmp_path / "out"), *MATCHED, "--rectify.alpha", "0.7"]
    assert main([*line, *crew]) == 0
    assert tree(tmp_path / "out") == want


def test_a_run_that_lost_files_is_made_whole_and_other_settings_are_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    line = ["rectify", str(folder), str(out)]
    assert main(line) == 0

    def all_files() -> dict[str, bytes]:
        names = ("left/*", "right/*", "valid/*", "rig.json", "times.txt")
        return {str(f): f.read_bytes() for name in names for f in out.glob(name)}

    first = all_files()
    (out / "left" / "001.png").unlink()
    (out / "rig.json").unlink()
    assert main([*line, "--workers", "1"]) == 0
    assert all_files() == first
    assert len(first) == 3 + 3 + 2 + 1 + 1
    capsys.readouterr()
    assert main([*line, "--zoom", "1.5", "--json"]) != 0
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "OutputSettings"


def test_videos_of_raw_pairs_give_the_same_clouds(
    raw: list[RawPair], want: dict[str, bytes], folder: Path, tmp_path: Path
) -> None:
    for eye in ("left", "right"):
        write_video(tmp_path / f"{eye}.mkv", [getattr(pair, eye) for pair in raw])
    out = tmp_path / "out"
    line = ["convert", str(tmp_path / "left.mkv"), str(out), *MATCHED, "--rectify.alpha", "0.7"]
    assert main([*line, "--rig", str(folder / "rig.json")]) == 0
    got = {name: data for name, data in tree(out).items() if name.startswith("disparity")}
    assert len(got) == 3
    assert list(got.values()) == [d for n, d in want.items() if n.startswith("disparity")]


def test_views_of_a_fisheye_make_one_cloud_all_around(wide: RawPair, tmp_path: Path) -> None:
    folder = stored([wide], tmp_path / "wide")
    line = ["convert", str(folder), str(tmp_path / "out"), "--to", "pcd,mcap,bin"]
    assert main([*line, "--min-depth", "0.6", "--rectify.views", "3"]) == 0
    cloud = read_pcd(tmp_path / "out/pcd/000000.pcd")
    assert cloud.frame == "base_link"
    assert set(np.unique(cloud.extra["source"])) == {0, 1, 2}
    x, y, z = cloud.xyz.T
    above, below = z > np.abs(x), z < -np.abs(x)
    assert above.mean() > 0.1
    assert below.mean() > 0.1
    # The hall's ceiling above, its floor below, flat (the cameras look down by 2 degrees).
    for part in (above, below):
        near = part & (np.hypot(x, y) < 2)
        assert np.std(z[near]) < 0.12
    assert np.median(z[above]) - np.median(z[below]) == pytest.approx(HEIGHT_M, abs=0.1)
    # ... and the views as pairs of their own.
    out = tmp_path / "views"
    assert main(["rectify", str(folder), str(out), "--views", "3"]) == 0
    for number in range(3):
        source = Folders(str(out / f"view_{number}")).open()
        assert source.rig.is_rectified
        assert source.load(0).mask is not None


def refused(capsys: pytest.CaptureFixture[str], *line: object) -> dict:
    capsys.readouterr()
    assert main([*map(str, line), "--json"]) in (2, 3)
    return json.loads(capsys.readouterr().out)["error"]


def test_bad_input_is_named(
    folder: Path, raw: list[RawPair], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    already = refused(capsys, "rectify", "synthetic:room", tmp_path / "a")
    assert "rectified already" in already["got"]
    assert refused(capsys, "rectify", folder, tmp_path / "b", "--alpha", "2")["want"] == "0 to 1"
    for place in (folder, folder.parent / "." / folder.name):
        assert "holds what is read" in refused(capsys, "rectify", folder, place)["got"]
    rig = tmp_path / "in_out" / "rig.json"
    rig.parent.mkdir()
    write_rig(rig, raw[0].rig)
    line = ("rectify", folder, rig.parent, "--rig", rig)
    assert "holds what is read" in refused(capsys, *line)["got"]
    assert read_rig(rig).left.distortion.any()
    other = stored(raw[:1], tmp_path / "other")
    (other / "left" / "000.png").write_bytes(encode_png(raw[0].left[:-2]))
    size = refused(capsys, "convert", other, tmp_path / "c")
    assert size["code"] == "CalibrationSizeMismatch"
    swapped = stored([raw[0]], tmp_path / "swapped")
    (swapped / "left" / "000.png").write_bytes(encode_png(raw[0].right))
    (swapped / "right" / "000.png").write_bytes(encode_png(raw[0].left))
    eyes = refused(capsys, "rectify", swapped, tmp_path / "d")
    assert (eyes["code"], eyes["fix"]) == ("PairSwapped", "Pass --swap.")
    assert main(["rectify", str(swapped), str(tmp_path / "d"), "--swap"]) == 0
    want = tmp_path / "e"
    assert main(["rectify", str(stored([raw[0]], tmp_path / "right")), str(want)]) == 0
    assert (tmp_path / "d/left/000.png").read_bytes() == (want / "left/000.png").read_bytes()


def test_no_picture_of_anybody_is_written_over(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mine"
    (out / "left").mkdir(parents=True)
    (out / "left" / "000.png").write_bytes(b"mine")
    for more in ((), ("--overwrite",)):
        assert "no run has written" in refused(capsys, "rectify", folder, out, *more)["got"]
    # A folder of the source's pictures, in which folders left and right would hide them.
    error = refused(capsys, "rectify", folder, folder / "left")
    assert "holds what is read" in error["got"]
    assert sorted(path.name for path in out.iterdir()) == ["left"]
    assert (out / "left" / "000.png").read_bytes() == b"mine"
    assert not (folder / "left" / "left").exists()


def test_maps_of_several_views_are_refused_by_name(
    wide: RawPair, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = stored([wide], tmp_path / "wide")
    line = ("convert", folder, tmp_path / "out", "--rectify.views", "3", "--to", "depth")
    error = refused(capsys, *line)
    assert "depth" in error["got"]
    assert "--rectify.views" in error["fix"]
