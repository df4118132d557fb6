from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.evaluation.compared import ComparedFrame, against_scan
from pseudolidar.evaluation.comparison.comparison import compare_frames
from pseudolidar.evaluation.comparison.points import ComparedPoints
from pseudolidar.evaluation.comparison.speeds import forward_speeds
from pseudolidar.structures.disparity import DisparityMap
from tests.evaluation.test_lidar import HEIGHT_PX, WIDTH_PX, frame, wall

SECOND_NS = 1_000_000_000


def at(time_s: float, place_m: float | None) -> ComparedFrame:
    place = None if place_m is None else np.array([place_m, 0.0, 0.0])
    return replace(
        against_scan(wall(), frame()), timestamp_ns=round(time_s * SECOND_NS), place_m=place
    )


def test_speeds_between_the_frames_beside():
    speeds = forward_speeds([at(0.0, 0.0), at(0.1, 1.0), at(0.2, 3.0), at(5.0, 60.0)])
    np.testing.assert_allclose(speeds[:2], [10.0, 15.0])
    assert np.isnan(speeds[2:]).all()  # the last one is too far away to tell
    assert np.isnan(forward_speeds([at(0.0, None), at(0.1, 1.0)])).all()
    assert np.isnan(forward_speeds([at(0.0, 1.0)])).all()


def test_a_point_beyond_infinity_is_none():
    values = wall().values.copy()
    values[: HEIGHT_PX // 2] = 0.0
    points = ComparedPoints.of([against_scan(DisparityMap(values), frame())])
    assert points.matched.mean() == pytest.approx(0.5, abs=0.05)
    np.testing.assert_array_equal(np.isfinite(points.error_px), points.matched)


def test_thinning_is_even_and_keeps_rows_together():
    whole = against_scan(wall(slice(0, 30)), frame())
    few = whole.thinned(100)
    assert 90 <= len(few) <= 100
    assert few.matched.mean() == pytest.approx(whole.matched.mean(), abs=0.1)
    pixels = set(zip(whole.u, whole.v, whole.disparity_px.astype(str), strict=True))
    assert set(zip(few.u, few.v, few.disparity_px.astype(str), strict=True)) <= pixels
    assert len(whole.thinned(10**6)) == len(whole)


def test_everything_of_a_wall_that_is_seen_too_far_away():
    sigma = DisparityMap(wall().values, np.full((HEIGHT_PX, WIDTH_PX), 0.4, np.float32))
    found = compare_frames(
        [against_scan(sigma, frame()), against_scan(sigma, frame())],
        subject="a wall",
        reference="a scan",
    )
    # at 8 m, seen at 10 m: 3.125 px, matched 2.5 px; total sigma hypot(0.4, 0.5) px
    near = found.by_range[0].figures
    assert near.n == near.reference == WIDTH_PX * HEIGHT_PX // 2
    assert (near.median_rel, near.bias_rel) == pytest.approx((0.25, 0.25), rel=1e-5)
    assert near.rmse_m == pytest.approx(2.0, rel=1e-5)
    assert (near.delta_1_05, near.within_1_sigma, near.within_95) == (0, 1, 1)
    bands = {band.from_px: band.median_px for band in found.by_disparity if band.n}
    assert bands == {0: pytest.approx(-0.625)}
    assert found.overall == near
    assert len(found.per_frame) == 2
    assert found.per_frame[1].overall.n == near.n // 2
    assert found.timing is None  # nobody knows where the rig stood
    told = found.as_dict()
    assert (told["subject"], told["reference"], told["frames"]) == ("a wall", "a scan", 2)
    assert told["within_1_sigma"] == 1
    assert told["bins"][1]["n"] == 0


def test_the_time_offset_is_looked_for_where_places_are_known():
    frames = [at(0.1 * i, 1.0 * i) for i in range(5)]
    assert compare_frames(frames).timing is not None
    assert compare_frames(frames, scanned=False).timing is None
