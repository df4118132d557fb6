from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.geometry.rectification import rectification
from pseudolidar.geometry.rectified_pixels import PairMaps, eye_map, matched_pixels, unmasked
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import PairMask
from tests.raw_rigs import raw_rig


@pytest.mark.parametrize("alpha", [0.0, 1.0])
@pytest.mark.parametrize("lens", ["pinhole 5", "pinhole 8", "pinhole 12", "fisheye 4"])
def test_maps_are_opencvs(lens: str, alpha: float):
    model, coefficients = lens.split()
    rig = raw_rig(int(coefficients), model=model)
    planned = rectification(rig, alpha=alpha)
    maker = (cv2.fisheye if model == "fisheye" else cv2).initUndistortRectifyMap
    for camera, R, flat in (
        (rig.left, planned.R_left, planned.rig.left),
        (rig.right, planned.R_right, planned.rig.right),
    ):
        u, v = maker(camera.K, camera.distortion, R, flat.K, flat.size_px, cv2.CV_32FC1)
        got = eye_map(camera, R, flat)
        inside = (u >= 0) & (u <= 639) & (v >= 0) & (v <= 479)
        np.testing.assert_array_equal(got.seen, inside)
        np.testing.assert_allclose(got.uv[inside], np.stack([u, v], -1)[inside], atol=1e-3)
        assert got.seen.mean() > 0.5
        assert (got.uv[~got.seen] < -8).all()  # outside for every way to interpolate


@pytest.mark.parametrize("channels", [(), (3,)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_pictures_are_what_opencv_makes_of_them(dtype: type, channels: tuple[int, ...]):
    rig = raw_rig(5)
    planned = rectification(rig)
    rng = np.random.default_rng(0)
    image = rng.integers(0, np.iinfo(dtype).max, (480, 640, *channels)).astype(dtype)
    image = cv2.GaussianBlur(image, (0, 0), 2.0)
    pictures = PairMaps.of(planned).apply(image, image)
    for got, camera, R in zip(
        pictures, (rig.left, rig.right), (planned.R_left, planned.R_right), strict=True
    ):
        u, v = cv2.initUndistortRectifyMap(
            camera.K, camera.distortion, R, planned.rig.left.K, (640, 480), cv2.CV_32FC1
        )
        want = cv2.remap(image, u, v, cv2.INTER_LINEAR).astype(float)
        assert got.dtype == dtype
        # Fixed-point places: up to 1/64 px off, in pictures whose slope is some grey levels a pixel
        assert np.abs(got - want)[2:-2, 2:-2].max() <= np.iinfo(dtype).max * 3 / 255


def test_what_no_camera_saw_is_black_and_masked():
    rig = raw_rig(5)
    planned = rectification(rig, alpha=1.0)
    maps = PairMaps.of(planned)
    white = np.full((480, 640), 255, np.uint8)
    left, right = maps.apply(white, white)
    for picture, mask in ((left, maps.mask.left), (right, maps.mask.right)):
        assert (picture == 0).mean() > 0.05
        assert (picture[mask] == 255).all()
        # The margin: what a matcher looks at around a pixel is of the scene as well.
        whole = cv2.erode((picture == 255).astype(np.uint8), np.ones((7, 9), np.uint8))
        assert (mask <= whole.astype(bool)).all()
        assert mask.sum() > 0.97 * whole.sum()


def test_what_the_polynomial_folds_into_the_picture_is_masked():
    """Beyond the turning point OpenCV shows the scene a second time."""
    rig = raw_rig(5, focal_px=250.0)
    bent = np.array([-0.3, 0, 0, 0, 0])
    rig = replace(
        rig, left=replace(rig.left, distortion=bent), right=replace(rig.right, distortion=bent)
    )
    planned = rectification(rig, zoom=0.4)
    flat = planned.rig.left
    u, v = cv2.initUndistortRectifyMap(
        rig.left.K, bent, planned.R_left, flat.K, flat.size_px, cv2.CV_32FC1
    )
    inside = (u >= 0) & (u <= 639) & (v >= 0) & (v <= 479)
    seen = eye_map(rig.left, planned.R_left, flat).seen
    x = (np.arange(640) - flat.K[0, 2]) / flat.focal_px
    y = (np.arange(480)[:, None] - flat.K[1, 2]) / flat.focal_px
    far = np.hypot(x, y) > 1.2
    assert (inside & far).any()
    assert not (seen & far).any()


def test_maps_are_computed_once():
    first = PairMaps.of(rectification(raw_rig(5)))
    assert PairMaps.of(rectification(raw_rig(5))) is first
    assert PairMaps.of(rectification(raw_rig(5), zoom=1.1)) is not first


def test_maps_are_those_of_all_that_they_follow_from():
    """A plan that differs in one number alone has maps of its own."""
    plan = rectification(raw_rig(5))
    eye = plan.raw.right
    raws = (
        replace(plan.raw, right=replace(eye, distortion=0.5 * eye.distortion)),
        replace(plan.raw, right=replace(eye, distortion=eye.distortion[:4], model="fisheye")),
        replace(plan.raw, right=replace(eye, K=eye.K + np.diag([3.0, 0, 0]))),
        replace(plan.raw, left=replace(plan.raw.left, K=plan.raw.left.K + np.diag([3.0, 0, 0]))),
    )
    turn = cv2.Rodrigues(np.array([0.0, 0.0, 0.01]))[0]
    others = (
        *(replace(plan, raw=raw) for raw in raws),
        replace(plan, R_right=turn @ plan.R_right),
        replace(plan, R_left=turn @ plan.R_left),
    )
    usual = PairMaps.of(plan)
    for number, other in enumerate(others):
        maps = PairMaps.of(other)
        changed = [
            not np.array_equal(now[0], before[0])
            for now, before in ((maps.left, usual.left), (maps.right, usual.right))
        ]
        assert changed == [number in (3, 5), number not in (3, 5)]
    few = PairMaps.of(replace(plan, shown_rows=(100, 200))).mask
    assert few.left.any(axis=1).nonzero()[0].tolist() == list(range(100, 200))
    assert (usual.mask is None) or usual.mask.left[:100].any()


def test_a_pair_that_shows_something_everywhere_needs_no_mask():
    everywhere = np.ones((40, 60), bool)
    assert matched_pixels(everywhere, everywhere) is None


def test_disparities_need_both_pixels():
    left, right = np.ones((4, 10), bool), np.ones((4, 10), bool)
    left[1, 5] = False
    right[2, 3] = False
    values = np.full((4, 10), np.nan, np.float32)
    values[:, 5] = 2.2, 2.2, 2.2, 5.6  # matches: 3, none, 3, outside
    values[0, 9] = 4.0
    sigma = np.full((4, 10), 0.5, np.float32)
    got = unmasked(DisparityMap(values, sigma), PairMask(left, right))
    assert np.argwhere(got.valid).tolist() == [[0, 5], [0, 9]]
    assert np.isfinite(got.sigma).sum() == 2
    plain = DisparityMap(values)
    assert unmasked(plain, None) is plain


def test_the_kernel_of_masks_does_what_numpy_does():
    rng = np.random.default_rng(4)
    values = rng.uniform(-4, 40, (60, 80)).astype(np.float32)
    values[rng.random(values.shape) < 0.2] = np.nan
    values[::3] = np.floor(values[::3]) + np.float32(0.5)  # half way between two pixels
    sigma = np.full(values.shape, 0.3, np.float32)
    left, right = rng.random((2, *values.shape)) < 0.7
    rows, columns = np.indices(values.shape)
    matches = np.rint(columns - np.nan_to_num(values)).astype(np.int64)
    shown = np.isfinite(values) & left & (matches >= 0) & (matches < 80)
    shown &= right[rows, np.clip(matches, 0, 79)]
    before = values.copy()
    got = unmasked(DisparityMap(values, sigma), PairMask(left, right))
    np.testing.assert_array_equal(got.values, np.where(shown, values, np.float32(np.nan)))
    np.testing.assert_array_equal(got.sigma, np.where(shown, sigma, np.float32(np.nan)))
    np.testing.assert_array_equal(values, before)
    plain = unmasked(DisparityMap(values, None), PairMask(left, right))
    assert plain.sigma is None
    np.testing.assert_array_equal(plain.values, got.values)
