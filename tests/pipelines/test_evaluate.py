import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from pseudolidar.pipelines.evaluate import Evaluate, Maps, run

from pseudolidar.cli import main
from pseudolidar.errors import ReferenceMissing, UsageError
from pseudolidar.formats.pictures.disparity_png import write_disparity_png
from pseudolidar.formats.rigs.kitti import CAM_TO_CAM, write_raw_calib
from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.stereo.sgbm import Sgbm
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.pose import Pose

WIDTH_PX, HEIGHT_PX, FRAMES = 320, 160, 4
PLANTED_PX = 0.5  # how much larger than the truth the pictures' disparities are
FIGURES = [
    "frames",
    "d1_est",
    "density",
    "d1_filled",
    "epe",
    "within_1_sigma",
    "within_95",
    "within_1_sigma_raw",
    "seconds_per_frame",
]


def rig() -> StereoRig:
    K = np.array([[300.0, 0, 160.0], [0, 300.0, 80.0], [0, 0, 1.0]])
    baseline = np.array([-0.5, 0.0, 0.0])
    return StereoRig(
        Camera(K, WIDTH_PX, HEIGHT_PX),
        Camera(K, WIDTH_PX, HEIGHT_PX, frame="camera_right"),
        Pose.from_rotation("camera_right", "camera_left", np.eye(3), baseline),
    )


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    """Slanted textured planes in the layout of KITTI stereo 2015, truth half a pixel too small."""
    root = tmp_path_factory.mktemp("scene")
    training = root / "training"
    for name in ("image_2", "image_3", "disp_occ_0", "calib_cam_to_cam"):
        (training / name).mkdir(parents=True)
    for number in range(FRAMES):
        left, right, disparity = planes(seed=number)
        stem = f"{number:06d}_10.png"
        for name, image in (("image_2", left), ("image_3", right)):
            cv2.imwrite(str(training / name / stem), image)
        write_disparity_png(training / "disp_occ_0" / stem, DisparityMap(disparity - PLANTED_PX))
        write_raw_calib(root, rig())
        (root / CAM_TO_CAM).rename(training / "calib_cam_to_cam" / f"{number:06d}.txt")
    return root


def planes(*, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Left and right BGR picture and the disparity between them, 7 to 31 px."""
    rng = np.random.default_rng(seed)
    texture = cv2.GaussianBlur(rng.normal(0, 1, (HEIGHT_PX, WIDTH_PX + 64)), (0, 0), 1.2)
    texture = np.clip(128 + 120 * texture, 0, 255).astype(np.float32)
    column, row = np.meshgrid(np.arange(WIDTH_PX), np.arange(HEIGHT_PX))
    disparity = (7 + 18 * row / HEIGHT_PX + 6 * column / WIDTH_PX).astype(np.float32)
    # Column u - d of the right picture is column u of the left; 40 columns of margin.
    left = cv2.remap(
        texture,
        (column + 40 - disparity).astype(np.float32),
        row.astype(np.float32),
        cv2.INTER_CUBIC,
    )
    noisy = [
        np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)
        for image in (left, texture[:, 40 : 40 + WIDTH_PX])
    ]
    return (*(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) for image in noisy), disparity)


def job(scene: Path, **changes) -> Evaluate:
    return replace(Evaluate("disparity", KittiStereo(str(scene))), **changes)


def test_every_figure_of_a_source_with_truth(scene):
    report = run(job(scene))
    figures = report.as_dict()
    assert report.exit_code == 0
    assert (figures["frames"], figures["d1_est"]) == (FRAMES, pytest.approx(0, abs=0.01))
    assert figures["density"] > 0.8
    assert figures["epe"] == pytest.approx(PLANTED_PX, abs=0.1)
    assert figures["d1_filled"] < 0.02
    assert figures["within_1_sigma"] == pytest.approx(0.68, abs=0.1)
    assert 0 < figures["seconds_per_frame"] < 10
    stock = {row["from_m"]: row for row in figures["depth"]}
    refined = {row["from_m"]: row for row in figures["depth_refined"]}
    for near in (5, 10):
        assert stock[near]["n"] == refined[near]["n"] > 1000
        assert stock[near]["bias_rel"] < -0.015
        assert abs(refined[near]["bias_rel"]) < 0.005
    assert refined[50] == dict.fromkeys(refined[50]) | {"from_m": 50, "to_m": 80, "n": 0}


def test_one_json_object_with_the_agreed_names(scene, capsys):
    assert main(["evaluate", "disparity", str(scene), "--matcher", "census", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert [name for name in FIGURES if name not in figures] == []


def test_a_readable_table(scene, capsys):
    assert main(["evaluate", "disparity", str(scene), "--frames", "0:2"]) == 0
    text = capsys.readouterr().out
    for words in ("D1 of matched pixels", "KITTI stereo", "within one sigma", "50-80 m"):
        assert words in text


def test_a_single_frame_cannot_be_fitted_and_judged(scene, capsys):
    assert main(["evaluate", "disparity", str(scene), "--frames", "1:2", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["frames"] == 1
    assert figures["within_1_sigma"] is figures["within_95"] is figures["depth_refined"] is None
    assert figures["within_1_sigma_raw"] is not None


def test_the_correction_of_a_given_rig_is_not_used(scene, tmp_path):
    wrong = DisparityCorrection(np.array([5.0] + [0.0] * 9), 3.0)
    write_rig(tmp_path / "rig.json", rig().with_correction(wrong))
    figures = run(job(scene, rig=tmp_path / "rig.json")).as_dict()
    plain = run(job(scene)).as_dict()
    for name in ("epe", "within_1_sigma", "within_1_sigma_raw"):
        assert figures[name] == plain[name]
    assert figures["depth"] == plain["depth"]


def test_a_matcher_without_sigma(scene):
    figures = run(job(scene, matcher=Sgbm())).as_dict()
    assert figures["within_1_sigma"] is figures["within_1_sigma_raw"] is figures["ause"] is None
    assert figures["density"] > 0.7
    assert any(row["n"] for row in figures["depth_refined"])


def test_same_figures_for_any_number_of_workers(scene):
    one, two = (run(job(scene, workers=workers)).as_dict() for workers in (1, 2))
    assert one | {"seconds_per_frame": 0} == two | {"seconds_per_frame": 0}


def test_a_bad_frame_is_skipped_and_told(scene, tmp_path, capsys):
    copy = tmp_path / "copy"
    for path in scene.rglob("*.*"):
        target = copy / path.relative_to(scene)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(path.read_bytes())
    picture = copy / "training" / "image_3" / "000002_10.png"
    picture.write_bytes(picture.read_bytes()[: picture.stat().st_size // 2])
    assert main(["evaluate", "disparity", str(copy), "--json"]) == 4
    figures = json.loads(capsys.readouterr().out)
    assert figures["frames"] == FRAMES - 1
    assert [bad["id"] for bad in figures["skipped"]] == ["000002_10"]


def test_disparity_maps_need_a_reference_and_find_it(scene, capsys):
    truth = scene / "training" / "disp_occ_0"
    with pytest.raises(UsageError, match="reference"):
        run(job(scene, source=Maps(truth)))
    assert main(["evaluate", "disparity", str(truth), "--reference", str(truth), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert (figures["frames"], figures["epe"], figures["density"]) == (FRAMES, 0.0, 1.0)
    assert figures["within_1_sigma"] is figures["seconds_per_frame"] is None


@pytest.mark.real
def test_a_source_without_truth_is_refused(real_data, capsys):
    folder = real_data / "kitti_raw"
    with pytest.raises(ReferenceMissing):
        run(replace(job(folder), source=KittiRaw(str(folder))))
    assert main(["evaluate", "disparity", str(folder), "--json"]) == 3
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "ReferenceMissing"


@pytest.mark.real
def test_the_known_answer_of_the_devkit(real_data, capsys):
    folder = real_data / "devkit_disparity"
    arguments = [str(folder / "disp_est.png"), "--reference", str(folder / "disp_gt.png")]
    assert main(["evaluate", "disparity", *arguments, "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["bad_3"] == pytest.approx(0.04393, abs=5e-6)
    assert figures["d1_est"] == pytest.approx(0.04392, abs=5e-6)
    assert figures["epe"] == pytest.approx(0.697, abs=5e-4)
