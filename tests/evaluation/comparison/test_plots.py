"""Plots show the figures that they are given, in colours that everybody can tell apart."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from pseudolidar.evaluation.compared import against_scan
from pseudolidar.evaluation.comparison.comparison import compare_frames
from pseudolidar.evaluation.comparison.error_cloud import RIGHT, TOO_FAR, TOO_NEAR, error_colours
from pseudolidar.evaluation.comparison.plots import frames as frame_plots
from pseudolidar.evaluation.comparison.plots.by_range import range_error_plot
from pseudolidar.evaluation.comparison.plots.frames import (
    birds_eye_plot,
    frames_plot,
    photo_error_plot,
    worst_frames,
)
from pseudolidar.evaluation.comparison.plots.profiles import column_bias_plot, disparity_bias_plot
from pseudolidar.evaluation.comparison.plots.sigma import (
    calibration_plot,
    reliability_plot,
    sparsification_plot,
)
from pseudolidar.evaluation.comparison.plots.style import error_map
from pseudolidar.structures.disparity import DisparityMap
from tests.evaluation.test_lidar import HEIGHT_PX, WIDTH_PX, frame, wall

# What people without one of the three kinds of cones see, of linear RGB.
# Source: Machado, Oliveira & Fernandes, IEEE TVCG 15 (6), 2009, table of severity 1.0.
SEEN = {
    "all": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                   [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                     [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                   [0.004733, 0.691367, 0.303900]],
}  # fmt: skip
# A difference of 2.3 is just noticed (CIE76); this one is seen at a glance in small dots.
CLEARLY_DIFFERENT = 20.0


def as_seen(colour: tuple[int, int, int], eyes: str) -> np.ndarray:
    """CIE Lab of an sRGB colour 0-255."""
    srgb = np.array(colour) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(SEEN[eyes]) @ linear, 0, 1)
    back = np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055)
    return cv2.cvtColor(back.astype(np.float32).reshape(1, 1, 3), cv2.COLOR_RGB2LAB)[0, 0]


@pytest.mark.parametrize("eyes", SEEN)
def test_everybody_can_tell_the_colours_of_errors_apart(eyes):
    named = [to_rgb(c) for c in (frame_plots.UNMATCHED, frame_plots.GROUND, frame_plots.LIDAR)]
    others = [tuple(round(255 * level) for level in colour) for colour in named]
    colours = [as_seen(c, eyes) for c in (TOO_NEAR, RIGHT, TOO_FAR, *others)]
    apart = [np.linalg.norm(a - b) for a, b in combinations(colours, 2)]
    assert min(apart) > CLEARLY_DIFFERENT


def test_red_and_green_would_not_do():
    apart = np.subtract(*(as_seen(c, "deuteranopia") for c in ((170, 60, 40), (100, 105, 40))))
    assert np.linalg.norm(apart) < CLEARLY_DIFFERENT


def test_plots_and_clouds_have_the_same_colours():
    relative = np.array([-0.2, -0.1, -0.03, 0.0, 0.06, 0.1, 0.3])
    drawn = error_map()(np.clip(relative / 0.2 + 0.5, 0, 1))[:, :3]
    np.testing.assert_allclose(255 * drawn, error_colours(relative), atol=1.5)


@pytest.fixture(scope="module")
def compared():
    """Three frames of a wall at 8 m, seen at 10 m, in the left half of the picture."""
    seen = DisparityMap(wall().values, np.full((HEIGHT_PX, WIDTH_PX), 0.4, np.float32))
    one = against_scan(seen, frame())
    return compare_frames([replace(one, id=f"{i}", index=i) for i in range(3)])


def heights(axes) -> np.ndarray:
    return np.concatenate([line.get_ydata() for line in axes.lines if line.get_marker() == "o"])


def test_ranges_show_their_figures_and_leave_out_empty_bins(compared):
    median, p90, bias = range_error_plot(compared.by_range).axes
    known = [each.figures for each in compared.by_range if each.figures.n]
    assert 0 < len(known) < len(compared.by_range)
    np.testing.assert_allclose(heights(median), [100 * f.median_rel for f in known])
    for axes, name in ((p90, "p90_rel"), (bias, "bias_rel")):
        shown = [line.get_ydata() for line in axes.lines if len(line.get_ydata()) == len(known)]
        assert any(np.allclose(y, [100 * getattr(f, name) for f in known]) for y in shown)
    assert [label.get_text() for label in median.get_xticklabels()] == [
        f"{each.from_m}-{each.to_m}" for each in compared.by_range
    ]


@pytest.mark.parametrize(
    ("draw", "name"),
    [(column_bias_plot, "by_column"), (disparity_bias_plot, "by_disparity")],
)
def test_profiles_show_the_median_of_every_band_that_has_points(compared, draw, name):
    bins = getattr(compared, name)
    figure = draw(bins)
    known = [each.median_px for each in bins if each.n]
    np.testing.assert_allclose(heights(figure.axes[0]), known)
    assert "px" in figure.axes[0].get_ylabel()
    assert "px" in figure.axes[1].get_xlabel()
    bars = [bar.get_height() for bar in figure.axes[1].patches]
    assert 1e3 * sum(bars) == pytest.approx(sum(each.n for each in bins))


def test_calibration_passes_through_what_a_right_sigma_promises():
    # errors of which 68.27 % are within one sigma, 95 % within 2.8
    size = np.concatenate([np.full(6827, 0.5), np.full(2673, 2.0), np.full(500, 4.0)])
    found = next(
        line for line in calibration_plot(size, np.ones(10_000)).axes[0].lines
        if line.get_label() == "found"
    )  # fmt: skip
    at = dict(zip(np.round(found.get_xdata(), 2), found.get_ydata(), strict=True))
    assert at[1.0] == pytest.approx(68.27)
    assert at[2.8] == pytest.approx(95.0)
    assert at[5.0] == 100


def test_groups_of_a_right_sigma_lie_on_the_diagonal():
    sigma = np.geomspace(0.2, 3.0, 60_000)
    error = sigma * np.random.default_rng(1).standard_normal(len(sigma))
    axes = reliability_plot(error, sigma).axes[0]
    stated, found = next(x for x in axes.lines if x.get_label() == "found").get_data()
    np.testing.assert_allclose(found, stated, rtol=0.12)
    assert len(stated) == 12


def test_points_lie_on_the_photo_where_the_reference_has_them(compared):
    seen = compared.frames[0]
    figure = photo_error_plot(np.zeros((HEIGHT_PX // 2, WIDTH_PX // 2, 3), np.uint8), seen)
    axes, bar = figure.axes
    bare, dots = axes.collections
    assert len(bare.get_offsets()) == (~seen.matched).sum()
    places = {tuple(place) for place in dots.get_offsets().data}
    assert places == set(zip(seen.u[seen.matched], seen.v[seen.matched], strict=True))
    np.testing.assert_allclose(dots.get_array(), 25.0, rtol=1e-4)  # 10 m in place of 8 m
    assert axes.get_xlim() == (-0.5, WIDTH_PX - 0.5)
    assert axes.get_ylim() == (HEIGHT_PX - 0.5, -0.5)
    assert "%" in bar.get_ylabel()


def test_both_clouds_lie_on_the_same_rays_from_above(compared):
    seen = compared.frames[0]
    axes = birds_eye_plot(seen).axes[0]
    reference, stereo = (dots.get_offsets().data for dots in axes.collections)
    np.testing.assert_allclose(reference[:, 0], 8.0, rtol=1e-5)
    np.testing.assert_allclose(stereo[:, 0], 10.0, rtol=1e-5)
    slopes = reference[seen.matched][:, 1] / 8.0
    np.testing.assert_allclose(stereo[:, 1] / 10.0, slopes, atol=1e-6)
    left = seen.u < seen.rig.left.K[0, 2]
    assert (reference[left, 1] > 0).all()  # left is up
    assert axes.get_ylim()[1] > axes.get_ylim()[0]


def test_worst_frames_come_first_and_frames_without_points_not_at_all(compared):
    frames = [
        replace(each, id=name, overall=replace(each.overall, median_rel=median))
        for each, name, median in zip(
            compared.per_frame, "abc", (0.02, None, 0.05), strict=True
        )
    ]  # fmt: skip
    assert [each.id for each in worst_frames(frames)] == ["c", "a"]
    assert [each.id for each in worst_frames(frames, 1)] == ["c"]
    named = [text.get_text() for text in frames_plot(frames).axes[0].texts]
    assert named == ["c"]


def test_nothing_to_draw_is_said():
    empty = np.empty(0)
    for figure in (
        calibration_plot(empty, empty),
        reliability_plot(empty, empty),
        sparsification_plot(None),
        frames_plot([]),
    ):
        assert [text.get_text() for text in figure.axes[0].texts] == ["no points"]
        figure.canvas.draw()
