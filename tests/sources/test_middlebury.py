"""Middlebury of every year and ETH3D: recognised, and truth and metres by each layout's rule."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.evaluate import Evaluate, recognise_judged, run
from pseudolidar.errors import CalibrationField, CalibrationValue, ImageMissing
from pseudolidar.formats.pictures.pfm import write_pfm
from pseudolidar.geometry.depth import depth_map
from pseudolidar.sources.folder import Folders
from pseudolidar.sources.middlebury import Middlebury
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import recognise
from pseudolidar.stereo.census import Census
from pseudolidar.structures.disparity import DisparityMap
from tests.sources.middlebury_layouts import MOTORCYCLE_CALIB, motorcycle, rows, steps, views
from tests.sources.middlebury_layouts import write_steps as write_pair


def truth_of(path: Path, **settings: object) -> np.ndarray:
    assert isinstance(recognise(str(path)), Middlebury)
    truth = Middlebury(str(path), **settings).open().load(0).truth  # type: ignore[arg-type]
    assert truth is not None
    return truth.values


@pytest.mark.real
def test_the_real_motorcycle_in_metres(real_data: Path, tmp_path: Path) -> None:
    scene = motorcycle(real_data, tmp_path / "motorcycle")
    source = recognise(str(scene)).open()
    assert source.rig is not None
    assert (source.rig.baseline_m, round(source.rig.doffs_px, 3)) == (0.193001, 31.086)
    assert any("doffs 31.086 px applied" in note for note in source.summary.notes)
    frame = source.load(0)
    assert frame.truth is not None
    disparity = Census().load(min_depth_m=source.summary.nearest_m)(frame)
    both = disparity.valid & frame.truth.valid
    errors = disparity.values[both] - frame.truth.values[both]
    # evidence: SGBM has a median error of 0.22 px and no bias
    assert np.median(np.abs(errors)) < 0.22
    assert abs(np.median(errors)) < 0.1
    assert disparity.density > 0.85
    true_m = 994.978 * 0.193001 / (frame.truth.values[both] + 31.086)
    found_m = depth_map(disparity, frame.rig).values[both]
    assert np.median(np.abs(found_m / true_m - 1)) < 0.004
    assert 1.9 < np.nanmin(true_m) < np.nanmax(true_m) < 5.5


@pytest.mark.real
def test_evaluate_and_scene_by_a_rig_of_another_form(real_data: Path, tmp_path: Path) -> None:
    scene = motorcycle(real_data, tmp_path / "scenes" / "motorcycle")
    report = run(Evaluate("disparity", recognise_judged(str(scene.parent))))
    assert report.score.density > 0.85
    assert report.score.bad_share(2.0) < 0.07
    assert "off by more than 2 px" in report.text()
    # Its own folder of the data: two pictures, and a calibration given by hand.
    pictures = real_data / "middlebury" / "motorcycle"
    given = tmp_path / "calib.txt"
    given.write_text(MOTORCYCLE_CALIB)
    source = opened_with_rig(Folders(str(pictures)), given)
    assert source.rig is not None
    assert source.rig.fB_px_m == pytest.approx(994.978 * 0.193001)
    assert source.summary.nearest_m == pytest.approx(994.978 * 0.193001 / (70 + 16 + 31.086))


@pytest.mark.parametrize(("size", "factor"), [((1390, 1110), 1), ((695, 555), 2), ((463, 370), 3)])
def test_2005_and_2006_in_all_sizes(size: tuple[int, int], factor: int, tmp_path: Path) -> None:
    wanted = views(tmp_path / "Art", size=size, factor=factor)
    np.testing.assert_array_equal(truth_of(tmp_path / "Art"), wanted.astype(np.float32))
    source = Middlebury(str(tmp_path)).open()
    rig = source.rig
    assert source.ids == ("Art",)
    assert rig.left.focal_px == 3740 / factor
    assert rig.doffs_px == pytest.approx(270 / factor)
    frame = source.load(0)
    assert frame.truth is not None
    depth = depth_map(frame.truth, rig).values
    full_size_px = wanted * factor
    np.testing.assert_allclose(depth, 3740 * 0.16 / (full_size_px + 270), rtol=1e-5)


def test_2006_with_all_lights(tmp_path: Path) -> None:
    views(tmp_path / "Aloe", size=(463, 370), factor=3)
    for eye in ("view1.png", "view5.png"):
        folder = tmp_path / "Aloe" / "Illum2" / "Exp0"
        folder.mkdir(parents=True, exist_ok=True)
        (tmp_path / "Aloe" / eye).rename(folder / eye)
    assert not Middlebury.looks_like(tmp_path / "Aloe")
    source = Middlebury(str(tmp_path / "Aloe"), lighting="Illum2/Exp0").open()
    assert source.load(0).truth is not None


@pytest.mark.parametrize(
    ("size", "factor", "kind"),
    [((450, 375), 4, "png"), ((900, 750), 2, "png"), ((434, 383), 8, "pnm")],
)
def test_2001_and_2003(size: tuple[int, int], factor: int, kind: str, tmp_path: Path) -> None:
    wanted = rows(tmp_path / "cones", size=size, factor=factor, kind=kind)
    np.testing.assert_array_equal(truth_of(tmp_path / "cones"), wanted.astype(np.float32))
    notes = Middlebury(str(tmp_path / "cones")).open().summary.notes
    assert any("no calibration was published" in note for note in notes)


def test_sizes_that_were_never_published_need_the_scale(tmp_path: Path) -> None:
    wanted = views(tmp_path / "small", size=(320, 200), factor=2)
    with pytest.raises(CalibrationField, match="200 px high"):
        Middlebury(str(tmp_path / "small")).open()
    np.testing.assert_array_equal(truth_of(tmp_path / "small", stored_scale=2), wanted)


def eth3d(folder: Path) -> np.ndarray:
    size = (200, 90)
    _, stored = steps(*size, (20, 8))
    write_pair(folder / "delivery", "im0.png", "im1.png", size, stored[:, 0])
    (folder / "delivery" / "calib.txt").write_text(
        "cam0=[150.5 0 99.5; 0 150.5 44.5; 0 0 1]\ncam1=[150.5 0 99.5; 0 150.5 44.5; 0 0 1]\n"
        "doffs=0\nbaseline=59.9097\nwidth=200\nheight=90\nndisp=64\nisint=0\n"
    )
    truth = stored.astype(np.float32)
    truth[:, :30] = np.nan
    return truth


@pytest.mark.parametrize("place", ["two_view_training", "two_view_training_gt"])
def test_eth3d_with_truth_in_or_beside_the_folder(place: str, tmp_path: Path) -> None:
    truth = eth3d(tmp_path / "two_view_training")
    scene = tmp_path / place / "delivery"
    scene.mkdir(parents=True, exist_ok=True)
    write_pfm(scene / "disp0GT.pfm", DisparityMap(truth))
    mask = np.full(truth.shape, 255, np.uint8)
    mask[:, 30:60] = 128
    cv2.imwrite(str(scene / "mask0nocc.png"), mask)
    root = tmp_path / "two_view_training"
    np.testing.assert_array_equal(truth_of(root), truth)
    wanted = truth.copy()
    wanted[:, 30:60] = np.nan
    np.testing.assert_array_equal(truth_of(root, truth="noc"), wanted)
    (scene / "mask0nocc.png").unlink()
    with pytest.raises(ImageMissing, match="no mask"):
        truth_of(root, truth="noc")


def test_a_scene_with_a_bad_calibration_is_refused_alone(tmp_path: Path) -> None:
    eth3d(tmp_path)
    (tmp_path / "delivery").rename(tmp_path / "good")
    eth3d(tmp_path)
    calib = tmp_path / "delivery" / "calib.txt"
    calib.write_text(calib.read_text().replace("doffs=0", "doffs=7"))
    source = Middlebury(str(tmp_path)).open()
    assert source.ids == ("good",)
    ((name, error),) = source.refused
    assert (name, type(error)) == ("delivery", CalibrationValue)
    (tmp_path / "good" / "calib.txt").write_text("cam0=[1\n")
    with pytest.raises(Exception, match="2 scenes, none usable"):
        Middlebury(str(tmp_path)).open()


def test_a_calib_txt_of_others_leaves_the_folder_to_others(tmp_path: Path) -> None:
    eth3d(tmp_path)
    scene = tmp_path / "delivery"
    (scene / "calib.txt").unlink()
    (scene / "K.txt").write_text("150.5 0 99.5 0 150.5 44.5 0 0 1\n0.0599\n")
    source = recognise(str(scene))
    assert isinstance(source, Folders)
    opened = source.open()
    assert opened.rig.baseline_m == 0.0599
    assert any("doffs is 0" in note for note in opened.summary.notes)
    # a folder of such scenes, each with its own
    assert isinstance(recognise(str(tmp_path)), Folders)
    assert recognise(str(tmp_path)).open().rig.baseline_m == 0.0599  # type: ignore[union-attr]
