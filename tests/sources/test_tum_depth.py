"""Pictures with depth: TUM's layout and plain folders, paired by time or number, in metres."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.convert import Convert, run
from pseudolidar.errors import (
    CalibrationMissing,
    CalibrationSizeMismatch,
    CalibrationValue,
    ImageFormat,
    ImageMissing,
    MapScale,
    NoPairs,
    PoseFileError,
    SequenceTime,
    StructureError,
)
from pseudolidar.formats.pictures.depth_png import read_depth_png
from pseudolidar.formats.points.pcd import read_pcd
from pseudolidar.formats.points.velodyne_bin import read_velodyne_bin
from pseudolidar.formats.tum import read_tum_trajectory, write_tum_trajectory
from pseudolidar.geometry.depth import depth_map
from pseudolidar.geometry.frames import camera_tree, left_in_base_link
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.source import pairs_of
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.sources.timed_pairs import associate, nearest
from pseudolidar.sources.tum_depth import TumDepth
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import DepthFrame

SIZE = (160, 120)


@pytest.fixture(scope="module")
def frames() -> list[StereoFrame]:
    source = Synthetic("room", frames=3, width_px=SIZE[0]).open()
    return [source.load(index) for index in range(3)]


def stamp(frame: StereoFrame, late_ns: int = 0) -> str:
    time_ns = frame.timestamp_ns + late_ns
    return f"{time_ns // 10**9}.{time_ns % 10**9:09d}"[:-3]


def depth_of(frame: StereoFrame) -> np.ndarray:
    assert frame.truth is not None
    return depth_map(frame.truth, frame.rig).values


def write_depth(path: Path, depth_m: np.ndarray, steps: float) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    stored = np.round(np.nan_to_num(depth_m) * steps)
    stored[stored > 65535] = 0  # Replica's steps end at 10 m
    cv2.imwrite(str(path), stored.astype(np.uint16))


def write_picture(path: Path, frame: StereoFrame) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), cv2.cvtColor(np.asarray(frame.left), cv2.COLOR_RGB2BGR))


def write_k(path: Path, frame: StereoFrame) -> None:
    path.write_text(" ".join(repr(float(x)) for x in frame.rig.left.K.ravel()) + "\n")


def tum(folder: Path, frames: list[StereoFrame]) -> Path:
    """TUM's layout; depth is 4 ms late, its list is in another order, one depth is missing."""
    lists: dict[str, list[str]] = {"rgb": [], "depth": []}
    poses, times = [], []
    for index, frame in enumerate(frames):
        assert frame.pose is not None
        mine, theirs = stamp(frame), stamp(frame, 4_000_000)
        write_picture(folder / "rgb" / f"{mine}.png", frame)
        lists["rgb"].append(f"{mine} rgb/{mine}.png")
        if index != 1:
            write_depth(folder / "depth" / f"{theirs}.png", depth_of(frame), 5000)
            lists["depth"].insert(0, f"{theirs} depth/{theirs}.png")
        poses.append(frame.pose.matrix @ left_in_base_link(frame.rig).matrix)
        times.append(frame.timestamp_ns + 2_000_000)
    for name, rows in lists.items():
        (folder / f"{name}.txt").write_text("# timestamp filename\n" + "\n".join(rows) + "\n")
    write_tum_trajectory(folder / "groundtruth.txt", times, np.array(poses))
    write_k(folder / "K.txt", frames[0])
    return folder


def test_tum_is_paired_by_time_and_never_by_position(
    frames: list[StereoFrame], tmp_path: Path
) -> None:
    settings = recognise(str(tum(tmp_path, frames)))
    assert isinstance(settings, TumDepth)
    source = settings.open()
    assert source.ids == (stamp(frames[0]), stamp(frames[2]))
    ((name, error),) = source.refused
    assert (name, type(error)) == (stamp(frames[1]), ImageMissing)
    for index, frame in ((0, frames[0]), (1, frames[2])):
        got = source.load(index)
        assert got.timestamp_ns == frame.timestamp_ns
        np.testing.assert_array_equal(got.image, frame.left)
        # TUM's steps are 0.2 mm
        np.testing.assert_allclose(got.depth.values, depth_of(frame), atol=1.01e-4)
        assert got.pose is not None
        assert frame.pose is not None
        T_base_camera = camera_tree(got.camera)[-1]
        T_map_camera = frame.pose.matrix @ left_in_base_link(frame.rig).matrix
        np.testing.assert_allclose((got.pose @ T_base_camera).matrix, T_map_camera, atol=1e-12)
    assert TumDepth(str(tmp_path), tolerance_s=0.002).path
    with pytest.raises(Exception, match="no picture has a depth"):
        TumDepth(str(tmp_path), tolerance_s=0.002).open()


def test_clouds_in_the_map_lie_where_the_poses_say(
    frames: list[StereoFrame], tmp_path: Path
) -> None:
    folder = tum(tmp_path / "in", frames)
    whole = TumDepth(str(folder)).open().load(1)
    assert isinstance(whole, DepthFrame)
    run(Convert(TumDepth(str(folder)), tmp_path / "out", frame="map", workers=1))
    cloud = read_pcd(tmp_path / "out" / "pcd" / f"{whole.id}.pcd")
    assert cloud.frame == "map"
    assert frames[2].pose is not None
    T_map_camera = frames[2].pose.matrix @ left_in_base_link(frames[2].rig).matrix
    points = Reproject().load().of_depth(whole).xyz.astype(np.float64)
    want = points @ T_map_camera[:3, :3].T + T_map_camera[:3, 3]
    np.testing.assert_allclose(cloud.xyz, want, atol=1e-4)


def test_associations_may_have_depth_first(frames: list[StereoFrame], tmp_path: Path) -> None:
    folder = tum(tmp_path, frames)
    a, b = stamp(frames[2]), stamp(frames[2], 4_000_000)
    (folder / "associations.txt").write_text(f"{b} depth/{b}.png {a} rgb/{a}.png\n")
    source = TumDepth(str(folder)).open()
    assert source.ids == (a,)
    np.testing.assert_array_equal(source.load(0).image, frames[2].left)


def test_association_is_that_of_tums_script() -> None:
    first, second = [0, 10, 20, 100], [19, 1, 11, 12]
    assert associate(first, second, tolerance_ns=5) == [(0, 1), (1, 2), (2, 0)]
    assert associate([10], [4, 15], tolerance_ns=5) == [(0, 1)]
    assert associate([10, 12], [11], tolerance_ns=5) == [(0, 0)]
    assert associate([10, 12], [13], tolerance_ns=5) == [(1, 0)]  # the nearer one, though later
    assert nearest([1, 5, 9], 6, tolerance_ns=1) == 1
    assert nearest([1, 5, 9], 7, tolerance_ns=1) is None
    assert nearest([], 7, tolerance_ns=1) is None


PLAIN = {
    "realsense": ("color/{:04d}.png", "depth/{:04d}.png", "K.txt"),
    "scannet": ("color/{}.jpg", "depth/{}.png", "intrinsic/intrinsic_color.txt"),
    "replica": ("results/frame{:06d}.jpg", "results/depth{:06d}.png", "cam_params.json"),
    "own": ("image/{:03d}.png", "depth/{:03d}.pfm", "camera.json"),
}


def plain(folder: Path, kind: str, frames: list[StereoFrame]) -> tuple[Path, float]:
    colour, depth, camera = PLAIN[kind]
    K = frames[0].rig.left.K
    steps = 6553.5 if kind == "replica" else 1000.0
    for index, frame in enumerate(frames):
        write_picture(folder / colour.format(index), frame)
        place = folder / depth.format(index)
        if place.suffix == ".pfm":
            from pseudolidar.formats.pictures.pfm import write_pfm

            write_pfm(place, DisparityMap(depth_of(frame)))
        else:
            write_depth(place, depth_of(frame), steps)
    (folder / camera).parent.mkdir(exist_ok=True)
    if camera.endswith(".json"):
        numbers = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
        numbers |= {"w": SIZE[0], "h": SIZE[1]} | ({"scale": steps} if kind == "replica" else {})
        (folder / camera).write_text(json.dumps({"camera": numbers}))
    elif kind == "scannet":
        matrix = np.eye(4)
        matrix[:3, :3] = K
        np.savetxt(folder / camera, matrix)
    else:
        write_k(folder / camera, frames[0])
    return folder, steps


@pytest.mark.parametrize("kind", list(PLAIN))
def test_plain_folders(kind: str, frames: list[StereoFrame], tmp_path: Path) -> None:
    folder, steps = plain(tmp_path, kind, frames)
    settings = recognise(str(folder))
    assert isinstance(settings, TumDepth)
    source = settings.open()
    assert len(source.ids) == 3
    got = source.load(2)
    np.testing.assert_allclose(got.camera.K, frames[2].rig.left.K, rtol=1e-15)
    want = depth_of(frames[2])
    if kind == "replica":
        want[want * steps > 65535] = np.nan
    assert np.isfinite(want).mean() > 0.8
    np.testing.assert_allclose(got.depth.values, want, atol=0.51 / steps)
    with pytest.raises(NoPairs, match="pictures with depth"):
        pairs_of(source)


def test_the_cloud_is_that_of_the_exact_disparity(
    frames: list[StereoFrame], tmp_path: Path
) -> None:
    """Depth and disparity of one scene become the same points, column by column."""
    folder, _ = plain(tmp_path / "in", "own", frames)
    out = tmp_path / "out"
    report = run(
        Convert(TumDepth(str(folder)), out, to=Outputs.parse("pcd,depth,bin,npz,ply"), workers=1)
    )
    assert report.exit_code == 0
    frame = frames[1]
    assert frame.truth is not None
    want = Reproject().load()(frame, DisparityMap(frame.truth.values))
    got = read_pcd(out / "pcd" / "001.pcd")
    assert len(got) == len(want) == SIZE[0] * SIZE[1]
    np.testing.assert_allclose(got.xyz, want.xyz, rtol=2e-6, atol=2e-6)
    np.testing.assert_array_equal(got.rgb, want.rgb)
    np.testing.assert_array_equal(got.uv, want.uv)
    np.testing.assert_allclose(got.intensity, want.intensity, atol=1e-6)
    assert got.sigma_m is None
    assert got.frame == "camera_left"
    depth = read_depth_png(out / "depth" / "001.png").values
    np.testing.assert_allclose(depth, depth_of(frame), atol=0.51 / 256)
    scan = read_velodyne_bin(out / "bin" / "001.bin")
    np.testing.assert_allclose(scan.xyz[:, 0], got.xyz[:, 2])  # x forward is the optical axis


def test_gates_sigma_and_frame(frames: list[StereoFrame], tmp_path: Path) -> None:
    folder, _ = plain(tmp_path / "in", "own", frames)
    frame = TumDepth(str(folder)).open().load(0)
    reproject = Reproject(
        min_range_m=1.5, max_range_m=3.0, max_height_m=0.5, depth_sigma_rel=0.01
    ).load()
    cloud = reproject.of_depth(frame)
    assert isinstance(frame, DepthFrame)
    assert cloud.sigma_m is not None
    reach = np.linalg.norm(cloud.xyz, axis=1)
    assert 0 < len(cloud) < SIZE[0] * SIZE[1]
    assert reach.min() >= 1.5
    assert reach.max() <= 3.0
    assert (-cloud.xyz[:, 1]).max() <= 0.5
    # sigma of Z is 1 %, so that of the range is 1 % of the range
    np.testing.assert_allclose(cloud.sigma_m, 0.01 * reach, rtol=1e-5)
    organised = Reproject(organised=True, max_range_m=3.0).load().of_depth(frame)
    assert organised.shape == (SIZE[1], SIZE[0])
    far = np.linalg.norm(organised.xyz, axis=1) > 3.0
    assert not far.any()
    assert np.isnan(organised.xyz).any()
    thin = Reproject(voxel_m=0.5).load().of_depth(frame)
    assert 0 < len(thin) < 2000
    with pytest.raises(Exception, match="the depth has no sigma"):
        Reproject(max_sigma_m=0.1).load().of_depth(frame)
    out = tmp_path / "out"
    run(Convert(TumDepth(str(folder)), out, frame="base_link", workers=1))
    turned = read_pcd(out / "pcd" / "000.pcd")
    whole = Reproject().load().of_depth(frame)
    assert turned.frame == "base_link"
    np.testing.assert_allclose(turned.xyz[:, 0], whole.xyz[:, 2], rtol=1e-6)
    np.testing.assert_allclose(turned.xyz[:, 2], -whole.xyz[:, 1], rtol=1e-6, atol=1e-6)


def test_units_that_cannot_be_are_refused_with_the_other_readings(
    frames: list[StereoFrame], tmp_path: Path
) -> None:
    folder, _ = plain(tmp_path, "realsense", frames)
    with pytest.raises(MapScale, match=r"steps a metre.*--source.depth-scale") as error:
        TumDepth(str(folder), depth_scale=1.0).open().load(0)
    assert "at 1000" in error.value.fix
    assert "millimetres" in " ".join(TumDepth(str(folder)).open().summary.notes)


def test_a_camera_of_another_file_and_none_at_all(
    frames: list[StereoFrame], tmp_path: Path
) -> None:
    folder, _ = plain(tmp_path / "in", "realsense", frames)
    (folder / "K.txt").rename(tmp_path / "given.txt")
    with pytest.raises(CalibrationMissing, match="--rig"):
        TumDepth(str(folder)).open()
    source = opened_with_rig(TumDepth(str(folder)), tmp_path / "given.txt")
    assert source.load(0).id == "0000"
    bent = tmp_path / "bent.yaml"
    bent.write_text(
        "camera_matrix: {rows: 3, cols: 3, data: [100, 0, 80, 0, 100, 60, 0, 0, 1]}\n"
        "distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0, 0, 0, 0]}\n"
    )
    with pytest.raises(CalibrationValue, match="lens distortion"):
        opened_with_rig(TumDepth(str(folder)), bent)
    sized = tmp_path / "sized.json"
    sized.write_text('{"fx": 100, "fy": 100, "cx": 80, "cy": 60, "w": 320, "h": 240}')
    with pytest.raises(CalibrationSizeMismatch):
        opened_with_rig(TumDepth(str(folder)), sized).load(0)


def test_damage_costs_its_frame(frames: list[StereoFrame], tmp_path: Path) -> None:
    folder, _ = plain(tmp_path, "realsense", frames)
    cv2.imwrite(str(folder / "depth" / "0000.png"), np.zeros((SIZE[1], SIZE[0]), np.uint8))
    cv2.imwrite(str(folder / "depth" / "0001.png"), np.ones((50, 50), np.uint16) * 2000)
    source = TumDepth(str(folder)).open()
    with pytest.raises(ImageFormat, match="only to look at"):
        source.load(0)
    with pytest.raises(StructureError, match="image's"):
        source.load(1)
    (folder / "depth" / "0002.png").unlink()
    ((name, _),) = TumDepth(str(folder)).open().refused
    assert name == "0002"


@pytest.mark.parametrize(
    ("row", "text"),
    [
        ("1.0 0 0 0 0 0 0", "line 2: 7 numbers"),
        ("1.0 0 0 0 0 0 0 0", "line 2: a quaternion of length 0"),
        ("x 0 0 0 0 0 0 1", "line 2, column 1"),
        ("1.0 0 nan 0 0 0 0 1", "line 2, column 7"),
    ],
)
def test_a_broken_trajectory_is_refused_by_line(row: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / "groundtruth.txt"
    path.write_text(f"# timestamp tx ty tz qx qy qz qw\n{row}\n")
    with pytest.raises(PoseFileError) as error:
        read_tum_trajectory(path)
    assert text in str(error.value)


def test_a_broken_list_is_refused_by_line(frames: list[StereoFrame], tmp_path: Path) -> None:
    folder = tum(tmp_path, frames)
    (folder / "rgb.txt").write_text("# c\n1.0 rgb/1.png\nsoon rgb/2.png\n")
    with pytest.raises(SequenceTime, match="line 3"):
        TumDepth(str(folder)).open()


def test_trajectories_are_read_as_written(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    T = np.tile(np.eye(4), (20, 1, 1))
    times = [1_305_031_102_175_304_123 + 33_000_000 * n for n in range(20)]
    for pose in T:
        pose[:3, :3] = cv2.Rodrigues(rng.normal(size=3))[0]
        pose[:3, 3] = rng.normal(size=3) * 10
    write_tum_trajectory(tmp_path / "a.txt", times, T)
    stamps, again = read_tum_trajectory(tmp_path / "a.txt")
    assert list(stamps) == times
    np.testing.assert_allclose(again, T, atol=1e-15)
    assert again[:, :3, 3].tobytes() == T[:, :3, 3].tobytes()
