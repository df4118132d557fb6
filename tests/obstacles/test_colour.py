"""Things of one colour."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import ImageFormat, UsageError
from pseudolidar.obstacles.colour import Colour
from pseudolidar.obstacles.hues import Hues
from tests.obstacles.pictures import blind, painted, seen, textured

RED, MAGENTA_RED, BLUE = (190, 20, 25), (190, 15, 40), (20, 40, 200)
BOX = (100.3, 60.8, 151.6, 90.2)


def find(image, hues="red", **settings):
    return Colour(Hues.parse(hues), **settings).load()(seen(image))


def test_edges_are_found_to_parts_of_a_pixel_and_hue_goes_through_red() -> None:
    for colour in (RED, MAGENTA_RED):
        (found,) = find(painted(textured(), BOX, colour))
        assert found.box_px == pytest.approx(BOX, abs=0.15)
        assert found.score > 0.9
        assert found.mask.sum() == pytest.approx(51.3 * 29.4, rel=0.05)
    assert find(painted(textured(), BOX, BLUE)) == ()


def test_a_disc_is_as_wide_as_it_is() -> None:
    v, u = np.mgrid[:240, :640]
    share = np.clip(20.4 - np.hypot(u - 300.2, v - 120.7) + 0.5, 0, 1)[:, :, None]
    image = (textured() * (1 - share) + np.array(BLUE) * share).astype(np.uint8)
    (found,) = find(image, "blue")
    assert found.box_px[2] - found.box_px[0] == pytest.approx(40.8, abs=0.8)
    assert found.box_px[3] - found.box_px[1] == pytest.approx(40.8, abs=0.8)


def test_the_largest_come_first_and_specks_are_none() -> None:
    image = painted(textured(), (20, 20, 40, 40), RED)
    image = painted(image, BOX, RED)
    image = painted(image, (300, 100, 301, 130), RED)
    assert [one.box_px[0] for one in find(image, most=9)] == pytest.approx([100.3, 20], abs=0.2)
    assert len(find(image)) == 1
    assert len(find(image, most=9, opening=1, least_pixels=5)) == 3


def test_pictures_of_16_bits_and_at_the_border() -> None:
    image = painted(textured(), (-0.5, 200.0, 30.4, 239.5), BLUE)
    deep = image.astype(np.uint16) * 16
    for one in (image, deep):
        (found,) = find(one, "200-265")
        assert found.box_px == pytest.approx((0, 200.0, 30.4, 239), abs=0.5)
        dark = one // 6  # its hue means nothing; the brightest pixel tells what is dark
        dark[0, 0] = one.max()
        assert find(dark, "200-265") == ()
    (found,) = Colour(Hues.parse("blue")).load()(blind(seen(image)))  # depth is not needed


def test_a_grey_picture_is_named() -> None:
    with pytest.raises(ImageFormat, match="grey") as error:
        find(textured()[:, :, 0])
    assert "frame" in error.value.where
    assert "--detector" in error.value.fix


@pytest.mark.parametrize("text", ["350", "a-b", "10-400", "5-5", "", "nan-3"])
def test_hues_that_are_none(text: str) -> None:
    with pytest.raises(UsageError, match="Usage") as error:
        Hues.parse(text)
    assert "350-10" in error.value.want


def test_hues_as_people_write_them() -> None:
    assert Hues.parse("350-10") == Hues.parse("350:10") == Hues(350, 10)
    assert Hues.parse(str(Hues(350, 10))) == Hues(350, 10)
    assert Hues.parse("Blue").hold(np.float32([10, 240])).tolist() == [False, True]


@pytest.mark.parametrize(
    "bad", [{"least_saturation": 2}, {"least_value": -1}, {"most": 0}, {"opening": 0}]
)
def test_bad_settings_are_named(bad) -> None:
    with pytest.raises(UsageError) as error:
        Colour(Hues(0, 10), **bad)
    assert error.value.where in bad
