"""compare on KITTI: distances between clouds, against a search of another library."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.geometry.open3d_library import load_open3d

SIZE_PX = 1242, 375
NEAR_M, FAR_M = 5.0, 80.0


def told(capsys: pytest.CaptureFixture[str], *args: object) -> dict:
    capsys.readouterr()
    assert main([*map(str, args), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def calibration(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """P2 (3, 4), and (4, 4) from the Velodyne to the rectified left colour camera."""
    lines = dict(line.split(": ", 1) for line in path.read_text().splitlines() if ":" in line)
    values = {name: np.array(text.split(), float) for name, text in lines.items()}
    P2 = values["P2"].reshape(3, 4)
    to_cam0 = values["R0_rect"].reshape(3, 3) @ values["Tr_velo_to_cam"].reshape(3, 4)
    T = np.vstack([to_cam0, [0, 0, 0, 1]])
    T[:3, 3] += np.linalg.solve(P2[:, :3], P2[:, 3])
    return P2, T


def pixels(xyz: np.ndarray, P2: np.ndarray) -> np.ndarray:
    return np.rint((xyz @ P2[:, :3].T)[:, :2] / xyz[:, 2:]).astype(int)


def in_picture(xyz: np.ndarray, P2: np.ndarray) -> np.ndarray:
    uv = pixels(xyz, P2)
    return (xyz[:, 2] > 0) & (uv >= 0).all(axis=1) & (uv < SIZE_PX).all(axis=1)


def not_hidden(xyz: np.ndarray, P2: np.ndarray) -> np.ndarray:
    """Points that none within 4 columns, from 6 rows above to 2 below, precedes by 10 %."""
    u, v = pixels(xyz, P2).T
    kept = np.ones(len(xyz), bool)
    for i in range(len(xyz)):
        beside = (np.abs(u - u[i]) <= 4) & (v - v[i] >= -6) & (v - v[i] <= 2)
        kept[i] = xyz[beside, 2].min() >= 0.9 * xyz[i, 2]
    return kept


def nearest_m(asked: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Distance of each point to the nearest one of the others, as Open3D finds it."""
    open3d = load_open3d()
    clouds = [open3d.geometry.PointCloud(open3d.utility.Vector3dVector(x)) for x in (asked, others)]
    return np.asarray(clouds[0].compute_point_cloud_distance(clouds[1]))


def between(xyz: np.ndarray) -> np.ndarray:
    length_m = np.linalg.norm(xyz, axis=1)
    return xyz[(length_m >= NEAR_M) & (length_m < FAR_M)]


@pytest.mark.real
def test_distances_are_those_that_another_library_finds(real_data, tmp_path, capsys):
    source, out = real_data / "kitti_object", tmp_path / "out"
    clouds = told(capsys, "compare", source, out, "--to", "npz")["clouds"]
    (path,) = (out / "npz").iterdir()
    root = source / "training"
    P2, T_left_velodyne = calibration(root / "calib" / f"{path.stem}.txt")

    def in_left(xyz: np.ndarray) -> np.ndarray:
        return xyz.astype(float) @ T_left_velodyne[:3, :3].T + T_left_velodyne[:3, 3]

    stereo = in_left(np.load(path)["xyz"])
    scan = in_left(np.fromfile(root / "velodyne" / f"{path.stem}.bin", "<f4").reshape(-1, 4)[:, :3])
    scan = scan[in_picture(scan, P2)]
    scan = scan[not_hidden(scan, P2)]
    # of stereo, what has beams around it: some within 3 rows and columns
    beams = np.zeros((SIZE_PX[1] + 6, SIZE_PX[0] + 6), bool)
    column, row = pixels(scan, P2).T
    for dy in range(7):
        for dx in range(7):
            beams[row + dy, column + dx] = True
    column, row = pixels(stereo, P2).T
    judged = stereo[
        in_picture(stereo, P2) & beams[np.clip(row, 0, 374) + 3, column.clip(0, 1241) + 3]
    ]

    scan_there, judged = between(scan), between(judged)
    completeness, accuracy = nearest_m(scan_there, stereo), nearest_m(judged, scan)
    assert clouds["reference_points"] == len(scan_there)
    assert clouds["completeness_m"] == pytest.approx(completeness.mean(), rel=1e-3)
    assert clouds["completeness_median_m"] == pytest.approx(np.median(completeness), rel=1e-3)
    # which points of ours are judged, and so accuracy, is not the same to the pixel
    assert clouds["accuracy_m"] == pytest.approx(accuracy.mean(), rel=0.05)
    assert clouds["accuracy_median_m"] == pytest.approx(np.median(accuracy), rel=0.05)
    for radius_m, name in ((0.1, "0_1"), (0.2, "0_2"), (0.5, "0_5")):
        precision, recall = np.mean(accuracy <= radius_m), np.mean(completeness <= radius_m)
        assert clouds[f"precision_{name}"] == pytest.approx(precision, abs=0.02)
        assert clouds[f"recall_{name}"] == pytest.approx(recall, abs=1e-3)
        score = 2 * precision * recall / (precision + recall)
        assert clouds[f"f_score_{name}"] == pytest.approx(score, abs=0.01)


@pytest.mark.real
def test_a_comparison_and_an_evaluation_of_the_same_clouds_agree(real_data, tmp_path, capsys):
    source = (real_data / "kitti_raw", "--frames", "0,9")
    alone = told(capsys, "evaluate", "cloud", *source)
    here = told(capsys, "compare", *source, "--out", tmp_path / "out", "--to", "none")["clouds"]
    assert here == json.loads((tmp_path / "out" / "compare.json").read_text())["clouds"]
    assert {name: alone[name] for name in here} == here
    # farther is worse, and near the cloud lies within a hand's width of the scan
    bins = here["bins"]
    medians = [each["accuracy_median_m"] for each in bins]
    assert medians == sorted(medians)
    assert medians[0] < 0.1
    scores = [each["f_score_0_2"] for each in bins]
    assert scores == sorted(scores, reverse=True)
    assert scores[0] > 0.95


@pytest.mark.real
def test_ground_truth_is_no_cloud(real_data, capsys):
    source = (real_data / "kitti_stereo2015", "--frames", "0::11")
    assert told(capsys, "compare", *source, "--reference", "truth")["clouds"] is None
    assert told(capsys, "compare", *source)["clouds"]["frames"] == 2
