"""What cleaning removes and keeps, on surfaces that are known; kernels against numpy and scipy."""

from __future__ import annotations

import pickle
from dataclasses import fields, replace

import numpy as np
import pytest
from scipy import ndimage

from pseudolidar.errors import StereoConfig, StructureError
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters import clean_kernels as kernels
from pseudolidar.stereo.filters.clean import NO_SPECKLE_SHARE, REASONS, Clean, Cleaner
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose

HEIGHT, WIDTH = 96, 192
FOCAL_PX, BASELINE_M = 700.0, 0.5
FB = FOCAL_PX * BASELINE_M
SURE_PX = 0.15
ALL = Clean().load()
NOTHING = replace(Clean(), **{f.name: False for f in fields(Clean) if isinstance(f.default, bool)})


def frame(image=None) -> StereoFrame:
    K = np.array([[FOCAL_PX, 0, 96.0], [0, FOCAL_PX, 20.0], [0, 0, 1]])
    left = Camera(K, WIDTH, HEIGHT)
    right = Camera(K, WIDTH, HEIGHT, frame="camera_right")
    shift = Pose.from_rotation(
        "camera_right", "camera_left", np.eye(3), np.array([-BASELINE_M, 0, 0])
    )
    if image is None:
        image = np.random.default_rng(3).integers(0, 90, (HEIGHT, WIDTH), np.uint8)
    return StereoFrame(image, image, StereoRig(left, right, shift), "0", 0, 0)


def surface(values, sigma=SURE_PX) -> DisparityMap:
    values = np.asarray(values, np.float32).copy()
    return DisparityMap(values, np.where(np.isnan(values), np.nan, sigma).astype(np.float32))


def wall(depth_m=10.0):
    return np.full((HEIGHT, WIDTH), FB / depth_m)


def road():
    """A road 1.5 m below the camera, from 14 m to 45 m, where rays meet it at 2 degrees."""
    rows = np.arange(HEIGHT)[:, None] - 20.0
    depth_m = np.where(rows > 0, FOCAL_PX * 1.5 / np.maximum(rows, 1e-6), np.inf)
    values = np.broadcast_to(FB / depth_m, (HEIGHT, WIDTH)).copy()
    values[depth_m[:, 0] > 45] = np.nan
    return values


def removed(cleaned):
    return {name: cleaned.counts[f"pixels_removed_{name}"] for name in REASONS}


# --- what stays -------------------------------------------------------------------------------


@pytest.mark.parametrize("depth_m", [4.0, 10.0, 30.0])
def test_a_wall_stays(depth_m):
    cleaned = ALL(frame(), surface(wall(depth_m)))
    seen_by_both = int(FB / depth_m) + 1
    assert not cleaned.reason[:, seen_by_both:].any()
    assert cleaned.reason[:, : seen_by_both - 1].all()


def test_a_road_at_a_grazing_angle_stays_and_so_does_a_street_front():
    values = road()
    noise = np.random.default_rng(0).normal(0, SURE_PX, values.shape)
    cleaned = ALL(frame(), surface(values + noise))
    seen = np.isfinite(values) & (np.arange(WIDTH) > 30)
    assert cleaned.disparity.valid[seen].mean() > 0.995
    # 4 m to the right, along the direction of view: 0.125 px of disparity a column
    front = np.broadcast_to(BASELINE_M / 4.0 * (np.arange(WIDTH) + 80.0), (HEIGHT, WIDTH))
    cleaned = ALL(frame(), surface(front + noise))
    assert cleaned.disparity.valid[:, 40:].mean() > 0.995


@pytest.mark.parametrize("width_px", [3, 5, 9])
def test_a_thin_pole_before_a_wall_stays(width_px):
    """Its error is that of a pixel beside edges; a hole is on its left, as matchers leave it."""
    values = wall(25.0)
    values[:, 84:98] = np.nan
    values[:, 98 : 98 + width_px] = FB / 12.0
    cleaned = ALL(frame(), surface(values, sigma=0.8))
    assert cleaned.disparity.valid[:, 98 : 98 + width_px].mean() > 0.95


def test_cleaning_again_removes_less_and_moves_nothing():
    """Pixels beside those that went have holes beside them now; unsure ones of them go, too."""
    source = Synthetic("street", frames=6, width_px=621).open()
    pair = source.load(5)
    once = ALL(pair, Census().load()(pair))
    twice = ALL(pair, once.disparity)
    gone, again = (sum(removed(cleaned).values()) for cleaned in (once, twice))
    assert gone > 5000
    assert again < 0.6 * gone
    assert again < 0.2 * once.counts["pixels_kept_by_cleaning"]
    kept = twice.disparity.valid
    assert np.array_equal(twice.disparity.values[kept], once.disparity.values[kept])


# --- what goes --------------------------------------------------------------------------------


@pytest.mark.parametrize("known_sigma", [True, False])
def test_a_ramp_between_two_surfaces_goes(known_sigma):
    values = wall(25.0)
    values[:, 100:] = FB / 8.0
    ramp = np.linspace(FB / 25, FB / 8, 5)[1:4]
    values[:, 97:100] = ramp
    disparity = surface(values)
    cleaned = ALL(frame(), disparity if known_sigma else DisparityMap(disparity.values))
    assert (cleaned.reason[4:-4, 97:100] == kernels.FLYING).all()
    far, near = cleaned.reason[4:-4, 30:94], cleaned.reason[4:-4, 102:]
    assert not far.any()
    assert not near.any()
    assert (cleaned.disparity.sigma is not None) == known_sigma


def test_unsure_pixels_go_at_edges_before_they_go_anywhere():
    values = wall(15.0)
    values[:, 100:] = FB / 8.0
    unsure = surface(values, sigma=1.0)  # 0.64 m at 15 m, half of the tolerance of 1.25 m
    cleaned = ALL(frame(), unsure)
    assert (cleaned.reason[:, 97:100] == kernels.FLYING).all()
    assert not cleaned.reason[:, 40:96].any()
    hopeless = surface(values, sigma=5.0)
    assert (ALL(frame(), hopeless).reason[:, 40:96] == kernels.FAR).all()


def test_an_error_along_a_road_is_none():
    """Beside holes too: a point that slides along the road is still on it."""
    values = road()
    values[::1, 90:96] = np.nan
    disparity = surface(values, sigma=0.5)
    cleaned = replace(NOTHING, flying=True).load()(frame(), disparity)
    seen = disparity.valid & (np.arange(HEIGHT) > 60)[:, None]
    assert cleaned.disparity.valid[seen].mean() > 0.98
    upright = np.where(np.isnan(values), np.nan, FB / 20.0)
    cleaned = replace(NOTHING, flying=True).load()(frame(), surface(upright, sigma=0.5))
    assert not cleaned.disparity.valid[50:-4, 88:90].any()


def test_a_floating_patch_goes_by_its_area_and_near_ones_have_their_own_name():
    values = wall(20.0)
    values[30:36, 100:106] = FB / 12.0  # 0.1 m x 0.1 m
    values[60:66, 120:126] = FB / 3.0
    values[40:90, 140:180] = FB / 12.0  # 0.7 m x 0.9 m
    only = replace(NOTHING, speckle=True).load()
    cleaned = only(frame(), surface(values))
    assert removed(cleaned) == {**dict.fromkeys(REASONS, 0), "speckle": 36, "near_noise": 36}
    assert (cleaned.reason[30:36, 100:106] == kernels.SPECKLE).all()


def test_a_small_thing_so_near_that_it_fills_a_part_of_the_picture_stays():
    """0.05 m x 0.08 m half a metre away: a tenth of the area that a surface has elsewhere."""
    side = (round(0.05 * FOCAL_PX / 0.5), round(0.08 * FOCAL_PX / 0.5))
    assert side[0] * side[1] > NO_SPECKLE_SHARE * WIDTH * HEIGHT
    values = wall(20.0)
    values[20 : 20 + side[0], 60 : 60 + side[1]] = FB / 0.5
    values[20 + side[0] + 5 :, 60:63] = FB / 0.5  # a sliver of it
    only = replace(NOTHING, speckle=True).load()
    cleaned = only(frame(), surface(values))
    assert (cleaned.reason[20 : 20 + side[0], 60 : 60 + side[1]] == 0).all()
    assert (cleaned.reason[20 + side[0] + 5 :, 60:63] == kernels.NEAR).all()


def test_matches_outside_the_right_image_go():
    cleaned = replace(NOTHING, near_noise=True).load()(frame(), surface(wall(10.0)))
    assert removed(cleaned)["near_noise"] == HEIGHT * 35  # 35 px at 10 m


def test_isolated_points_go():
    values = np.full((HEIGHT, WIDTH), np.nan)
    values[50, 100], values[20, 50:52] = 35.0, 35.0
    values[70:80, 100:120] = 35.0
    cleaned = replace(NOTHING, isolated=True).load()(frame(), surface(values))
    assert removed(cleaned)["isolated"] == 3


def skyline(level, colour=(60, 90, 120)):
    """Sky above, a dark hedge below, a disparity halo of the hedge and a blob in the sky."""
    image = np.random.default_rng(2).integers(0, 60, (HEIGHT, WIDTH, 3), np.uint8)
    image[:48] = np.array(colour) * level / 120
    values = np.full((HEIGHT, WIDTH), np.nan)
    values[42:, 40:] = FB / 15.0
    values[10:20, 100:120] = FB / 60.0
    return frame(image), surface(values)


def test_sky_goes_and_what_stands_before_it_stays():
    pair, disparity = skyline(level=200)
    cleaned = replace(NOTHING, sky=True).load()(pair, disparity)
    assert (cleaned.reason[10:20, 100:120] == kernels.SKY).all()
    assert (cleaned.reason[42:48, 40:] == kernels.SKY).all(), "the halo"
    assert not cleaned.reason[48:].any()


def test_bright_walls_up_to_the_border_are_no_sky():
    """By what the matcher found there, and by their colour."""
    pair, _ = skyline(level=200)
    cleaned = ALL(pair, surface(wall(15.0)))
    assert not cleaned.reason[:, 40:].any()
    pair, disparity = skyline(level=200, colour=(120, 90, 60))
    cleaned = replace(NOTHING, sky=True).load()(pair, disparity)
    assert not cleaned.reason.any()


# --- figures and settings ----------------------------------------------------------------------


def test_counts_add_up_and_nothing_is_made():
    pair, disparity = skyline(level=200)
    cleaned = ALL(pair, disparity)
    assert sum(cleaned.counts.values()) == disparity.valid.sum()
    assert cleaned.counts["pixels_kept_by_cleaning"] == cleaned.disparity.valid.sum()
    kept = cleaned.reason == 0
    assert np.array_equal(cleaned.disparity.values[kept], disparity.values[kept], equal_nan=True)
    assert np.isnan(cleaned.disparity.values[~kept]).all()
    assert np.isnan(cleaned.disparity.sigma[~kept]).all()
    assert np.isfinite(disparity.values[~kept]).all(), "the map that was given stays as it is"


def test_none_and_no_part_keep_everything():
    pair, disparity = skyline(level=200)
    assert Cleaner.load(None)(pair, disparity).disparity is disparity
    assert Cleaner.load(None)(pair, disparity).counts == {}
    cleaned = NOTHING.load()(pair, disparity)
    assert not cleaned.reason.any()
    assert np.array_equal(cleaned.disparity.values, disparity.values, equal_nan=True)


def test_the_cleaner_can_be_sent_to_another_process():
    pair, disparity = skyline(level=200)
    there = pickle.loads(pickle.dumps(ALL))(pair, disparity)
    assert np.array_equal(there.reason, ALL(pair, disparity).reason)


def test_16_bit_and_grey_pairs_are_cleaned_alike():
    pair, disparity = skyline(level=200)
    grey = pair.left.mean(axis=2).astype(np.uint8)
    deep = replace(pair, left=pair.left.astype(np.uint16) << 4, right=pair.right.astype(np.uint16))
    for other in (replace(pair, left=grey, right=grey), deep):
        assert (ALL(other, disparity).reason[10:20, 100:120] == kernels.SKY).all()


@pytest.mark.parametrize(
    "wrong",
    [{"angle_deg": 90.0}, {"edge_error": 0.0}, {"neighbours": 0}, {"speckle_m2": float("nan")}],
)
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(StereoConfig, match=next(iter(wrong))):
        Clean(**wrong)


def test_another_size_is_refused():
    with pytest.raises(StructureError):
        ALL(frame(), DisparityMap(np.ones((4, 4), np.float32)))


# --- kernels against numpy and scipy ------------------------------------------------------------


def noise_map(seed):
    """Patches of many sizes, steps and holes."""
    rng = np.random.default_rng(seed)
    values = ndimage.gaussian_filter(rng.normal(0, 1, (HEIGHT, WIDTH)), 3) * 60 + 25
    values = np.round(values / 4) * 4 + rng.normal(0, 0.3, values.shape)
    values[rng.random(values.shape) < 0.15] = np.nan
    values[~(values > 1)] = np.nan
    return values.astype(np.float32), rng.uniform(0.1, 1.5, values.shape).astype(np.float32)


@pytest.mark.parametrize("seed", range(5))
def test_speckles_are_the_small_parts_that_a_graph_finds(seed):
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    values, _ = noise_map(seed)
    reason = np.zeros(values.shape, np.uint8)
    area_m2 = 0.05
    # What a pixel counts for at least, from 32 px of disparity on: 200 of them are no speckle.
    pixel_m2 = area_m2 / 200
    kernels.mark_speckles(values, reason, 0.5, 0.02, BASELINE_M, 0.0, area_m2, pixel_m2, 1e9, 1e9)

    number = np.arange(values.size).reshape(values.shape)
    links = []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[1:], np.s_[:-1])):
        limit = np.float32(0.5) + np.float32(0.02) * values[a]
        near = np.abs(values[b] - values[a]) <= limit
        links.append(np.stack([number[a][near], number[b][near]]))
    i, j = np.hstack(links)
    _, part = connected_components(coo_matrix((np.ones(len(i)), (i, j)), (values.size,) * 2))
    # The area of a run of pixels is that of its mean disparity: close to the sum over pixels.
    known = np.isfinite(values).ravel()
    side_m = BASELINE_M / np.nan_to_num(values.ravel(), nan=1.0)
    each = np.where(known, np.maximum(side_m**2, pixel_m2), 0)
    area = np.bincount(part, each)[part]
    marked = reason.ravel() == kernels.SPECKLE
    sure = known & (np.abs(area / area_m2 - 1) > 0.05)
    assert 0.02 < marked[known].mean() < 0.98
    assert np.array_equal(marked[sure], area[sure] < area_m2)


@pytest.mark.parametrize("seed", range(3))
def test_edges_are_those_of_numpy(seed):
    values, sigma = noise_map(seed)
    s = Clean()
    only = replace(NOTHING, flying=True, far_ghosts=True)
    reason = only.load()(frame(), DisparityMap(values, sigma)).reason

    d, reach = values.astype(np.float64), kernels.EDGE_REACH
    size = 2 * reach + 1
    low, high = np.where(np.isnan(d), -1e4, d), np.where(np.isnan(d), 1e4, d)
    largest = ndimage.maximum_filter(low, size, mode="constant", cval=-1e4)
    smallest = ndimage.minimum_filter(high, size, mode="constant", cval=1e4)
    share = ndimage.uniform_filter(np.isfinite(d).astype(float), size, mode="mirror")
    side = np.ones((1, 2 * kernels.THIN_REACH + 1), bool)
    side[0, kernels.THIN_REACH + 1 :] = False
    left = ndimage.minimum_filter(high, footprint=side, mode="constant", cval=1e4)
    right = ndimage.minimum_filter(high, footprint=side[:, ::-1], mode="constant", cval=1e4)
    with np.errstate(invalid="ignore"):
        depth_m = FB / d
        ratio = depth_m**2 / FB * sigma / (0.5 + 0.05 * depth_m)
        per_px = d / (FOCAL_PX * np.tan(np.deg2rad(s.angle_deg)))
        gap = np.maximum(reach * np.maximum(kernels.STEEPEST, per_px), s.gap_sigmas * sigma)
        before, behind = largest - d > gap, d - smallest > gap
        free = (d - left > gap) & (d - right > gap)
        factor = np.select(
            [before, free, behind], [1.0, kernels.THIN_FACTOR, kernels.FRONT_FACTOR], 1.0
        )
        edge = before | behind | (share < kernels.WHOLE_SHARE)
        unsure = edge & (ratio > s.edge_error * factor)
        between = np.zeros(d.shape, bool)
        for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
            ahead, back = (
                np.roll(d, (sign * reach * dy, sign * reach * dx), (0, 1)) - d for sign in (-1, 1)
            )
            inside = np.zeros(d.shape, bool)
            inside[reach * dy : HEIGHT - reach * dy, reach * abs(dx) : WIDTH - reach * abs(dx)] = 1
            between |= inside & ((ahead > gap) & (back < -gap) | (ahead < -gap) & (back > gap))
        below = np.full(d.shape, np.nan)
        above = below.copy()
        k = kernels.SLANT_REACH
        below[:-k], above[k:] = d[k:] - d[:-k], d[k:] - d[:-k]
        slope = (below + above) / (2 * k)
        bent = np.abs(below - above) > kernels.BENT * (below + above)
        allowed_px = s.edge_error * (0.5 + 0.05 * depth_m) * FOCAL_PX / depth_m
        slanted = (slope <= kernels.STEEPEST) & (below > 0) & (above > 0) & ~bent
        slanted &= (np.arange(HEIGHT)[:, None] >= k) & (np.arange(HEIGHT)[:, None] < HEIGHT - k)
        slanted &= sigma <= slope * allowed_px
    wanted = np.where(
        (ratio > s.far_error) & ~slanted,
        kernels.FAR,
        np.where((unsure & ~slanted) | (before & behind & between), kernels.FLYING, 0),
    )
    wanted[np.isnan(d)] = 0
    assert set(np.unique(wanted)) == {0, kernels.FAR, kernels.FLYING}
    assert (wanted != reason).mean() < 1e-4  # single precision at a limit


@pytest.mark.parametrize("seed", range(3))
def test_isolated_points_are_those_of_numpy(seed):
    values, sigma = noise_map(seed)
    values[np.random.default_rng(seed).random(values.shape) < 0.6] = np.nan
    only = replace(NOTHING, isolated=True)
    reason = only.load()(frame(), DisparityMap(values, sigma)).reason
    reach = kernels.LONELY_REACH
    padded = np.pad(values, reach, constant_values=np.nan)
    step = reach * np.maximum(values / np.float32(FOCAL_PX), np.float32(kernels.STEEPEST))
    near = np.maximum(np.float32(Clean().gap_sigmas) * sigma, step)
    count = np.full(values.shape, -1)
    for dy in range(2 * reach + 1):
        for dx in range(2 * reach + 1):
            other = padded[dy : dy + HEIGHT, dx : dx + WIDTH]
            count += np.abs(other - values) <= near
    wanted = np.isfinite(values) & (count < Clean().neighbours)
    assert 0.02 < wanted[np.isfinite(values)].mean() < 0.9
    assert np.array_equal(reason == kernels.ISOLATED, wanted)
