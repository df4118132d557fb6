"""Layouts of other tools, read back as those tools document them."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.geometry.quaternion import rotation_of
from pseudolidar.sources.kitti.object import KittiObject
from pseudolidar.sources.synthetic import Synthetic

STREET = ("synthetic:street", "--source.width-px", "400", "--source.frames", "4")


def convert(capsys, *args):
    code = main(["convert", *map(str, args), "--json"])
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return code, json.loads(captured.out)


def files(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def inside(xyz, box, T_box_frame):
    """(N,) points of the frame inside a box."""
    at = T_box_frame.apply(xyz.astype(np.float64))
    half = 0.5 * np.array([box.length_m, box.width_m, box.height_m])
    return (np.abs(at) <= half * 1.05).all(axis=1)


def points_in_boxes(frame):
    """Points inside each labelled, unoccluded, whole car nearer than 25 m."""
    counts = []
    for label in frame.labels:
        near = label.box is not None and 0 < label.box.pose.translation_m[2] < 25
        whole = not label.occlusion and (label.truncation or 0) < 0.2
        if near and whole and label.detection.name == "Car":
            T_box_velodyne = label.box.pose.inverse() @ frame.rig.T_left_velodyne
            counts.append(int(inside(frame.scan.xyz, label.box, T_box_velodyne).sum()))
    return counts


# --- KITTI object -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def street_tree(tmp_path_factory):
    """One run for both layouts."""
    out = tmp_path_factory.mktemp("tree")
    args = ("--to", "kitti,colmap,depth", "--colmap.points", "4000")
    assert main(["convert", *STREET[:1], str(out), *STREET[1:], *args]) == 0
    return out


def test_the_tree_is_read_back_with_points_inside_the_labels(street_tree):
    source = KittiObject(str(street_tree / "kitti")).open()
    assert len(source.ids) == 4
    original = Synthetic("street", frames=4, width_px=400).open()
    counts = []
    for index in range(0, 4, 2):
        frame, was = source.load(index), original.load(index)
        assert np.array_equal(frame.left, was.left)
        assert np.array_equal(frame.right, was.right)
        assert np.allclose(frame.rig.P_right, was.rig.P_right)
        assert len(frame.labels) == len(was.labels)
        for mine, theirs in zip(frame.labels, was.labels, strict=True):
            if theirs.box is not None:  # the format has no roll and no pitch
                centres = mine.box.pose.translation_m, theirs.box.pose.translation_m
                assert np.allclose(*centres, atol=1e-6)
                assert mine.box.length_m == pytest.approx(theirs.box.length_m)
        counts += points_in_boxes(frame)
    assert counts
    assert np.mean(np.array(counts) > 20) > 0.8


def test_the_files_are_as_other_loaders_expect(street_tree):
    """What OpenPCDet and MMDetection3D rely on: rows by their number, four floats a point."""
    root = street_tree / "kitti"
    sets = {
        name: (root / "ImageSets" / f"{name}.txt").read_text().split()
        for name in ("train", "val", "trainval", "test")
    }
    assert sets["trainval"] == [f"{i:06d}" for i in range(4)]
    assert set(sets["train"]).isdisjoint(sets["val"])
    assert set(sets["train"]) | set(sets["val"]) <= set(sets["trainval"])
    assert sets["test"] == []
    for number in sets["trainval"]:
        points = np.fromfile(root / "training/velodyne" / f"{number}.bin", np.float32)
        points = points.reshape(-1, 4)
        assert np.isfinite(points).all()
        assert (points[:, 0] >= 0).all()
        assert len(points) > 1000
        rows = (root / "training/calib" / f"{number}.txt").read_text().splitlines()
        keys = [row.split(":")[0] for row in rows]
        projections = ["P0", "P1", "P2", "P3"]
        assert keys == [*projections, "R0_rect", "Tr_velo_to_cam", "Tr_imu_to_velo"]
        lengths = [len(row.split(" ")[1:]) for row in rows]
        assert lengths == [12, 12, 12, 12, 9, 12, 12]
        # Points project into the picture by P2 @ R0_rect @ Tr_velo_to_cam.
        P2, R0, Tr = (np.array(rows[i].split(" ")[1:], float) for i in (2, 4, 5))
        camera = (Tr.reshape(3, 4) @ np.c_[points[:, :3], np.ones(len(points))].T).T
        u, v, w = P2.reshape(3, 4) @ np.c_[(R0.reshape(3, 3) @ camera.T).T, np.ones(len(points))].T
        image = cv2.imread(str(root / "training/image_2" / f"{number}.png"))
        assert ((u / w > -1) & (u / w < image.shape[1])).mean() > 0.999
        assert ((v / w > -1) & (v / w < image.shape[0])).mean() > 0.999
        for line in (root / "training/label_2" / f"{number}.txt").read_text().splitlines():
            assert len(line.split(" ")) == 15


def test_beams_thin_the_clouds(tmp_path, capsys):
    sizes = []
    for beams in ("64", "16"):
        out = tmp_path / beams
        args = ("--to", "kitti", "--beams", beams, "--kitti.no-images", "--frames", "0:1")
        assert convert(capsys, STREET[0], out, *STREET[1:], *args)[0] == 0
        assert not (out / "kitti/training/image_2").exists()
        sizes.append((out / "kitti/training/velodyne/000000.bin").stat().st_size / 16)
    assert 2.5 < sizes[0] / sizes[1] < 6
    assert 500 < sizes[0] < 64 * 530


def test_pictures_without_labels_are_the_test_set(drive, tmp_path, capsys):
    """Without a Velodyne the left camera stands in for it."""
    out = tmp_path / "out"
    assert convert(capsys, drive, out, "--to", "kitti", "--frames", "2:8")[0] == 0
    root = out / "kitti"
    assert not (root / "training").exists()
    numbers = (root / "ImageSets/test.txt").read_text().split()
    assert numbers == [f"{i:06d}" for i in range(2, 8)]  # its ids have six digits
    assert (root / "ImageSets/trainval.txt").read_text() == ""
    frame = KittiObject(str(root)).open().load(0)
    assert frame.labels is None
    assert np.median(frame.scan.xyz[:, 0]) == pytest.approx(100 * 0.5 / 9, rel=0.05)
    assert (root / "frames.csv").read_text().splitlines()[1] == "000002,000002,test"


def test_any_number_of_workers_and_a_second_run_leave_the_same_files(drive, tmp_path, capsys):
    args = ("--to", "kitti", "--frames", "0:5")
    assert convert(capsys, drive, tmp_path / "a", *args, "--workers", "1")[0] == 0
    assert convert(capsys, drive, tmp_path / "b", *args, "--workers", "3")[0] == 0
    before = files(tmp_path / "a" / "kitti")
    assert before == files(tmp_path / "b" / "kitti")
    # A file that was lost is made again, alone; the lists are joined anew.
    (tmp_path / "a/kitti/testing/velodyne/000003.bin").unlink()
    (tmp_path / "a/kitti/ImageSets/test.txt").write_text("damaged")
    code, report = convert(capsys, drive, tmp_path / "a", *args)
    assert (code, report["frames"]) == (0, 5)
    assert files(tmp_path / "a" / "kitti") == before


@pytest.mark.real
def test_a_real_tree_has_points_in_the_labels(real_data, tmp_path, capsys):
    out = tmp_path / "out"
    source = real_data / "kitti_object" / "training"
    args = ("--to", "kitti", "--beams", "64", "--frames", "000035,000041,000047,000130")
    assert convert(capsys, source, out, *args)[0] == 0
    tree = KittiObject(str(out / "kitti")).open()
    counts = [n for index in range(len(tree.ids)) for n in points_in_boxes(tree.load(index))]
    assert counts
    assert min(counts) > 0


# --- COLMAP -------------------------------------------------------------------------------------


def read_model(root):
    """Cameras, images and points by the documented text format."""

    def lines(name):
        text = (root / "sparse/0" / name).read_text().splitlines()
        return [line for line in text if not line.startswith("#")]

    cameras = {}
    for line in lines("cameras.txt"):
        number, model, width, height, *parameters = line.split()
        assert model == "PINHOLE"
        cameras[int(number)] = (int(width), int(height), list(map(float, parameters)))
    images, rows = {}, lines("images.txt")
    for head, pixels in zip(rows[::2], rows[1::2], strict=True):
        number, *pose, camera, name = head.split()
        observed = np.array(pixels.split(), float).reshape(-1, 3)
        images[int(number)] = (np.array(pose, float), int(camera), name, observed)
    points = {}
    for line in lines("points3D.txt"):
        number, x, y, z, r, g, b, error, *track = line.split()
        colour = tuple(map(int, (r, g, b)))
        pairs = list(zip(map(int, track[::2]), map(int, track[1::2]), strict=True))
        points[int(number)] = (np.array([x, y, z], float), colour, float(error), pairs)
    return cameras, images, points


def check_model(root, *, reprojection_px=0.5):
    cameras, images, points = read_model(root)
    for number, (pose, camera, name, observed) in images.items():
        width, height, (fx, fy, cx, cy) = cameras[camera]
        picture = cv2.imread(str(root / "images" / name))
        assert picture.shape[:2] == (height, width)
        xyz = np.array([points[int(p)][0] for p in observed[:, 2]])
        x, y, z = rotation_of(pose[:4]) @ xyz.T + pose[4:, None]
        seen = np.stack([fx * x / z + cx, fy * y / z + cy], axis=1)
        off = np.linalg.norm(seen - observed[:, :2], axis=1)
        assert (z > 0).all()
        assert off.max() < reprojection_px
        for index, point in enumerate(observed[:, 2].astype(int)):
            assert (number, index) in points[point][3]
        if name.startswith("left"):  # colours are those of the picture
            # The centre of the first pixel is at 0.5, and so is every matched pixel's.
            assert np.allclose(observed[:, :2] % 1, 0.5)
            u, v = np.floor(observed[:, :2]).astype(int).T
            colours = np.array([points[int(p)][1] for p in observed[:, 2]])
            assert np.array_equal(picture[v, u][:, ::-1], colours)
    return cameras, images, points


def test_a_model_projects_back_to_its_pixels(street_tree):
    cameras, images, points = check_model(street_tree / "colmap")
    assert len(images) == 8
    rig = Synthetic("street", frames=4, width_px=400).open().rig
    centre = (rig.left.K[:2, 2] + 0.5).tolist()
    assert next(iter(cameras.values()))[2][2:] == pytest.approx(centre)
    assert 700 < len(points) <= 4000
    tracks = [len(track) for *_, track in points.values()]
    assert np.mean(np.array(tracks) == 2) > 0.8


def test_frames_agree_in_the_world(street_tree):
    """A point of one frame falls onto the surface that another frame sees there."""
    cameras, images, points = read_model(street_tree / "colmap")
    first, second = images[1], images[7]
    assert (first[2], second[2]) == ("left/000000.png", "left/000003.png")
    width, height, (fx, fy, cx, cy) = cameras[second[1]]
    xyz = np.array([points[int(p)][0] for p in first[3][:, 2]])
    x, y, z = rotation_of(second[0][:4]) @ xyz.T + second[0][4:, None]
    u, v = np.floor([fx * x / z + cx, fy * y / z + cy]).astype(int)
    depth = cv2.imread(str(street_tree / "depth/000003.png"), cv2.IMREAD_UNCHANGED) / 256
    shown = (u >= 0) & (v >= 0) & (u < width) & (v < height) & (z > 0)
    there = depth[v[shown], u[shown]]
    off = np.abs(there - z[shown])[there > 0] / z[shown][there > 0]
    # 1.7 %; 5.7 % where the motion between the two frames is left out.
    assert np.quantile(off, 0.75) < 0.03


def test_frames_without_poses_are_refused_each_with_the_reason(drive, tmp_path, capsys):
    out = tmp_path / "out"
    code, _report = convert(capsys, drive, out, "--to", "colmap", "--frames", "0:3")
    assert code != 0
    skipped = json.loads((out / "report.json").read_text())["skipped"]
    assert {skip["code"] for skip in skipped} == {"PoseMissing"}
    assert not list((out / "colmap").rglob("*.txt")) if (out / "colmap").exists() else True


def test_clouds_without_pictures_make_no_tree(drive, tmp_path, capsys):
    assert convert(capsys, drive, tmp_path / "clouds", "--to", "npz", "--frames", "0:2")[0] == 0
    code, report = convert(capsys, tmp_path / "clouds" / "npz", tmp_path / "out", "--to", "kitti")
    assert code != 0
    assert "NoPairs" in json.dumps(report) + (tmp_path / "out/report.json").read_text()


@pytest.mark.real
def test_a_real_drive_projects_back_to_its_pixels(real_data, tmp_path, capsys):
    out = tmp_path / "out"
    args = ("--to", "colmap", "--colmap.points", "3000", "--frames", "0:3")
    assert convert(capsys, real_data / "kitti_raw" / "2011_09_26", out, *args)[0] == 0
    _cameras, images, _points = check_model(out / "colmap")
    assert len(images) == 6
