import numpy as np
import pytest

from pseudolidar.errors import UsageError
from pseudolidar.evaluation.comparison.bins import DEFAULT_BINS, DepthBins
from pseudolidar.evaluation.comparison.bootstrap import CELLS, FrameBootstrap, interval
from pseudolidar.evaluation.comparison.figures import (
    FIGURES,
    DepthFigures,
    depth_figures,
    figures_by_range,
)
from pseudolidar.evaluation.comparison.points import ComparedPoints
from pseudolidar.evaluation.comparison.profiles import error_by_column, error_by_disparity


def points(depth_m, reference_m, frame=None, *, error_px=None, sigma_px=None) -> ComparedPoints:
    n = len(depth_m)
    return ComparedPoints(
        frames=1 if frame is None else int(np.max(frame)) + 1,
        frame=np.zeros(n, np.int64) if frame is None else np.asarray(frame, np.int64),
        reference_m=np.asarray(reference_m, np.float64),
        depth_m=np.asarray(depth_m, np.float64),
        reference_px=400 / np.asarray(reference_m, np.float64),
        error_px=np.zeros(n) if error_px is None else np.asarray(error_px, np.float64),
        column=np.linspace(0, 1, n),
        sigma_px=None if sigma_px is None else np.asarray(sigma_px, np.float64),
    )


def test_figures_by_hand():
    # off by +10 %, -10 %, +30 %, nothing, and one that stereo does not have
    found = depth_figures(
        points(
            [11.0, 9.0, 13.0, 10.0, np.nan],
            [10.0] * 5,
            error_px=[0.5, 2.0, 3.0, 0.0, np.nan],
            sigma_px=[1.0] * 5,
        )
    )
    assert (found.reference, found.n, found.density) == (5, 4, 0.8)
    assert found.median_rel == pytest.approx(0.1)
    assert found.p90_rel == pytest.approx(0.1 + 0.7 * 0.2)  # 2.7th of 0, 0.1, 0.1, 0.3
    assert found.bias_rel == pytest.approx(0.05)  # between 0 and 0.1
    assert found.abs_rel == pytest.approx(0.5 / 4)
    assert found.rmse_m == pytest.approx(np.sqrt((1 + 1 + 9) / 4))
    logs = np.log([1.1, 0.9, 1.3, 1.0])
    assert found.rmse_log == pytest.approx(np.sqrt((logs**2).mean()))
    assert found.delta_1_05 == 0.25
    assert found.delta_1_25 == 0.75
    assert found.within_1_sigma == 0.5
    assert found.within_95 == 0.75  # the radius is 2.8 sigma
    assert found.intervals == {}


def test_inliers_count_both_ways():
    # too near by the factor 1.2 is off by less than 1.25 as well; 8 m for 10 m is not less
    found = depth_figures(points([12.4, 8.1, 8.0, 12.6], [10.0] * 4))
    assert found.delta_1_25 == 0.5


def test_every_bin_is_listed_and_its_lower_edge_is_in_it():
    bins = figures_by_range(points([5.0, 10.0, 20.1, 80.0], [5.0, 10.0, 20.0, 80.0]), DEFAULT_BINS)
    assert [(b.from_m, b.to_m) for b in bins] == [(5, 10), (10, 20), (20, 30), (30, 50), (50, 80)]
    assert [b.figures.n for b in bins] == [1, 1, 1, 0, 0]
    empty = bins[3].as_dict()
    assert empty["n"] == 0
    assert all(empty[name] is None for name in FIGURES)


def test_bins_of_ones_own():
    assert DepthBins.parse("0,5, 10").edges_m == (0, 5, 10)
    assert str(DepthBins.parse("0,5,10")) == "0,5,10"
    for text in ("", "5", "5,5", "10,5", "-1,5", "1.5,3", "a,b"):
        with pytest.raises(UsageError):
            DepthBins.parse(text)


def frames_with_errors(rng, frames: int, each: int) -> ComparedPoints:
    """Points whose errors are shared within a frame: what makes resampling points wrong."""
    frame = np.repeat(np.arange(frames), each)
    shared = rng.normal(0, 0.05, frames)[frame]
    depth_m = 10.0 * (1 + shared + rng.normal(0, 0.02, len(frame)))
    return points(depth_m, np.full(len(frame), 10.0), frame)


@pytest.mark.parametrize("each", [40, 2 * CELLS // 10])  # ranked exactly, and in cells
def test_resampled_figures_are_those_of_the_frames_drawn(each):
    rng = np.random.default_rng(3)
    every = frames_with_errors(rng, 12, each)
    bootstrap = FrameBootstrap(12, resamples=25)
    relative = every.depth_m / 10.0 - 1
    median, p90 = bootstrap.quantiles(relative, every.frame, (0.5, 0.9))
    for row in range(25):
        times = bootstrap.drawn[row].astype(int)
        drawn = np.concatenate([np.tile(relative[every.frame == f], times[f]) for f in range(12)])
        # a cell is 0.05 % of the points; the estimates themselves spread by 0.02
        tolerance = 1e-12 if each == 40 else 5e-4
        assert median[row] == pytest.approx(np.median(drawn), abs=tolerance)
        assert p90[row] == pytest.approx(np.quantile(drawn, 0.9), abs=tolerance)
        total = bootstrap.sums(relative, every.frame)[row]
        assert total == pytest.approx(drawn.sum())


def test_intervals_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(200):
        every = frames_with_errors(rng, 30, 20)
        relative = every.depth_m / every.reference_m - 1
        bootstrap = FrameBootstrap(30, resamples=300, seed=1)
        low, high = interval(bootstrap.quantiles(relative, every.frame, (0.5,))[0])
        held += low <= 0 <= high
        assert low <= np.median(relative) <= high
    # 95 % are meant; percentile intervals of 30 frames hold somewhat less, 200 trials +- 3 %
    assert 0.88 <= held / 200 <= 0.99


def test_every_figure_has_an_interval_and_one_frame_has_none():
    rng = np.random.default_rng(7)
    every = frames_with_errors(rng, 5, 50)
    with_sigma = points(
        every.depth_m,
        every.reference_m,
        every.frame,
        error_px=rng.normal(size=250),
        sigma_px=np.ones(250),
    )
    found = depth_figures(with_sigma, FrameBootstrap(5))
    assert set(found.intervals) == set(FIGURES)
    one = depth_figures(points([10.0], [10.0]), FrameBootstrap(1))
    assert one.intervals == {}


def test_intervals_of_nothing():
    nothing = depth_figures(points([], []), FrameBootstrap(3))
    assert nothing == DepthFigures(0, 0)
    assert interval(np.array([np.nan])) is None


def test_same_intervals_every_time():
    rng = np.random.default_rng(11)
    every = frames_with_errors(rng, 6, 30)
    first, second = (depth_figures(every, FrameBootstrap(6)) for _ in range(2))
    assert first.intervals == second.intervals


def test_error_by_column_and_disparity():
    every = points(
        [10.0] * 4, [100.0, 50.0, 25.0, 10.0], error_px=[1.0, -1.0, np.nan, 3.0]
    )  # 4, 8, 16 and 40 px
    strips = error_by_column(every, 1600)
    assert (strips[0].from_px, strips[0].to_px, strips[-1].to_px) == (0, 100, 1600)
    assert [strip.n for strip in strips] == [1, *[0] * 4, 1, *[0] * 9, 1]
    assert strips[0].median_px == 1.0
    bands = {(band.from_px, band.to_px): band for band in error_by_disparity(every)}
    assert bands[(4, 6)].median_px == 1.0
    assert (bands[(8, 11)].median_px, bands[(8, 11)].median_abs_px) == (-1.0, 1.0)
    assert (bands[(16, 23)].n, bands[(16, 23)].median_px) == (0, None)
    assert bands[(32, 45)].n == 1
