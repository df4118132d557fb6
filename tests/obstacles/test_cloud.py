"""Things found by their points alone, and by their distance."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pseudolidar.errors import UsageError
from pseudolidar.obstacles.cloud import Cloud
from pseudolidar.obstacles.overlap import box_iou
from pseudolidar.obstacles.within import Band, Range
from pseudolidar.structures.disparity import DepthMap
from tests.obstacles.pictures import blind
from tests.obstacles.scene import Thing, box_px, sight

CAR: Thing = ("Car", -1.5, 12.0, 1.65, 1.53)
FAR_CAR: Thing = ("Car", 2.5, 30.0, 1.65, 1.53)
PERSON: Thing = ("Pedestrian", 3.0, 15.0, 0.65, 1.74)
POLE: Thing = ("Pole", 0.6, 10.0, 0.15, 2.2)
KERB: Thing = ("Kerb", 3.0, 8.0, 3.0, 0.15)
VERGE: Thing = ("Verge", -3.0, 9.0, 2.0, 0.36)
NEAR = Range(Band(2, 20))
# The wall behind everything is at 60 m.
CLOUD = Cloud(farthest=50)


def boxes(found):
    return [one.box_px for one in found]


@pytest.mark.parametrize(
    ("settings", "things"),
    [(CLOUD, (POLE, CAR, PERSON, FAR_CAR)), (NEAR, (POLE, CAR, PERSON))],
)
def test_things_are_found_nearest_first_and_ground_wall_and_kerb_are_not(settings, things) -> None:
    one = sight((CAR, FAR_CAR, PERSON, POLE, KERB, VERGE))
    found = settings.load()(one)
    assert len(found) == len(things)
    for thing, detection in zip(things, found, strict=True):
        assert box_iou(detection.box_px, box_px(thing)) > 0.75, thing
        inside = one.depth.values[detection.mask]
        assert np.isfinite(inside).all()
        assert np.median(inside) == pytest.approx(thing[2], rel=0.05)
        assert not (detection.mask & one.is_ground).any()
        assert 0.5 < detection.score < 1


def test_the_neighbourhood_grows_with_the_error_of_depths() -> None:
    """One thing stays one where depths scatter by metres; 3 m beside it is another."""
    near, far = ("Car", -1.2, 45.0, 1.65, 1.53), ("Car", 1.8, 45.0, 1.65, 1.53)
    one = sight((near, far))
    noise = np.random.default_rng(3).standard_normal(one.depth.values.shape)
    scattered = one.depth.values + one.depth.sigma * noise.astype(np.float32)
    scattered = dataclasses.replace(one, depth=DepthMap(scattered, one.depth.sigma))
    found = Cloud(farthest=52, least_pixels=20).load()(scattered)
    near_wall = [d for d in found if d.box_px[2] - d.box_px[0] < 40]
    overlaps = [max(box_iou(d.box_px, box_px(t)) for d in near_wall) for t in (near, far)]
    assert min(overlaps) > 0.5
    # With points said to be exact, things fall apart.
    exact = DepthMap(scattered.depth.values, np.full_like(one.depth.values, 1e-4))
    exact = dataclasses.replace(scattered, depth=exact, shared_px=0.0)
    found = Cloud(farthest=52, least_pixels=20).load()(exact)
    overlaps = [max([box_iou(d.box_px, box_px(t)) for d in found] + [0]) for t in (near, far)]
    assert min(overlaps) < 0.3


def test_a_lorry_is_whole_and_what_hangs_over_a_car_is_not_the_car() -> None:
    lorry: Thing = ("Truck", 3.0, 16.0, 2.5, 3.6)
    one = sight((lorry, CAR))
    depth, sigma = one.depth.values.copy(), one.depth.sigma.copy()
    left, top, right, _ = (round(edge) for edge in box_px(CAR))
    hanging = np.s_[: top - 29, left - 20 : right + 20]  # from 2.4 m above the ground
    depth[hanging], sigma[hanging] = 12.0, sigma[top + 5, left + 5]
    found = CLOUD.load()(dataclasses.replace(one, depth=DepthMap(depth, sigma)))
    assert len(found) == 2
    for thing, detection in zip((CAR, lorry), found, strict=True):
        assert box_iou(detection.box_px, box_px(thing)) > 0.75


def test_a_speck_in_the_sky_above_a_thing_is_not_part_of_it() -> None:
    tall: Thing = ("Pole", 1.0, 8.0, 0.8, 2.4)
    one = sight((tall,))
    depth, sigma = one.depth.values.copy(), one.depth.sigma.copy()
    left, top, right, _ = (round(edge) for edge in box_px(tall))
    depth[0:6, left + 5 : left + 20] = 8.0
    sigma[0:6] = sigma[top + 5, left + 5]
    # What hides the middle of a thing does not make a speck of a part of it.
    depth[top + 30 : top + 50, left : right + 1] = np.nan
    (found,) = CLOUD.load()(dataclasses.replace(one, depth=DepthMap(depth, sigma)))
    assert box_iou(found.box_px, box_px(tall)) > 0.85


def test_two_things_side_by_side_at_different_depths_are_two() -> None:
    one = sight((("Car", 0.0, 10.0, 1.65, 1.53), ("Car", 1.4, 14.0, 1.65, 1.53)))
    for settings in (CLOUD, NEAR):
        found = settings.load()(one)
        assert len(found) == 2
        assert not (found[0].mask & found[1].mask).any()


def test_in_flight_there_is_no_ground() -> None:
    one = sight((POLE, PERSON))
    depth = one.depth.values.copy()
    depth[one.is_ground] = np.nan
    flying = DepthMap(depth, one.depth.sigma)
    one = dataclasses.replace(one, depth=flying, ground=None, is_ground=None)
    for settings in (CLOUD, NEAR):
        found = settings.load()(one)
        assert len(found) == 2
        for thing, detection in zip((POLE, PERSON), found, strict=True):
            assert box_iou(detection.box_px, box_px(thing)) > 0.75


def test_least_size_and_least_pixels_and_reach_of_sight() -> None:
    one = sight((CAR, FAR_CAR, POLE))
    assert len(CLOUD.load()(one)) == 3
    assert len(Cloud(farthest=20).load()(one)) == 2
    assert len(Cloud(farthest=50, least_pixels=600).load()(one)) == 2
    assert len(Cloud(farthest=50, least=2.0).load()(one)) == 1
    assert len(Range(Band(0, 11)).load()(one)) == 1
    assert Range(Band(0, 11), least=3.0).load()(one) == ()


@pytest.mark.parametrize("settings", [CLOUD, NEAR])
def test_nothing_is_a_valid_result(settings) -> None:
    detect = settings.load()
    assert detect(sight(())) == ()
    assert detect(blind(sight((CAR,)))) == ()


@pytest.mark.parametrize("settings", [CLOUD, NEAR])
def test_depths_without_sigma_and_of_one_camera(settings) -> None:
    one = sight((CAR,))
    told = dataclasses.replace(one, depth=DepthMap(one.depth.values))
    alone = dataclasses.replace(told, rig=None, shared_px=0.0)
    for changed in (told, alone):
        (found,) = settings.load()(changed)
        assert box_iou(found.box_px, box_px(CAR)) > 0.75


@pytest.mark.parametrize(
    "bad",
    [
        lambda: Cloud(reach=0),
        lambda: Cloud(reach=float("nan")),
        lambda: Cloud(above=3),
        lambda: Range(Band(1, 2), least=-1),
        lambda: Band.parse("10-2"),
        lambda: Band.parse("a-b"),
        lambda: Band.parse("1-2-3"),
        lambda: Band.parse("-3"),
    ],
)
def test_bad_settings_are_named(bad) -> None:
    with pytest.raises(UsageError) as error:
        bad()
    assert error.value.got
    assert error.value.want


def test_bands_as_people_write_them() -> None:
    assert Band.parse("2-10") == Band(2, 10) == Band.parse(" 2 - 10m")
    assert Band.parse("10") == Band(0, 10)
    assert Band.parse(str(Band(0.5, 2))) == Band(0.5, 2)
