"""`info` on everything that the program knows, and on what it does not."""

import json
import os
import subprocess
import sys
import time

import cv2
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from pseudolidar.cli import main
from pseudolidar.formats.euroc_poses import write_euroc_trajectory
from pseudolidar.formats.pictures.disparity_png import write_disparity_png
from pseudolidar.formats.points.npz import write_npz
from pseudolidar.formats.points.pcd import write_pcd
from pseudolidar.formats.points.ply import write_ply
from pseudolidar.formats.trajectory import write_kitti_poses
from pseudolidar.formats.tum import write_tum_trajectory
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DisparityMap
from tests.recordings import named_clouds, write_own


def info(capsys, *paths):
    """Exit code and the entries of `--json`; the text for people must not fail either."""
    code = main(["info", *map(str, paths)])
    text = capsys.readouterr()
    assert "Traceback" not in text.err
    assert main(["info", *map(str, paths), "--json"]) == code
    return code, json.loads(capsys.readouterr().out)["paths"], text.out


def one(capsys, path, *options):
    code, (found,), text = info(capsys, path, *options)
    assert code == 0, found
    return found, text


def cloud(index=0, **columns):
    xyz = np.random.default_rng(1).uniform(1, 9, (50, 3)).astype(np.float32)
    return PointCloud(xyz, "velodyne", 1_500_000_000_123_456_789 + index * 10**8, **columns)


def test_pairs(drive, capsys):
    found, text = one(capsys, drive)
    assert (found["kind"], found["frames"]["count"], found["files"]) == ("folders", 14, 29)
    rig = found["rig"]
    assert (rig["f_px"], rig["baseline_m"], rig["fB_px_m"]) == (100.0, 0.5, 50.0)
    assert (rig["depth_at_1_px_m"], rig["width_px"], rig["height_px"]) == (50.0, 128, 64)
    assert (found["times"]["rate_hz"], found["times"]["synthetic"]) == (pytest.approx(10), True)
    for part in ("f 100.0000 px, B 0.50000 m", "14 pairs", "10 Hz, made up"):
        assert part in text


def test_pictures_without_calibration(own_drive, capsys):
    (own_drive / "rig.json").unlink()
    found, text = one(capsys, own_drive)
    assert found["frames"]["count"] == 6
    assert found["pictures"] == {"width_px": 128, "height_px": 64}
    (unknown,) = found["unknown"]
    assert unknown["code"] == "CalibrationMissing"
    assert f"CalibrationMissing: {own_drive / 'rig.json'}: no such file" in text
    assert "pictures  128x64 px" in text


@pytest.mark.parametrize("write", [write_pcd, write_ply, write_npz])
def test_a_cloud(tmp_path, capsys, write):
    path = tmp_path / f"a.{write.__name__[-3:]}"
    write(path, cloud(intensity=np.full(50, 0.5, np.float32)))
    found, text = one(capsys, path)
    assert found["kind"] == "cloud-files"
    assert found["first_file"]["points"] == 50
    names = [column["name"] for column in found["columns"]]
    assert names[0] in ("x", "xyz")
    assert {"name": "intensity", "dtype": "float32"} in found["columns"]
    assert "figures" not in found
    assert found["times"]["first_s"] == pytest.approx(1.5e9)
    assert "2017-07-14" in text


def test_deep_reads_all_values(tmp_path, capsys):
    folder = tmp_path / "clouds"
    folder.mkdir()
    for index in range(3):
        heat = np.linspace(index, index + 1, 50, dtype=np.float32)
        heat[:10] = np.nan
        write_pcd(folder / f"{index}.pcd", cloud(index, extra={"heat": heat}))
    write_pcd(folder / "3.pcd", cloud(3))
    (folder / "3.pcd").write_bytes((folder / "3.pcd").read_bytes()[:-9])
    found, text = one(capsys, folder, "--deep")
    assert found["read"] == {"good": 3, "bad": 1}
    assert found["bad_frames"][0].startswith("3 (PointFileTruncated")
    heat = next(c for c in found["figures"]["columns"] if c["name"] == "heat")
    assert (heat["count"], heat["max"]) == (150, 3.0)
    assert heat["nan_share"] == pytest.approx(0.2)
    xyz = cloud().xyz
    box = found["figures"]["bounding_box_m"]
    assert box["x"] == pytest.approx([xyz[:, 0].min(), xyz[:, 0].max()])
    ranges = np.linalg.norm(xyz, axis=1)
    assert found["figures"]["range_m"] == pytest.approx([ranges.min(), ranges.max()])
    assert "PointFileTruncated" in text


def test_times_and_gaps(tmp_path, capsys):
    folder = tmp_path / "clouds"
    folder.mkdir()
    for index in range(6):
        write_ply(folder / f"{index}.ply", PointCloud(np.zeros((1, 3), np.float32), "velodyne"))
    (folder / "times.txt").write_text("0.0\n0.1\n0.2\n0.9\n1.0\n1.1\n")
    found, text = one(capsys, folder)
    assert found["times"]["rate_hz"] == pytest.approx(10)
    assert found["times"]["span_s"] == pytest.approx(1.1)
    (gap,) = found["times"]["gaps"]
    assert (gap["after"], gap["seconds"]) == ("2", pytest.approx(0.7))
    assert "1 gap: 0.70 s after 2" in text


def test_what_a_run_has_written(drive, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["convert", str(drive), str(out), "--to", "pcd,mcap", "--frames", "0:3"]) == 0
    capsys.readouterr()
    found, text = one(capsys, out)
    assert found["kind"] == "run"
    assert found["run"]["committed"] == 3
    assert {(item["name"], item["files"]) for item in found["written"]} == {
        ("pcd", 3), ("tiny.mcap", 1),
    }  # fmt: skip
    assert "output of convert: 3 of 3 frames" in text
    recording, text = one(capsys, out / "tiny.mcap")
    topics = {row["topic"]: row for row in recording["topics"]}
    assert topics["/stereo/points"]["type"] == "foxglove.PointCloud"
    assert topics["/stereo/points"]["messages"] == 3
    assert topics["/stereo/points"]["rate_hz"] == pytest.approx(10)
    assert recording["frames"]["count"] == 3
    assert "/stereo/points" in text
    deep, _ = one(capsys, out / "tiny.mcap", "--deep")
    assert deep["figures"]["clouds"] == 3


def test_single_files(drive, tmp_path, capsys):
    wide = tmp_path / "wide.png"
    cv2.imwrite(str(wide), np.zeros((30, 40, 3), np.uint8))
    disparity = tmp_path / "disparity.png"
    values = np.full((30, 40), 5.0, np.float32)
    values[:15] = np.nan
    write_disparity_png(disparity, DisparityMap(values))
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 2, 3] = (0, 1, 3)
    write_kitti_poses(tmp_path / "kitti.txt", poses)
    write_tum_trajectory(tmp_path / "tum.txt", [10**9, 2 * 10**9, 3 * 10**9], poses)
    write_euroc_trajectory(tmp_path / "euroc.csv", [10**9, 2 * 10**9, 3 * 10**9], poses)
    (tmp_path / "times.txt").write_text("0\n0.5\n1.0\n")
    (tmp_path / "label.txt").write_text(
        "Car 0.00 0 -1.58 587.01 173.33 614.12 200.12 1.65 1.67 3.64 -0.65 1.71 46.70 -1.59\n"
    )
    (tmp_path / "K.txt").write_text("100 0 63.5 0 100 31.5 0 0 1\n0.5\n")
    graph = helper.make_graph(
        [helper.make_node("Identity", ["a"], ["b"])],
        "net",
        [helper.make_tensor_value_info("a", TensorProto.FLOAT, [1, 3, 8, 8])],
        [helper.make_tensor_value_info("b", TensorProto.FLOAT, [1, 3, 8, 8])],
    )
    onnx.save(helper.make_model(graph), tmp_path / "net.onnx")
    names = ("wide.png", "disparity.png", "kitti.txt", "tum.txt", "euroc.csv", "times.txt",
             "label.txt", "K.txt", "net.onnx")  # fmt: skip
    code, found, text = info(capsys, *(tmp_path / n for n in names), drive / "rig.json")
    assert code == 0
    kinds = [each["kind"] for each in found]
    assert kinds == ["picture", "picture", "trajectory", "trajectory", "trajectory",
                     "times", "labels", "calibration", "network", "calibration"]  # fmt: skip
    by_name = dict(zip((*names, "rig.json"), found, strict=True))
    assert (by_name["wide.png"]["width_px"], by_name["wide.png"]["bits"]) == (40, 8)
    assert (by_name["kitti.txt"]["poses"], by_name["kitti.txt"]["path_m"]) == (3, 3.0)
    assert by_name["kitti.txt"]["times"]["span_s"] == 1.0  # of times.txt
    for name, form in (("tum.txt", "TUM"), ("euroc.csv", "EuRoC")):
        assert form in by_name[name]["what"]
        assert by_name[name]["times"]["rate_hz"] == 1.0
        assert by_name[name]["mean_speed_m_s"] == 1.5
        assert by_name[name]["largest_speed_m_s"] == 2.0
    assert "largest speed, m/s" in text
    assert by_name["times.txt"]["times"]["span_s"] == 1.0
    assert by_name["label.txt"]["objects"] == {"Car": 1}
    assert by_name["K.txt"]["rig"]["width_px"] is None
    assert by_name["K.txt"]["rig"]["baseline_m"] == pytest.approx(0.5)
    assert by_name["rig.json"]["rig"]["width_px"] == 128
    assert "float32[1,3,8,8]" in by_name["net.onnx"]["inputs"][0]
    assert text.count("on disk") == len(found)
    deep, _ = one(capsys, disparity, "--deep")
    assert deep["figures"]["density"] == 0.5
    assert deep["figures"]["if_kitti_disparity_px"] == [5.0, 5.0]


def test_odd_things_stop_nothing(drive, tmp_path, capsys):
    (tmp_path / "noise.dat").write_bytes(np.random.default_rng(1).bytes(1000))
    (tmp_path / "cut.pcd").write_bytes(b"VERSION 0.7\nFIELDS x y")
    (tmp_path / "empty").mkdir()
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "bad.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(50))
    (tmp_path / "two\nlines").write_bytes(b"")
    odd = [tmp_path / n for n in ("noise.dat", "cut.pcd", "empty", "loop", "bad.mcap",
                                  "two\nlines", "absent")]  # fmt: skip
    code, found, text = info(capsys, *odd, drive)
    assert code == 3
    assert len(found) == 8
    assert found[-1]["frames"]["count"] == 14
    cut = found.pop(1)
    assert cut["frames"]["refused"][0]["code"] == "PointFileTruncated"
    assert all(each.get("unknown") or each.get("error") for each in found[:-1])
    assert "absent" in text
    assert "two\\nlines" in text


def test_a_folder_with_one_recording_has_its_topics(tmp_path, capsys):
    write_own(tmp_path / "drive.mcap", named_clouds(["a", "b"]))
    found, text = one(capsys, tmp_path)
    assert found["unknown"] == []
    assert {row["topic"]: row["messages"] for row in found["topics"]}["/points"] == 2
    assert "/points" in text


def test_a_folder_of_several_things_is_listed(drive, tmp_path, capsys):
    """A row for each folder and kind of file; what is no whole does not end it."""
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(tmp_path / name), np.zeros((30, 40, 3), np.uint8))
    (tmp_path / "times.txt").write_text("0\n0.5\n")
    (tmp_path / "notes.md").write_text("hello\n")
    (tmp_path / "drive").symlink_to(drive)
    (tmp_path / "inside").mkdir()
    write_pcd(tmp_path / "inside" / "x.pcd", cloud())
    os.mkfifo(tmp_path / "pipe")
    found, text = one(capsys, tmp_path)
    rows = {row["name"]: (row["kind"], row["things"], row["last"]) for row in found["entries"]}
    assert rows == {
        "a.png": ("picture", 2, "b.png"), "times.txt": ("times", 1, ""),
        "notes.md": ("unknown", 2, "pipe"), "drive": ("folders", 1, ""),
        "inside": ("cloud-files", 1, ""),
    }  # fmt: skip
    assert "14 pairs by equal names" in text
    assert "a picture, 40x30 px, 8 bits, colour" in text


@pytest.mark.parametrize("verb", ["info", "convert", "recover"])
def test_nobody_waits_for_a_pipe(tmp_path, verb):
    os.mkfifo(tmp_path / "pipe.mcap")
    out = [str(tmp_path / "out")] if verb != "info" else []
    line = [sys.executable, "-m", "pseudolidar.cli", verb, str(tmp_path / "pipe.mcap"), *out]
    ended = subprocess.run(line, capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 3
    assert "a named pipe" in ended.stdout + ended.stderr


def test_of_a_damaged_text_that_is_told_which_it_is_most_likely(tmp_path, capsys):
    poses = tmp_path / "poses.txt"
    row = "1 0 0 {} 0 1 0 0 0 0 1 0\n"
    poses.write_text("".join(row.format(n) for n in range(5)) + row.format("x"))
    labels = tmp_path / "labels.txt"
    car = "Car 0.00 0 -1.58 587.01 173.33 614.12 200.12 1.65 1.67 3.64 -0.65 1.71 46.70 -1.59\n"
    labels.write_text(car * 2 + "Car 1 2\n")
    prose = tmp_path / "prose.txt"
    prose.write_text("once upon a time\nthere was a camera\n")
    exchanged = tmp_path / "rig.yml"
    matrix = (
        "{}: !!opencv-matrix\n   rows: 3\n   cols: 4\n   dt: d\n"
        "   data: [ 100., 0., 63.5, {}, 0., 100., 31.5, 0., 0., 0., 1., 0. ]\n"
    )
    P1, P2 = matrix.format("P1", "0."), matrix.format("P2", "50.")
    exchanged.write_text(f"%YAML:1.0\n---\nimage_width: 128\nimage_height: 64\n{P1}{P2}")
    code, found, text = info(capsys, poses, labels, prose, exchanged)
    assert code == 3
    assert [each["what"] for each in found] == [
        "a file of kind 'trajectory' that cannot be used",
        "a file of kind 'labels' that cannot be used",
        "a file that is not read: text file",
        "a file of kind 'calibration' that cannot be used",
    ]
    assert [each["unknown"][0]["where"][:6] for each in found[:2]] == ["line 6", "line 3"]
    assert "it cannot be read as trajectory, labels, times, calibration" in text
    assert text.count("unknown") == 4, "one reason each"
    assert "exchanged" in text


def test_arrays_transforms_and_tables(tmp_path, capsys):
    np.savez(tmp_path / "a.npz", disparity=np.zeros((5, 7), np.float32))
    (tmp_path / "calib_velo_to_cam.txt").write_text(
        "calib_time: 15-Mar-2012 11:37:16\nR: 0 -1 0 1 0 0 0 0 1\nT: 0 0.3 0.4\n"
    )
    (tmp_path / "scan.txt").write_text("1 2 3 0.5\n4 5 6 0.5\n")
    packet = "49.0 8.4 116.4 0.03 0.01 -3.0 " + " ".join(["0"] * 24) + "\n"
    (tmp_path / "oxts.txt").write_text(packet)
    names = ("a.npz", "calib_velo_to_cam.txt", "scan.txt", "oxts.txt")
    code, (arrays, transform, table, imu), text = info(capsys, *(tmp_path / n for n in names))
    assert code == 0
    assert arrays["columns"] == [{"name": "disparity", "dtype": "float32", "shape": "5x7"}]
    assert transform["distance_m"] == pytest.approx(0.5)
    assert transform["rotation_deg"] == pytest.approx(90)
    assert (table["rows"], table["values_a_row"]) == (2, 4)
    assert (imu["kind"], imu["latitude_deg"]) == ("imu", 49.0)
    assert "2 rows of 4" in text


@pytest.mark.parametrize("arguments", [[], ["absent"]])
def test_nothing_to_look_at_is_an_error(capsys, arguments):
    assert main(["info", *arguments, "--json"]) == (3 if arguments else 2)
    assert json.loads(capsys.readouterr().out)["error"]["code"] in ("UsageError", "SourceUnknown")


def test_large_files_are_told_by_their_header(tmp_path):
    """A gigabyte of points: nothing of them is read."""
    path = tmp_path / "large.pcd"
    count = 80_000_000
    header = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {count}\nHEIGHT 1\nPOINTS {count}\nDATA binary\n"
    ).encode()
    with path.open("wb") as file:
        file.write(header)
        file.truncate(len(header) + 12 * count)
    begin_s = time.monotonic()
    line = [sys.executable, "-m", "pseudolidar.cli", "info", str(path), "--json"]
    ended = subprocess.run(line, capture_output=True, text=True, check=True)
    usage = json.loads(ended.stdout)["paths"][0]
    assert usage["first_file"]["points"] == count
    assert time.monotonic() - begin_s < 20
    assert os.path.getsize(path) == usage["bytes"]  # noqa: PTH202 - of the sparse file


@pytest.mark.real
@pytest.mark.slow
def test_everything_of_the_real_data(real_data, capsys):
    paths = [p for p in sorted(real_data.rglob("*")) if p.is_dir() or p.suffix not in {".png",
             ".jpg", ".bin"}]  # fmt: skip
    code = main(["info", *map(str, paths), "--json"])
    found = json.loads(capsys.readouterr().out)["paths"]
    assert code == 3, "licences and the like are nothing"
    by_name = {str(p.relative_to(real_data)): each for p, each in zip(paths, found, strict=True)}
    assert by_name["kitti_raw"]["frames"]["count"] == 10
    assert by_name["kitti_raw"]["rig"]["baseline_m"] == pytest.approx(0.53273, abs=1e-5)
    assert by_name["kitti_odometry"]["rig"]["f_px"] == pytest.approx(707.0912)
    assert by_name["kitti_object"]["frames"]["count"] == 11
    assert by_name["trajectories/KITTI_00_gt.txt"]["poses"] == 4541
    assert len(by_name["mcap/nav2_turtlebot.mcap"]["topics"]) == 4
    assert by_name["models/yolox_nano/yolox_nano.onnx"]["kind"] == "network"
    assert by_name["chessboard/swapped_640x512"]["frames"]["count"] == 25
