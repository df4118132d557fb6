from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from pseudolidar.sources.synthetic import Synthetic, SyntheticSource, Truth
from pseudolidar.sources.worlds.photometry import Photometry
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.frame import StereoFrame

QUIET = Photometry(noise=0.0, vignetting=0.0, right_gain=1.0, right_gamma=1.0, right_tint=1.0)


@dataclass(frozen=True)
class Known:
    """A frame of a world and the truth about it."""

    source: SyntheticSource
    frame: StereoFrame
    truth: Truth


@pytest.fixture(scope="module", params=["street", "room", "flight"])
def known(request: pytest.FixtureRequest) -> Known:
    source = Synthetic(request.param, frames=50, width_px=480, photometry=QUIET).open()
    return Known(source, source.load(7), source.truth_pair(7))


def lifted(depth: Float64, camera: Camera) -> Float64:
    """(H, W, 3) points of a depth map in its camera."""
    v, u = np.indices(depth.shape)
    K = camera.K
    return np.stack(
        [(u - K[0, 2]) / K[0, 0] * depth, (v - K[1, 2]) / K[1, 1] * depth, depth], axis=-1
    )


def test_disparity_is_that_of_the_projected_point(known: Known) -> None:
    truth, rig = known.truth, known.source.rig
    depth = truth.depth_left.values.astype(np.float64)
    seen = truth.left.valid
    points = lifted(depth, rig.left)[seen]
    u_right = points @ rig.P_right[:, :3].T + rig.P_right[:, 3]
    u_right = u_right[:, :2] / u_right[:, 2:]
    v, u = np.nonzero(seen)
    np.testing.assert_allclose(u - u_right[:, 0], truth.left.values[seen], atol=1e-3)
    np.testing.assert_allclose(u_right[:, 1], v, atol=1e-6)


def test_both_eyes_agree_where_both_see(known: Known) -> None:
    truth = known.truth
    v, u = np.nonzero(truth.left.valid & ~truth.occluded)
    d = truth.left.values[v, u]
    at = np.rint(u - d).astype(int)
    inside = (at >= 0) & (at < truth.right.values.shape[1])
    other = truth.right.values[v, np.clip(at, 0, truth.right.values.shape[1] - 1)]
    # Rounding to a pixel moves along a slanted surface and over edges: most, not all.
    agree = np.abs(other - d)[inside] < 0.5
    assert agree.mean() > 0.96


def test_sky_has_no_disparity(known: Known) -> None:
    truth = known.truth
    if known.source.name == "room":
        assert truth.left.valid.all()
    else:
        assert 0.02 < 1.0 - truth.left.density < 0.4
        assert np.isnan(truth.left.values[0]).any()
    assert np.nanmin(truth.left.values) > 0


def test_hidden_pixels_are_those_the_other_eye_cannot_see(known: Known) -> None:
    truth, rig = known.truth, known.source.rig
    occluded, seen = truth.occluded, truth.left.valid
    v, u = np.nonzero(seen)
    d = truth.left.values[v, u]
    at = np.rint(u - d).astype(int)
    inside = at >= 0
    assert occluded[v[~inside], u[~inside]].all()
    other = truth.right.values[v[inside], at[inside]]
    nearer = np.nan_to_num(other, nan=0.0) - d[inside] > max(1.5, 0.02 * rig.fB_px_m / 10)
    # What a clearly nearer thing covers in the right image is hidden, up to edges in a pixel.
    assert occluded[v[inside], u[inside]][nearer].mean() > 0.85
    assert occluded[v[inside], u[inside]][~nearer].mean() < 0.06


def test_warped_right_image_is_the_left_one(known: Known) -> None:
    frame, truth = known.frame, known.truth
    d = np.nan_to_num(truth.left.values)
    v, u = np.indices(d.shape, dtype=np.float32)
    warped = cv2.remap(frame.right, u - d, v, cv2.INTER_LINEAR)
    visible = truth.left.valid & ~truth.occluded
    residual = np.abs(warped.astype(float) - frame.left)[visible].mean(axis=-1)
    unwarped = np.abs(frame.right.astype(float) - frame.left)[visible].mean(axis=-1)
    assert np.median(residual) < 2.0
    assert residual.mean() < 0.45 * unwarped.mean()


def test_noise_and_differences_between_the_eyes_can_be_set() -> None:
    def loaded(photometry: Photometry) -> tuple[np.ndarray, np.ndarray]:
        frame = Synthetic("room", width_px=160, photometry=photometry).open().load(0)
        return frame.left.astype(float), frame.right.astype(float)

    quiet, noisy = loaded(QUIET)[0], loaded(Photometry(vignetting=0.0))[0]
    assert 0.5 < (noisy - quiet).std() < 6.0
    dim = loaded(Photometry(noise=0.0, vignetting=0.0, right_gain=0.5))
    assert dim[1].mean() < 0.85 * dim[0].mean()
    dark_corners = loaded(Photometry(noise=0.0, vignetting=0.5))[0]
    assert dark_corners[0, 0].mean() < 0.9 * quiet[0, 0].mean()
    assert dark_corners[60, 80].mean() == pytest.approx(quiet[60, 80].mean(), rel=0.03)


def test_scan_lies_on_the_exact_depth(known: Known) -> None:
    frame, truth = known.frame, known.truth
    points = known.source.rig.T_left_velodyne.apply(frame.scan.xyz.astype(np.float64))
    points = points[points[:, 2] > 0.5]
    uv = points @ known.source.rig.left.K.T
    u, v = np.rint(uv[:, :2] / uv[:, 2:]).astype(int).T
    height, width = truth.depth_left.values.shape
    inside = (u >= 1) & (u < width - 1) & (v >= 1) & (v < height - 1)
    u, v, z = u[inside], v[inside], points[inside, 2]
    depth = truth.depth_left.values
    around = np.stack([depth[v + i, u + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    flat = np.ptp(around, axis=0) < 0.05 * depth[v, u]  # no edge there
    error = (z - depth[v, u])[flat]
    assert len(error) > 1000
    # Noise of 2 cm, and the rounding to a pixel on slanted surfaces.
    assert abs(np.median(error)) < 0.02
    assert np.percentile(np.abs(error), 90) < 0.05 * np.median(z)
    if known.source.name == "room":
        assert 0.01 < 1.4826 * np.median(np.abs(error - np.median(error))) < 0.06
    assert (frame.scan.reflectance >= 0).all()
    assert (frame.scan.reflectance <= 1).all()
    assert np.ptp(frame.scan.reflectance) > 0.2
