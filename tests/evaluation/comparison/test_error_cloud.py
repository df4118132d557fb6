import numpy as np
import pytest

from pseudolidar.evaluation.compared import against_scan
from pseudolidar.evaluation.comparison.error_cloud import (
    RIGHT,
    TOO_FAR,
    TOO_NEAR,
    clouds_together,
    error_cloud,
    error_colours,
    reference_points,
)
from pseudolidar.structures.cloud import PointCloud
from tests.evaluation.test_lidar import frame, wall


def cloud_at(u: list[int], v: list[int]) -> PointCloud:
    uv = np.stack([u, v], axis=1).astype(np.float32)
    xyz = np.tile(np.array([0, 0, 10], np.float32), (len(u), 1))
    return PointCloud(xyz, "camera_left", uv=uv, rgb=np.full((len(u), 3), 200, np.uint8))


def test_the_error_stands_at_the_pixels_of_the_reference():
    pair = frame()  # a scan of a wall at 8 m, at every other pixel of every other row
    compared = against_scan(wall(), pair)  # matched at 10 m
    u, v = int(compared.u[0]), int(compared.v[0])
    off = (u + 1, v) if (u + 1, v) not in set(zip(compared.u, compared.v, strict=True)) else (u, 0)
    shown = error_cloud(cloud_at([u, off[0]], [v, off[1]]), compared)
    error_m = shown.extra["error_m"]
    assert error_m[0] == pytest.approx(2.0, rel=1e-5)
    assert np.isnan(error_m[1])
    assert tuple(shown.rgb[0]) == TOO_FAR  # by 25 %: the end of the scale
    assert tuple(shown.rgb[1]) == (70, 70, 70)  # dimmed


def test_colours_of_errors():
    colours = error_colours(np.array([-0.5, -0.1, 0.0, 0.05, 0.1]))
    assert tuple(colours[0]) == tuple(colours[1]) == TOO_NEAR
    assert tuple(colours[2]) == RIGHT
    assert tuple(colours[4]) == TOO_FAR
    np.testing.assert_allclose(colours[3], (np.array(RIGHT) + TOO_FAR) / 2, atol=0.6)


def test_both_clouds_in_one():
    pair = frame()
    compared = against_scan(wall(), pair)
    in_view = reference_points(pair, compared, scanned=False)
    np.testing.assert_allclose(in_view[:, 2], 8.0)
    np.testing.assert_allclose(
        pair.rig.left.K[0, 0] * in_view[:, 0] / 8.0 + pair.rig.left.K[0, 2], compared.u
    )
    whole = reference_points(pair, compared, scanned=True)
    assert len(whole) == len(pair.scan)
    both = clouds_together(cloud_at([0], [0]), in_view)
    assert both.extra["source"].tolist() == [0] + [1] * len(in_view)
    assert tuple(both.rgb[0]) == (200, 200, 200)
