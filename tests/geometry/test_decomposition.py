"""A projection matrix taken apart: against OpenCV, and whatever its scale and sign."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pseudolidar.errors import CalibrationValue
from pseudolidar.geometry.decomposition import decompose
from pseudolidar.geometry.unrectified import rotation_deg, why_unrectified
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose


def camera(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K with skew, any rotation (also behind and upside down), any place."""
    rng = np.random.default_rng(seed)
    K = np.array([[rng.uniform(100, 2000), rng.normal(), rng.uniform(0, 900)],
                  [0, rng.uniform(100, 2000), rng.uniform(0, 900)], [0, 0, 1]])  # fmt: skip
    R = cv2.Rodrigues(rng.normal(size=3) * 2)[0]
    return K, R, rng.normal(size=3) * 10


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("scale", [1.0, -1.0, 37.5, -1e-4])
def test_the_parts_that_a_matrix_was_made_of(seed: int, scale: float) -> None:
    K, R, t = camera(seed)
    P = scale * K @ np.hstack([R, t[:, None]])
    parts = decompose(P)
    np.testing.assert_allclose(parts.K, K, rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(parts.R, R, atol=1e-11)
    np.testing.assert_allclose(parts.t, t, rtol=1e-9)
    assert parts.scale == pytest.approx(scale)
    assert np.linalg.det(parts.R) == pytest.approx(1)
    np.testing.assert_allclose(parts.scale * parts.K @ parts.matrix[:3], P, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(P @ [*parts.centre, 1], 0, atol=1e-8 * np.abs(P).max())


@pytest.mark.parametrize("seed", range(20))
def test_opencv_finds_the_same(seed: int) -> None:
    K, R, t = camera(seed)
    P = 3.0 * K @ np.hstack([R, t[:, None]])
    theirs = cv2.decomposeProjectionMatrix(P)
    parts = decompose(P)
    K_cv = theirs[0] / theirs[0][2, 2]
    np.testing.assert_allclose(parts.K, K_cv, rtol=1e-8, atol=1e-7)
    np.testing.assert_allclose(parts.R, theirs[1], atol=1e-9)
    np.testing.assert_allclose(parts.centre, (theirs[2][:3] / theirs[2][3])[:, 0], rtol=1e-8)


def test_what_is_k_and_t_already_stays_bit_for_bit() -> None:
    K = np.array([[721.5377 + 1 / 3, 0, 609.5593], [0, 721.1 + 1 / 7, 172.854], [0, 0, 1.0]])
    t = np.array([-0.54, 0.0, 0.0])
    parts = decompose(np.hstack([K, (K @ t)[:, None]]))
    assert parts.K.tobytes() == K.tobytes()
    assert np.array_equal(parts.R, np.eye(3))
    np.testing.assert_allclose(parts.t, t, rtol=1e-15)


@pytest.mark.parametrize(
    "P",
    [
        np.zeros((3, 4)),
        np.full((3, 4), np.nan),
        np.array([[1.0, 2, 3, 4], [2, 4, 6, 8], [0, 0, 1, 0]]),  # two rows alike
        np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]),  # parallel projection
    ],
)
def test_what_is_no_camera_is_refused(P: np.ndarray) -> None:
    with pytest.raises(CalibrationValue, match="is no camera"):
        decompose(P)


K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])


def rig(K_right: np.ndarray = K, turn: tuple[float, ...] = (0, 0, 0), **right: object) -> StereoRig:
    R = cv2.Rodrigues(np.radians(turn))[0]
    place = np.array(right.pop("place", (-0.1, 0.0, 0.0)), dtype=float)
    other = Camera(K_right, 640, 480, frame="camera_right", **right)  # type: ignore[arg-type]
    pose = Pose.from_rotation("camera_right", "camera_left", R, place)
    return StereoRig(Camera(K, 640, 480), other, pose)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (rig(K * [[1.1, 1, 1], [1, 1, 1], [1, 1, 1]]), "fx 500 px left and 550 px right"),
        (rig(K * [[1, 1, 1], [1, 1, 1.05], [1, 1, 1]]), "cy 240 px left and 252 px right"),
        (rig(np.array([[500.0, 2, 320], [0, 500, 240], [0, 0, 1]])), "skew of 0 and 2 px"),
        (rig(turn=(0, 2, 0)), "a rotation of 2 degrees between the cameras"),
        (rig(place=(-0.1, 0.05, 0)), "the right camera 0.05 m above the left"),
        (rig(place=(-0.1, -0.05, 0)), "the right camera 0.05 m below the left"),
        (rig(place=(-0.1, 0, 0.05)), "the right camera 0.05 m behind the left"),
        (rig(distortion=np.array([0.1, 0, 0, 0])), "distortion of pinhole lenses"),
    ],
)
def test_each_reason_against_a_rectified_pair_is_named(changed: StereoRig, words: str) -> None:
    assert not changed.is_rectified
    assert words in why_unrectified(changed)


def test_a_rectified_rig_has_none() -> None:
    assert why_unrectified(rig()) == ()
    assert rig().is_rectified


@pytest.mark.parametrize("deg", [0.0, 1e-7, 30.0, 179.5])
def test_angles_small_and_large(deg: float) -> None:
    R = cv2.Rodrigues(np.radians(deg) * np.array([0.6, 0.0, 0.8]))[0]
    assert rotation_deg(R) == pytest.approx(deg, rel=1e-6, abs=1e-12)
