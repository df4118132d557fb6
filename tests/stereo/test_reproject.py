from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import StereoConfig, StructureError
from pseudolidar.geometry import triangulation
from pseudolidar.geometry.grey import LUMA
from pseudolidar.geometry.projection import project
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.correction import DisparityCorrection, SigmaScale
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose

WIDTH_PX, HEIGHT_PX = 124, 37
EVERYTHING = Reproject(max_range_m=1e9)
CORRECTION = DisparityCorrection(
    np.array([0.5, 0.1, -0.2, 0.1, 0.3, -0.1, 0.2, 0.4, -0.3, 0.25]),
    0.1,
    sigma_scale=SigmaScale(np.array([2.0, 5.0, 9.0]), np.array([0.5, 1.5, 0.8])),
)


def rig(*, tz_m=-1.6e-3, doffs_px=0.0, correction=None) -> StereoRig:
    """KITTI-like, a tenth of its size, with a hundred times its forward offset."""
    K = np.array([[72.1, 0.0, 60.9], [0.0, 72.1, 17.3], [0.0, 0.0, 1.0]])
    K_right = K + doffs_px * np.array([[0, 0, 1.0], [0, 0, 0], [0, 0, 0]])
    t_m = np.array([-0.53273, 0.002, tz_m])
    return StereoRig(
        Camera(K, WIDTH_PX, HEIGHT_PX),
        Camera(K_right, WIDTH_PX, HEIGHT_PX, frame="camera_right"),
        Pose.from_rotation("camera_right", "camera_left", np.eye(3), t_m),
        correction=correction,
    )


def frame(of: StereoRig, *, channels=3, dtype=np.uint8, top=255) -> StereoFrame:
    shape = (HEIGHT_PX, WIDTH_PX, 3)[: 2 if channels == 1 else 3]
    image = np.random.default_rng(1).integers(0, top + 1, shape).astype(dtype)
    return StereoFrame(image, image.copy(), of, id="7", index=7, timestamp_ns=123)


def disparities(*, low_px=0.5, sigma=True) -> DisparityMap:
    rng = np.random.default_rng(2)
    values = rng.uniform(low_px, 12.0, (HEIGHT_PX, WIDTH_PX)).astype(np.float32)
    values[rng.random(values.shape) < 0.3] = np.nan
    spread = rng.uniform(0.1, 1.0, values.shape).astype(np.float32)
    spread[np.isnan(values)] = np.nan
    return DisparityMap(values, spread if sigma else None)


def oracle(of: StereoRig, disparity: DisparityMap, *, via: str) -> tuple[np.ndarray, ...]:
    """Plain numpy: (N, 3) points, (N,) sigma along the ray, (N, 2) pixels of all valid pixels."""
    v, u = np.nonzero(disparity.valid)
    measured = disparity.values[v, u].astype(float)
    u, v = u.astype(float), v.astype(float)
    d = triangulation.corrected_disparity(measured, u, v, of)
    points = getattr(triangulation, f"points_by_{via}")(d, u, v, of)
    kept = np.isfinite(points).all(axis=1)
    points, d, u, v = points[kept], d[kept], u[kept], v[kept]
    sigma = disparity.sigma[v.astype(int), u.astype(int)] * of.sigma_scale.at(measured[kept])
    sigma_px = np.hypot(sigma, of.systematic_sigma_px)
    slope = triangulation.depth_per_disparity(d, points[:, 2], of)
    along_ray = np.linalg.norm(points, axis=1) / points[:, 2]
    return points, sigma_px * slope * along_ray, np.stack([u, v], axis=1)


@pytest.mark.parametrize("via", ["q", "p"])
@pytest.mark.parametrize(
    "of", [rig(), rig(tz_m=0.0), rig(doffs_px=3.1), rig(correction=CORRECTION)], ids=range(4)
)
def test_kernel_equals_the_numpy_version(of, via):
    disparity = disparities()
    cloud = replace(EVERYTHING, via=via).load()(frame(of), disparity)
    points, sigma_m, uv = oracle(of, disparity, via=via)
    np.testing.assert_array_equal(cloud.uv, uv)
    np.testing.assert_allclose(cloud.xyz, points, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(cloud.sigma_m, sigma_m, rtol=1e-5)


def test_points_project_back_to_pixel_and_corrected_disparity():
    of = rig(doffs_px=2.0, correction=CORRECTION)
    disparity = disparities()
    cloud = EVERYTHING.load()(frame(of), disparity)
    left, _ = project(cloud.xyz.astype(float), of.P_left)
    right, _ = project(cloud.xyz.astype(float), of.P_right)
    u, v = cloud.uv.astype(float).T
    measured = disparity.values[v.astype(int), u.astype(int)].astype(float)
    expected = measured - CORRECTION.offset_px(measured, u, v, of.left.size_px)
    # float32 coordinates of points up to some km: a few 1e-5 px.
    np.testing.assert_allclose(left, cloud.uv, atol=1e-4)
    np.testing.assert_allclose(left[:, 0] - right[:, 0], expected, atol=1e-4)


def test_disparities_beyond_infinity_give_no_point():
    of = rig(tz_m=0.0, correction=DisparityCorrection(np.array([2.0] + [0.0] * 9), 0.1))
    values = np.full((HEIGHT_PX, WIDTH_PX), np.nan, np.float32)
    values[3, 4], values[3, 5], values[3, 6], values[3, 7] = 2.0, 1.9, -1.0, 2.1
    cloud = EVERYTHING.load()(frame(of), DisparityMap(values))
    np.testing.assert_array_equal(cloud.uv, [[7.0, 3.0]])
    assert np.isfinite(cloud.xyz).all()
    assert (cloud.xyz[:, 2] > 0).all()


def test_columns_of_a_colour_frame():
    pair = frame(rig())
    disparity = disparities()
    cloud = EVERYTHING.load()(pair, disparity)
    colours = pair.left[disparity.valid]
    assert (cloud.frame, cloud.timestamp_ns) == ("camera_left", 123)
    np.testing.assert_array_equal(cloud.rgb, colours)
    np.testing.assert_allclose(cloud.intensity, colours @ LUMA / 255, atol=1e-6)


def test_a_grey_frame_has_intensity_and_no_colour():
    pair = frame(rig(), channels=1)
    disparity = disparities()
    cloud = EVERYTHING.load()(pair, disparity)
    assert cloud.rgb is None
    np.testing.assert_allclose(cloud.intensity, pair.left[disparity.valid] / 255, atol=1e-6)


@pytest.mark.parametrize("channels", [1, 3])
def test_twelve_bit_images_in_uint16_scale_by_their_own_bits(channels):
    pair = frame(rig(), channels=channels, dtype=np.uint16, top=4095)
    disparity = disparities()
    cloud = EVERYTHING.load()(pair, disparity)
    levels = pair.left[disparity.valid]
    expected = levels if channels == 1 else levels @ LUMA
    np.testing.assert_allclose(cloud.intensity, expected / 4095, atol=1e-6)
    if channels == 3:
        np.testing.assert_array_equal(cloud.rgb, levels >> 4)


def test_organised_keeps_every_pixel_at_its_place():
    pair, disparity = frame(rig()), disparities()
    flat = EVERYTHING.load()(pair, disparity)
    organised = replace(EVERYTHING, organised=True).load()(pair, disparity)
    assert organised.shape == (HEIGHT_PX, WIDTH_PX)
    np.testing.assert_array_equal(organised.valid.reshape(organised.shape), disparity.valid)
    np.testing.assert_array_equal(organised.rgb.reshape(pair.left.shape), pair.left)
    np.testing.assert_array_equal(np.isnan(organised.sigma_m), ~organised.valid)
    for name in ("xyz", "rgb", "intensity", "sigma_m", "uv"):
        np.testing.assert_array_equal(
            getattr(organised[organised.valid], name), getattr(flat, name)
        )


def test_gates():
    pair, disparity = frame(rig()), disparities()
    everything = EVERYTHING.load()(pair, disparity)
    reach_m = np.linalg.norm(everything.xyz, axis=1)
    relative = everything.sigma_m / reach_m
    height_m = -everything.xyz[:, 1]
    for settings, kept in [
        ({"min_range_m": 5.0, "max_range_m": 20.0}, (reach_m >= 5) & (reach_m <= 20)),
        ({"min_height_m": -1.0, "max_height_m": 0.5}, (height_m >= -1) & (height_m <= 0.5)),
        ({"max_sigma_m": 0.7}, everything.sigma_m <= 0.7),
        ({"max_sigma_rel": 0.1}, relative <= 0.1),
    ]:
        assert 0 < kept.sum() < len(kept)
        cloud = replace(EVERYTHING, **settings).load()(pair, disparity)
        np.testing.assert_array_equal(cloud.uv, everything.uv[kept])


def test_voxels_keep_the_surest_point_of_each_cube():
    pair, disparity = frame(rig()), disparities(low_px=6.0)
    everything = EVERYTHING.load()(pair, disparity)
    thinned = replace(EVERYTHING, voxel_m=0.5).load()(pair, disparity)
    cells = np.floor(everything.xyz.astype(float) / 0.5).astype(int)
    _, cell = np.unique(cells, axis=0, return_inverse=True)
    order = np.lexsort((np.arange(len(cell)), everything.sigma_m, cell.ravel()))
    best = np.sort(order[np.r_[True, np.diff(cell.ravel()[order]) != 0]])
    assert len(best) < len(everything)
    np.testing.assert_array_equal(thinned.uv, everything.uv[best])
    np.testing.assert_array_equal(thinned.rgb, everything.rgb[best])


def test_ground_truth_without_sigma_makes_a_cloud_without_sigma():
    cloud = EVERYTHING.load()(frame(rig()), disparities(sigma=False))
    assert cloud.sigma_m is None
    with pytest.raises(StereoConfig):
        Reproject(max_sigma_m=1.0).load()(frame(rig()), disparities(sigma=False))


def test_an_empty_disparity_map_makes_an_empty_cloud():
    nothing = DisparityMap(np.full((HEIGHT_PX, WIDTH_PX), np.nan, np.float32))
    cloud = Reproject().load()(frame(rig()), nothing)
    assert len(cloud) == 0
    assert cloud.rgb is not None


def test_settings_and_sizes_that_make_no_sense_are_refused():
    for settings in (
        {"min_range_m": 10.0, "max_range_m": 5.0},
        {"voxel_m": 0.0},
        {"organised": True, "voxel_m": 0.2},
    ):
        with pytest.raises(StereoConfig):
            Reproject(**settings)
    with pytest.raises(StructureError):
        Reproject().load()(frame(rig()), DisparityMap(np.ones((3, 4), np.float32)))
