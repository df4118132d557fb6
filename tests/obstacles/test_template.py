"""Things that look like a picture."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pseudolidar.errors import ImageFormat, ImageMissing, UsageError
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.obstacles.template import Template
from tests.obstacles.pictures import blind, seen, textured
from tests.obstacles.scene import HEIGHT, WIDTH

X, Y, DISPARITY = 300, 90, 17


@pytest.fixture(scope="module")
def thing() -> np.ndarray:
    noise = np.random.default_rng(5).uniform(0, 255, (24, 32, 3)).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2.5), None, 0, 255, cv2.NORM_MINMAX)


@pytest.fixture(scope="module")
def png(thing, tmp_path_factory):
    path = tmp_path_factory.mktemp("template") / "thing.png"
    path.write_bytes(encode_png(thing.astype(np.uint8)))
    return path


def shown(thing, x: float = X, y: float = Y, scale: float = 1.0, seed: int = 0) -> np.ndarray:
    """A picture with the thing at a place that may lie between pixels."""
    move = np.array([[scale, 0, x + (scale - 1) / 2], [0, scale, y + (scale - 1) / 2]])
    warped = cv2.warpAffine(thing, move, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR)
    there = cv2.warpAffine(np.ones(thing.shape[:2], np.float32), move, (WIDTH, HEIGHT))
    return (textured(seed) * (1 - there[:, :, None]) + warped).clip(0, 255).astype(np.uint8)


def test_it_is_found_to_parts_of_a_pixel_in_both_eyes(thing, png) -> None:
    one = seen(shown(thing, X + 0.4, Y - 0.3), shown(thing, X + 0.4 - DISPARITY, Y - 0.3))
    (match,) = Template(png, largest=1.2, smallest=0.8).load().matches(one)
    left, top, right, bottom = match.place.box_px
    assert (left + right) / 2 == pytest.approx(X + 0.4 + 15.5, abs=0.2)
    assert (top + bottom) / 2 == pytest.approx(Y - 0.3 + 11.5, abs=0.2)
    assert match.disparity_px == pytest.approx(DISPARITY, abs=0.15)
    assert match.place.score > 0.9


@pytest.mark.parametrize("scale", [0.6, 1.7])
def test_it_may_be_larger_or_smaller(thing, png, scale: float) -> None:
    (found,) = Template(png).load()(blind(seen(shown(thing, scale=scale))))
    left, top, right, bottom = found.box_px
    middle = (left + right + 1) / 2, (top + bottom + 1) / 2
    assert middle == pytest.approx((X + 16 * scale, Y + 12 * scale), abs=0.7)
    # Its rim mixes with what is behind, and sizes are whole pixels.
    assert right - left + 1 == pytest.approx(32 * scale, rel=0.06)
    assert bottom - top + 1 == pytest.approx(24 * scale, rel=0.06)


def test_grey_and_16_bit_pictures(thing, png) -> None:
    colour = shown(thing)
    grey = cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)
    for image in (grey, colour.astype(np.uint16) * 16, grey.astype(np.uint16) * 200):
        (found,) = Template(png, smallest=1.0, largest=1.0).load()(seen(image))
        assert found.box_px[:2] == pytest.approx((X, Y), abs=0.3)


def test_what_only_one_eye_sees_does_not_count(thing, png) -> None:
    one = seen(shown(thing), textured(1))
    settings = {"smallest": 1.0, "largest": 1.0}
    assert Template(png, **settings).load()(one) == ()
    assert len(Template(png, both_eyes=False, **settings).load()(one)) == 1
    # nor on other rows
    off = seen(shown(thing), shown(thing, X - DISPARITY, Y + 8))
    assert Template(png, **settings).load()(off) == ()


def test_no_match_is_a_valid_result(png) -> None:
    assert Template(png).load()(seen(textured())) == ()
    small = np.zeros((HEIGHT, WIDTH), np.uint8)
    assert Template(png, smallest=12, largest=12).load()(seen(small)) == ()  # larger than it


def test_what_is_transparent_is_not_compared(thing, tmp_path) -> None:
    v, u = np.mgrid[:24, :32]
    opaque = np.hypot((u - 15.5) / 15, (v - 11.5) / 11) < 1
    bgra = np.dstack([thing[:, :, ::-1], opaque * 255.0]).astype(np.uint8)
    path = tmp_path / "cut.png"
    cv2.imwrite(str(path), bgra)
    image = textured()
    image[Y : Y + 24, X : X + 32][opaque] = thing.astype(np.uint8)[opaque]
    image[Y : Y + 24, X : X + 32][~opaque] = 255 * (u[~opaque, None] % 2)
    (found,) = Template(path, smallest=1, largest=1).load()(seen(image))
    assert found.box_px[:2] == pytest.approx((X, Y), abs=0.3)
    assert found.score > 0.98
    assert (found.mask[Y : Y + 24, X : X + 32] == opaque).all()
    assert found.mask.sum() == opaque.sum()


def test_several_that_do_not_overlap(thing, png) -> None:
    image = shown(thing)
    image[20:44, 500:532] = image[Y : Y + 24, X : X + 32]
    found = Template(png, smallest=0.9, largest=1.1, most=5).load()(seen(image))
    assert sorted(round(one.box_px[0]) for one in found) == [X, 500]


def test_templates_that_cannot_be_used(tmp_path) -> None:
    with pytest.raises(ImageMissing):
        Template(tmp_path / "none.png").load()
    for name, pixels in (("flat", np.full((20, 20), 9, np.uint8)), ("tiny", np.eye(4) * 255)):
        path = tmp_path / f"{name}.png"
        path.write_bytes(encode_png(pixels.astype(np.uint8)))
        with pytest.raises(ImageFormat, match="template") as error:
            Template(path).load()
        assert str(path) in str(error.value)


@pytest.mark.parametrize(
    "bad", [{"least_score": 0}, {"smallest": 0}, {"smallest": 3, "largest": 2}, {"most": 0}]
)
def test_bad_settings_are_named(bad, png) -> None:
    with pytest.raises(UsageError):
        Template(png, **bad)
