"""Cropping, thinning, sparsifying, merging: which points stay, and that all their columns do."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.clouds.beams import Beams
from pseudolidar.clouds.crop import Box, Interval, Range
from pseudolidar.clouds.merge import LEAST_WAITING, Joined, column_names, merged
from pseudolidar.clouds.thin import Density, Uniform, Voxel
from pseudolidar.clouds.tool import CloudTools, forward_of, origin_of
from pseudolidar.errors import CalibrationField, StructureError, UsageError
from pseudolidar.geometry.beams import hdl64
from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.geometry.voxels import best_of_voxel
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

TREE = (Pose.from_rotation("velodyne", "camera_left", R_BODY_OPTICAL, np.array([0.3, 0.0, -0.1])),)


def cloud(n=2000, *, seed=2, frame="velodyne", organised=False):
    rng = np.random.default_rng(seed)
    xyz = rng.uniform((-20, -20, -2), (60, 20, 3), (n, 3)).astype(np.float32)
    if organised:
        xyz[::7] = np.nan
    return PointCloud(
        xyz,
        frame,
        timestamp_ns=5,
        rgb=rng.integers(0, 256, (n, 3)).astype(np.uint8),
        intensity=rng.uniform(size=n).astype(np.float32),
        sigma_m=rng.uniform(0.01, 1, n).astype(np.float32),
        uv=rng.uniform(0, 300, (n, 2)).astype(np.float32),
        extra={"row": np.arange(n), "label": rng.integers(0, 9, n).astype(np.uint16)},
        shape=(n // 50, 50) if organised else None,
    )


def rows_of(part, whole):
    """Positions in `whole` of the points of `part`, checking every column."""
    rows = part.extra["row"]
    again = whole[rows]
    for name in ("xyz", "rgb", "intensity", "sigma_m", "uv"):
        np.testing.assert_array_equal(getattr(part, name), getattr(again, name), err_msg=name)
    np.testing.assert_array_equal(part.extra["label"], again.extra["label"])
    assert (part.frame, part.timestamp_ns) == (whole.frame, whole.timestamp_ns)
    return rows


@pytest.mark.parametrize(
    "tool",
    [
        Box(x=Interval(2, 40), y=Interval(-5, 5)),
        Range(Interval(3, 30)),
        Voxel(2.0),
        Uniform(300),
        Density(300),
        Beams(64),
    ],
)
def test_tools_keep_points_with_all_their_columns(tool):
    whole = cloud()
    before = whole.xyz.copy()
    part, figures = tool.load()(whole, TREE)
    rows = rows_of(part, whole)
    assert 0 < len(rows) < len(whole)
    assert (np.diff(rows) > 0).all()
    assert list(figures.values()) == [len(whole) - len(part)]
    np.testing.assert_array_equal(whole.xyz, before)
    again, _ = tool.load()(whole, TREE)
    np.testing.assert_array_equal(again.extra["row"], rows)


@pytest.mark.parametrize("tool", [Box(x=Interval(2, 40)), Range(Interval(3, 30)), Beams(64)])
def test_cropped_organised_clouds_stay_organised(tool):
    whole = cloud(organised=True)
    part, figures = tool.load()(whole, TREE)
    assert part.shape == whole.shape
    flat, _ = tool.load()(whole[whole.valid], TREE)
    assert np.count_nonzero(part.valid) == len(flat)
    assert list(figures.values()) == [np.count_nonzero(whole.valid) - len(flat)]


@pytest.mark.parametrize("tool", [Voxel(2.0), Uniform(300), Density(300)])
def test_thinned_organised_clouds_are_lists_of_points(tool):
    part, _ = tool.load()(cloud(organised=True), TREE)
    assert part.shape is None
    assert part.valid.all()


def test_a_box_in_another_frame_is_that_frames():
    whole = cloud()
    part, _ = Box(z=Interval(0, 10), frame="camera_left")(whole, TREE)
    inverse = TREE[0].inverse()
    depth = inverse.apply(whole.xyz)[:, 2]
    np.testing.assert_array_equal(part.extra["row"], np.flatnonzero((depth >= 0) & (depth <= 10)))


def test_a_box_in_an_unknown_frame_names_those_that_are_known():
    with pytest.raises(CalibrationField, match="camera_left, velodyne"):
        Box(frame="imu")(cloud(), TREE)


def test_range_is_from_the_camera_where_pixels_are_known():
    whole = cloud()
    np.testing.assert_allclose(origin_of(whole, TREE), [0.3, 0, -0.1])
    part, _ = Range(Interval(0, 10))(whole, TREE)
    away = np.linalg.norm(whole.xyz - [0.3, 0, -0.1], axis=1)
    np.testing.assert_array_equal(part.extra["row"], np.flatnonzero(away <= 10))
    alone = PointCloud(whole.xyz, "velodyne")
    np.testing.assert_array_equal(origin_of(alone, TREE), 0)


@pytest.mark.parametrize(
    ("text", "ends"),
    [
        ("2:40", (2, 40)),
        (":1.5", (-np.inf, 1.5)),
        ("-10:", (-10, np.inf)),
        (":", (-np.inf, np.inf)),
    ],
)
def test_intervals_are_read_and_written(text, ends):
    interval = Interval.parse(text)
    assert (interval.low_m, interval.high_m) == ends
    assert Interval.parse(str(interval)) == interval


@pytest.mark.parametrize("text", ["", "5", "a:b", "5:2", "1:2:3", "nan:3"])
def test_what_is_no_interval_is_refused(text):
    with pytest.raises(UsageError):
        Interval.parse(text)


def test_ends_belong_to_an_interval_and_nan_does_not():
    values = np.array([1.0, 2.0, 3.0, np.nan])
    assert Interval(1, 2).holds(values).tolist() == [True, True, False, False]


@pytest.mark.parametrize("points", [1, 7, 1999, 2000, 5000])
def test_uniform_is_exact_and_even(points):
    part, _ = Uniform(points)(cloud(), ())
    assert len(part) == min(points, 2000)
    steps = np.diff(part.extra["row"])
    assert steps.size == 0 or steps.max() - steps.min() <= 1


def test_density_takes_from_near_surfaces():
    """A road seen by a camera: pixels are dense nearby; afterwards an area has as many anywhere."""
    v, u = np.mgrid[190:375, 0:400].astype(np.float32)
    z = 700 * 1.7 / (v - 180)
    xyz = np.stack([(u - 200) / 700 * z, np.full_like(z, 1.7), z], axis=-1).reshape(-1, 3)
    uv = np.stack([u, v], axis=-1).reshape(-1, 2)
    road = PointCloud(xyz, "camera_left", uv=uv)
    part, _ = Density(5000)(road, ())
    assert len(part) == 5000

    def near_share(some):
        return np.mean(some.xyz[:, 2] < 12)

    assert near_share(road) > 0.5
    assert near_share(part) < 0.5 * near_share(road)


@pytest.mark.parametrize("wrong", [lambda: Uniform(0), lambda: Density(-1), lambda: Voxel(0.0)])
def test_settings_that_mean_nothing_are_refused(wrong):
    with pytest.raises(UsageError):
        wrong()


def test_fewer_beams_are_some_of_the_many():
    y, z = np.meshgrid(np.linspace(-5, 5, 900), np.linspace(-3, 0.3, 700))
    wall = np.stack([np.full(y.size, 10.0), y.ravel(), z.ravel()], axis=1).astype(np.float32)
    counts = {n: len(Beams(n)(PointCloud(wall, "velodyne"), ())[0]) for n in (64, 32, 16, 4)}
    assert counts[64] == pytest.approx(2 * counts[32], rel=0.1)
    assert counts[32] == pytest.approx(2 * counts[16], rel=0.15)
    assert counts[4] > 0


def test_beams_start_where_the_velodyne_is_and_meet_the_nearest_surface():
    """Of a wall and one behind it, in a camera's frame, only the first is met; angles are exact."""
    y, z = np.meshgrid(np.linspace(-3, 3, 900), np.linspace(-2.5, 0.3, 700))
    walls = [np.stack([np.full(y.size, x), y.ravel(), z.ravel()], axis=1) for x in (9.0, 10.0)]
    points = np.concatenate(walls).astype(np.float32)
    in_camera = PointCloud(points, "velodyne").transformed(TREE[0].inverse())
    seen, _ = Beams(64)(in_camera, TREE)
    seen = seen.transformed(TREE[0])
    inner = np.abs(seen.xyz[:, 1]) < 2.5
    assert (seen.xyz[inner, 0] < 9.5).mean() > 0.999
    elevation = np.degrees(np.arctan2(seen.xyz[:, 2], np.hypot(seen.xyz[:, 0], seen.xyz[:, 1])))
    off = np.abs(elevation[:, None] - np.array(hdl64().elevations_deg)).min(axis=1)
    assert np.median(off) < 0.02
    assert off.max() <= 0.1251


def test_where_forward_is():
    assert forward_of(cloud(frame="camera_left"), TREE).dst == "velodyne"
    np.testing.assert_array_equal(forward_of(cloud(), TREE).matrix, np.eye(4))
    turned = forward_of(cloud(frame="cam2"), ())
    np.testing.assert_array_equal(turned.matrix[:3, :3], R_BODY_OPTICAL)
    assert forward_of(cloud(frame="somewhere"), ()).dst == "somewhere"


def test_tools_pass_the_cloud_on_in_their_order():
    tools = CloudTools.load(Box(x=Interval(0, 40)), None, Uniform(100))
    part, figures = tools(cloud(), iter(TREE))
    assert len(part) == 100
    assert figures["points_cropped"] + figures["points_thinned"] == 2000 - 100
    same = cloud()
    assert CloudTools.load(None)(same, TREE).cloud is same


class TestMerge:
    def test_union_of_columns(self):
        a, b = cloud(10), cloud(5, seed=3)
        b = PointCloud(b.xyz, b.frame, extra={"row": b.extra["row"], "t": np.arange(5.0)})
        both = merged([a, b])
        assert len(both) == 15
        np.testing.assert_array_equal(both.xyz, np.concatenate([a.xyz, b.xyz]))
        assert both.rgb is None
        assert both.uv is None
        np.testing.assert_array_equal(both.sigma_m[:10], a.sigma_m)
        assert np.isnan(both.sigma_m[10:]).all()
        assert both.extra["row"].dtype == a.extra["row"].dtype
        assert both.extra["label"].dtype == np.float64
        np.testing.assert_array_equal(both.extra["label"][:10], a.extra["label"])
        assert np.isnan(both.extra["label"][10:]).all()
        np.testing.assert_array_equal(both.extra["t"], [*[np.nan] * 10, *range(5)])

    def test_alike_clouds_keep_everything(self):
        parts = [cloud(10, seed=k) for k in range(3)]
        both = merged(parts)
        np.testing.assert_array_equal(both.rgb, np.concatenate([p.rgb for p in parts]))
        np.testing.assert_array_equal(both.uv, np.concatenate([p.uv for p in parts]))
        assert both.extra["label"].dtype == np.uint16

    def test_poses_bring_them_into_one_frame(self):
        poses = [
            Pose.from_rotation("map", "velodyne", np.eye(3), np.array([float(k), 0, 0]))
            for k in range(2)
        ]
        one = cloud(10)
        both = merged([one, one], poses)
        assert both.frame == "map"
        np.testing.assert_allclose(both.xyz[10:] - both.xyz[:10], [[1, 0, 0]] * 10, atol=1e-5)

    def test_holes_of_organised_clouds_are_left_out(self):
        assert merged([cloud(100, organised=True)]).valid.all()

    def test_other_frames_and_nothing_are_refused(self):
        with pytest.raises(StructureError, match="camera_left, velodyne"):
            merged([cloud(5), cloud(5, frame="camera_left")])
        with pytest.raises(StructureError, match="no cloud"):
            merged([])


class TestJoined:
    def test_one_after_the_other_is_the_same_as_at_once(self):
        parts = [cloud(50, seed=k) for k in range(4)]
        joined = Joined()
        for part in parts:
            joined.add(part)
        assert joined.nbytes == 4 * 50 * (12 + 3 + 4 + 4 + 8 + 8 + 2)
        both, lost = joined.taken()
        assert lost == ()
        assert column_names(both) == column_names(parts[0])
        np.testing.assert_array_equal(both.xyz, merged(parts).xyz)

    def test_with_cubes_memory_is_that_of_what_is_kept_and_the_points_are_the_same(self):
        rng = np.random.default_rng(8)
        parts = []
        for _ in range(12):
            xyz = rng.uniform(0, 20, (300_000, 3)).astype(np.float32)
            sigma_m = rng.integers(1, 50, len(xyz)).astype(np.float32)
            sigma_m[::11] = np.nan
            parts.append(PointCloud(xyz, "map", sigma_m=sigma_m))
        joined, most = Joined(1.0), 0
        for part in parts:
            joined.add(part)
            most = max(most, len(joined))
        assert most <= LEAST_WAITING + 300_000
        thinned, _ = joined.taken()
        whole = merged(parts)
        best = best_of_voxel(whole.xyz, whole.sigma_m, voxel_m=1.0)
        assert len(best) == 8000
        np.testing.assert_array_equal(thinned.xyz, whole.xyz[best])

    def test_columns_that_are_lost_are_named(self):
        joined = Joined()
        joined.add(cloud(5))
        joined.add(PointCloud(cloud(5).xyz, "velodyne"))
        both, lost = joined.taken()
        assert lost == ("rgb", "uv")
        assert both.sigma_m is not None
