"""Disparity and depth made by somebody else: the same cloud, and wrong units found out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.convert import Convert, ConvertReport, run
from pseudolidar.errors import (
    ImageFormat,
    ImageMissing,
    MapEmpty,
    MapScale,
    NoPairs,
    PseudolidarError,
    SourceEmpty,
    StructureError,
    UsageError,
)
from pseudolidar.formats.pictures.pfm import write_pfm
from pseudolidar.formats.points.npz import read_npz
from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.geometry.depth import depth_map
from pseudolidar.geometry.triangulation import corrected_disparity, measured_disparity
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.sources.selection import FrameSelection
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.sources.tum_depth import TumDepth
from pseudolidar.stereo.given_check import check_readings
from pseudolidar.stereo.given_maps import GivenMaps, StoredSteps, files_of
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DepthMap, DisparityMap
from pseudolidar.structures.frame import StereoFrame

WIDTH = 320
CORRECTION = DisparityCorrection(
    np.array([0.3, 0.2, -0.1, 0.05, 0.2, 0.1, -0.05, 0.1, 0.1, -0.1]), 0.2
)


@pytest.fixture(scope="module")
def frames() -> list[StereoFrame]:
    source = Synthetic("room", frames=2, width_px=WIDTH).open()
    return [source.load(index) for index in range(2)]


@pytest.fixture(scope="module")
def pairs(frames: list[StereoFrame], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The frames as folders of pairs with a rig."""
    folder = tmp_path_factory.mktemp("pairs") / "pairs"
    for eye in ("left", "right"):
        (folder / eye).mkdir(parents=True)
        for index, frame in enumerate(frames):
            image = cv2.cvtColor(np.asarray(getattr(frame, eye)), cv2.COLOR_RGB2BGR)
            cv2.imwrite(str(folder / eye / f"{index:06d}.png"), image)
    write_rig(folder / "rig.json", replace(frames[0].rig, T_left_velodyne=None))
    return folder


def truth(frame: StereoFrame) -> np.ndarray:
    assert frame.truth is not None
    return frame.truth.values


def depth_of(frame: StereoFrame) -> np.ndarray:
    assert frame.truth is not None
    return depth_map(frame.truth, frame.rig).values


def write_maps(folder: Path, maps: list[np.ndarray], form: str, steps: float = 1.0) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for index, values in enumerate(maps):
        path = folder / f"{index:06d}.{form}"
        if form == "png":
            cv2.imwrite(str(path), np.round(np.nan_to_num(values) * steps).astype(np.uint16))
        elif form == "pfm":
            write_pfm(path, DisparityMap(values * np.float32(steps)))
        else:
            np.save(path, values * np.float32(steps))
    return folder


def convert(pairs: Path, out: Path, to: str = "npz,depth", **settings: object) -> ConvertReport:
    job = Convert(
        Folders(str(pairs)), out, to=Outputs.parse(to), workers=1,
        **settings,  # type: ignore[arg-type]
    )  # fmt: skip
    report = run(job)
    assert isinstance(report, ConvertReport)
    return report


FORMS = [
    ("disparity", "png", 256, "auto"),
    ("disparity", "png", 16, "16"),
    ("disparity", "pfm", 1, "auto"),
    ("disparity", "npy", 1, "auto"),
    ("depth", "png", 256, "auto"),
    ("depth", "png", 1000, "1000"),
    ("depth", "png", 5000, "5000"),
    ("depth", "pfm", 1, "auto"),
    ("depth", "npy", 1000, "1000"),
]


@pytest.mark.parametrize(("kind", "form", "steps", "flag"), FORMS)
def test_every_form_becomes_the_cloud_of_the_exact_disparity(
    kind: str, form: str, steps: float, flag: str, frames: list[StereoFrame], pairs: Path,
    tmp_path: Path,
) -> None:  # fmt: skip
    exact = [truth(f) if kind == "disparity" else depth_of(f) for f in frames]
    maps = write_maps(tmp_path / "maps", exact, form, steps)
    report = convert(
        pairs, tmp_path / "out", map_scale=StoredSteps.parse(flag), sigma_px=0.25, **{kind: maps}
    )
    assert report.exit_code == 0
    cloud = read_npz(tmp_path / "out" / "npz" / "000001.npz")
    assert len(cloud) == exact[1].size
    want = depth_of(frames[1])[cloud.uv[:, 1].astype(int), cloud.uv[:, 0].astype(int)]
    # half a step of what was stored, as an error of depth
    half = 0.5 / steps if form == "png" else 0.0
    fB = frames[1].rig.fB_px_m
    of_disparity = half * want**2 / (fB - want * half)
    allowed = of_disparity if kind == "disparity" else np.full_like(want, half)
    assert np.all(np.abs(cloud.xyz[:, 2] - want) <= 1.01 * allowed + 3e-6 * want)
    np.testing.assert_array_equal(
        cloud.rgb, frames[1].left[cloud.uv[:, 1].astype(int), cloud.uv[:, 0].astype(int)]
    )
    assert cloud.sigma_m is not None
    # sigma along the ray: 0.25 px of the maps and 0.5 px of a rig that nobody checked
    reach = np.linalg.norm(cloud.xyz, axis=1)
    np.testing.assert_allclose(
        cloud.sigma_m, np.hypot(0.25, 0.5) * cloud.xyz[:, 2] * reach / fB, rtol=1e-4
    )


def test_depth_is_not_corrected_by_the_rig_and_disparity_is(
    frames: list[StereoFrame], pairs: Path, tmp_path: Path
) -> None:
    rig = replace(frames[0].rig, T_left_velodyne=None).with_correction(CORRECTION)
    write_rig(tmp_path / "rig.json", rig)
    depths = write_maps(tmp_path / "depth", [depth_of(f) for f in frames], "pfm")
    convert(pairs, tmp_path / "of_depth", depth=depths, rig=tmp_path / "rig.json")
    cloud = read_npz(tmp_path / "of_depth" / "npz" / "000000.npz")
    want = depth_of(frames[0]).ravel()
    np.testing.assert_allclose(cloud.xyz[:, 2], want, rtol=1e-5)
    disparities = write_maps(tmp_path / "disparity", [truth(f) for f in frames], "pfm")
    convert(pairs, tmp_path / "of_disparity", disparity=disparities, rig=tmp_path / "rig.json")
    corrected = read_npz(tmp_path / "of_disparity" / "npz" / "000000.npz")
    assert np.median(np.abs(corrected.xyz[:, 2] / want - 1)) > 0.003


def test_measured_is_the_inverse_of_corrected(frames: list[StereoFrame]) -> None:
    rig = frames[0].rig.with_correction(CORRECTION)
    rng = np.random.default_rng(2)
    d, u, v = rng.uniform(1, 80, 500), rng.uniform(0, 300, 500), rng.uniform(0, 200, 500)
    again = corrected_disparity(measured_disparity(d, u, v, rig), u, v, rig)
    np.testing.assert_allclose(again, d, rtol=1e-13)


# --- units -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "stored", "given", "better"),
    [
        ("disparity", 16, "auto", "16"),  # OpenCV's sixteenths as PNG
        ("disparity", 1, "auto", "1"),
        ("disparity", 256, "16", "256"),
        ("disparity", 256, "1", "256"),
        ("depth", 1000, "auto", "1000"),  # millimetres
        ("depth", 5000, "auto", "5000"),
        ("depth", 256, "1000", "256"),
    ],
)
def test_a_scale_that_the_pictures_contradict_is_refused_with_the_right_one(
    kind: str, stored: float, given: str, better: str, frames: list[StereoFrame], pairs: Path,
    tmp_path: Path,
) -> None:  # fmt: skip
    exact = [truth(f) if kind == "disparity" else depth_of(f) for f in frames]
    maps = write_maps(tmp_path / "maps", exact, "png", stored)
    with pytest.raises(MapScale) as error:
        convert(pairs, tmp_path / "out", map_scale=StoredSteps.parse(given), **{kind: maps})
    assert error.value.fix == f"Pass --map-scale {better}."
    assert not (tmp_path / "out" / "npz").exists()


@pytest.mark.parametrize(
    ("kind", "stored", "given"), [("disparity", 256, "1"), ("depth", 1, "1000")]
)
def test_without_the_check_implausible_depth_is_said_with_its_readings(
    kind: str, stored: float, given: str, frames: list[StereoFrame], pairs: Path, tmp_path: Path
) -> None:
    exact = [truth(f) if kind == "disparity" else depth_of(f) for f in frames]
    maps = write_maps(tmp_path / "maps", exact, "png", stored)
    scale = StoredSteps.parse(given)
    convert(pairs, tmp_path / "out", "npz", map_scale=scale, check_maps=False, **{kind: maps})
    notes = (tmp_path / "out" / "report.json").read_text()
    assert "DisparityScale: 100% of the depths lie outside 0.5 to 500 m" in notes
    assert "as 1/256" in notes
    assert "x 16" in notes
    assert "mm" in notes


def test_maps_of_other_frames_fit_in_no_scale(
    frames: list[StereoFrame], pairs: Path, tmp_path: Path
) -> None:
    elsewhere = [truth(f) + np.float32(100) for f in frames]
    maps = write_maps(tmp_path / "maps", elsewhere, "pfm")
    with pytest.raises(MapScale, match="in no known scale") as error:
        convert(pairs, tmp_path / "out", disparity=maps)
    assert "--no-check-maps" in error.value.fix
    assert convert(pairs, tmp_path / "out", disparity=maps, check_maps=False).exit_code == 0


def test_pictures_without_texture_cannot_tell(frames: list[StereoFrame], tmp_path: Path) -> None:
    flat = replace(
        frames[0], left=np.full_like(frames[0].left, 90), right=np.full_like(frames[0].right, 90)
    )
    maps = write_maps(tmp_path / "maps", [truth(flat)], "png", 16)
    given = GivenMaps({flat.id: maps / "000000.png"}, maps, "disparity", StoredSteps())
    verdict = check_readings(given, [flat])
    assert verdict is not None
    assert np.isnan(verdict.error)
    assert "not checked" in verdict.text("disparity")


def test_whole_numbers_that_say_nothing_need_the_flag(
    frames: list[StereoFrame], pairs: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "maps"
    folder.mkdir()
    for index, frame in enumerate(frames):
        np.save(folder / f"{index:06d}.npy", np.round(truth(frame) * 16).astype(np.int16))
    with pytest.raises(MapScale, match="--map-scale 16"):
        convert(pairs, tmp_path / "out", disparity=folder)
    report = convert(pairs, tmp_path / "out", disparity=folder, map_scale=StoredSteps(16.0))
    assert report.exit_code == 0


# --- names and damage ----------------------------------------------------------------------------


def test_maps_belong_to_frames_by_name_or_number_and_never_by_position(tmp_path: Path) -> None:
    ids = ["000003", "000007"]

    def found(*names: str) -> dict[str, str]:
        folder = tmp_path / "-".join(names)
        folder.mkdir()
        for name in names:
            (folder / name).touch()
        return {key: path.name for key, path in files_of(folder, ids).items()}

    assert found("000003.png", "000007.pfm", "notes.txt") == {
        "000003": "000003.png", "000007": "000007.pfm",
    }  # fmt: skip
    assert found("disp_3.pfm", "disp_7.pfm") == {"000003": "disp_3.pfm", "000007": "disp_7.pfm"}
    assert found("disp_7.pfm") == {"000007": "disp_7.pfm"}
    with pytest.raises(SourceEmpty, match="never paired by position"):
        found("a.png", "b.png")
    with pytest.raises(SourceEmpty, match="none of a frame"):
        found("x1.png", "x2.png")
    with pytest.raises(SourceEmpty, match="none of a frame"):
        found("a_3.png", "b_3.png", "c_7.png")  # two have the same number
    with pytest.raises(SourceEmpty, match="no such folder"):
        files_of(tmp_path / "absent", ids)
    single = tmp_path / "one.pfm"
    single.touch()
    assert files_of(single, ["a"]) == {"a": single}


def test_damage_costs_its_frame(frames: list[StereoFrame], pairs: Path, tmp_path: Path) -> None:
    maps = write_maps(tmp_path / "maps", [truth(f) for f in frames], "png", 256)
    given = GivenMaps.of(maps, ["000000", "000001"], kind="disparity", stored=StoredSteps())
    frame = replace(frames[0], id="000000")
    assert given(frame).density == 1.0

    def refused(kind: type[PseudolidarError], words: str) -> None:
        with pytest.raises(kind, match=words):
            given(frame)

    shape = truth(frame).shape
    place = str(maps / "000000.png")
    cv2.imwrite(place, np.zeros(shape, np.uint16))
    refused(MapEmpty, "no pixel has a disparity")
    cv2.imwrite(place, np.full(shape, 30, np.uint8))
    refused(ImageFormat, "only to look at")
    cv2.imwrite(place, np.full((shape[0] // 2, shape[1] // 2), 3000, np.uint16))
    refused(StructureError, "the picture's size")
    with pytest.raises(ImageMissing, match="no disparity map of frame other"):
        given(replace(frame, id="other"))
    values = truth(frame).copy()
    values[0, :4] = (np.nan, np.inf, -np.inf, -3.0)
    np.save(maps / "000000.npy", values)
    (maps / "000000.png").unlink()
    again = GivenMaps.of(maps, ["000000"], kind="disparity", stored=StoredSteps())(frame)
    assert np.isnan(again.values[0, :4]).all()
    np.testing.assert_array_equal(again.values[1:], values[1:])
    # a frame without a map is skipped, named, and the others stay
    (maps / "000001.png").unlink()
    report = convert(pairs, tmp_path / "out", disparity=maps)
    assert report.exit_code == 4
    assert [(r.id, r.skipped["code"]) for r in report.result.skipped] == [
        ("000001", "ImageMissing")
    ]


def test_settings_that_cannot_be_meant(pairs: Path, tmp_path: Path) -> None:
    for flags in ({"sigma_px": 1.0}, {"map_scale": StoredSteps(16.0)}):
        with pytest.raises(UsageError, match="without maps"):
            convert(pairs, tmp_path / "out", **flags)
    with pytest.raises(UsageError, match="both --disparity and --depth"):
        convert(pairs, tmp_path / "out", disparity=tmp_path, depth=tmp_path)
    for text in ("0", "-1", "x", "1_0", "inf"):
        with pytest.raises(UsageError, match="a number above 0"):
            StoredSteps.parse(text)


def test_maps_need_pairs(frames: list[StereoFrame], tmp_path: Path) -> None:
    folder = tmp_path / "tum"
    (folder / "rgb").mkdir(parents=True)
    cv2.imwrite(str(folder / "rgb" / "1.png"), np.asarray(frames[0].left))
    (folder / "depth").mkdir()
    write_pfm(folder / "depth" / "1.pfm", DepthMap(depth_of(frames[0])))
    (folder / "K.txt").write_text("300 0 160 0 300 120 0 0 1\n")
    with pytest.raises(NoPairs, match="pictures with depth"):
        run(Convert(TumDepth(str(folder)), tmp_path / "out", depth=folder / "depth"))


def test_other_maps_are_other_settings(
    frames: list[StereoFrame], pairs: Path, tmp_path: Path
) -> None:
    first = write_maps(tmp_path / "a", [truth(f) for f in frames], "pfm")
    second = write_maps(tmp_path / "b", [truth(f) for f in frames], "pfm")
    convert(pairs, tmp_path / "out", disparity=first)
    with pytest.raises(UsageError, match="given_disparity"):
        convert(pairs, tmp_path / "out", disparity=second)


@pytest.mark.real
def test_our_own_maps_of_kitti_become_our_own_cloud(real_data: Path, tmp_path: Path) -> None:
    """What convert writes as disparity and depth, fed back, is the same cloud, column by column."""
    source = KittiStereo(str(real_data / "kitti_stereo2015" / "training"))
    chosen = FrameSelection.parse("0:1")
    to = Outputs.parse("npz,disparity,depth")

    def cloud_of(out: Path, **settings: object) -> dict[tuple[int, int], int] | object:
        run(Convert(source, out, to=to, frames=chosen, workers=1, **settings))  # type: ignore[arg-type]
        (file,) = (out / "npz").iterdir()
        return read_npz(file)

    own = cloud_of(tmp_path / "own")
    places = {tuple(pixel): row for row, pixel in enumerate(own.uv.astype(int).tolist())}
    for kind in ("disparity", "depth"):
        maps = tmp_path / "own" / kind
        again = cloud_of(tmp_path / f"of_{kind}", **{kind: maps})
        rows = np.array([places.get(tuple(p), -1) for p in again.uv.astype(int).tolist()])
        # the range gate, at 80 m, may fall between the two values of a pixel
        assert (rows >= 0).mean() > 0.999
        assert len(again) > 0.99 * len(own)
        both, mine = again[rows >= 0], own[rows[rows >= 0]]
        np.testing.assert_array_equal(both.rgb, mine.rgb)
        np.testing.assert_array_equal(both.intensity, mine.intensity)
        reach = np.linalg.norm(mine.xyz, axis=1)
        step = reach**2 / 384.4 / 512 if kind == "disparity" else reach * 0 + 0.5 / 256
        off = np.linalg.norm(both.xyz - mine.xyz, axis=1)
        # along the ray a step of depth Z is longer by range / Z, at most 1.4 on this lens
        assert np.all(off <= 1.5 * step + 1e-4)
        assert both.sigma_m is None


def test_flags_by_the_command_line(
    frames: list[StereoFrame], pairs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from pseudolidar.cli import main

    maps = write_maps(tmp_path / "maps", [truth(f) for f in frames], "png", 16)
    out = tmp_path / "out"
    command = ["convert", str(pairs), str(out), "--disparity", str(maps), "--json"]
    assert main(command) == 3
    error = json.loads(capsys.readouterr().out)["error"]
    assert (error["code"], error["fix"]) == ("MapScale", "Pass --map-scale 16.")
    assert main([*command, "--map-scale", "16", "--sigma-px", "0.5"]) == 0
    resolved = json.loads((out / "run.json").read_text())
    assert '"16"' in json.dumps(resolved)
    other = [*command[:2], str(tmp_path / "b"), *command[3:]]
    assert main([*other, "--no-check-maps"]) == 0
