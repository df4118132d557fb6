"""The colour detector set by a click."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.commandline.choices import resolve
from pseudolidar.commandline.flags import parse_settings
from pseudolidar.commandline.verbs import load_verb
from pseudolidar.obstacles.colour import Colour
from pseudolidar.obstacles.hues import Hues
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.disparity import DepthMap
from pseudolidar.viewer.tuning.hue import colour_at, flag_of, found_by, marked

WIDE, HIGH, FOCAL, FAR_M = 320, 200, 300.0, 6.0


@pytest.fixture(scope="module")
def sight() -> Sight:
    """A red board, 60 px wide, 6 m away before something green at 12 m."""
    rng = np.random.default_rng(0)
    image = np.empty((HIGH, WIDE, 3), np.uint8)
    image[:] = (60, 120, 60)
    image[70:130, 100:160] = (200, 30, 40)
    image = np.clip(image + rng.normal(0, 4, image.shape), 0, 255).astype(np.uint8)
    depth = np.full((HIGH, WIDE), 12.0, np.float32)
    depth[70:130, 100:160] = FAR_M
    K = np.array([[FOCAL, 0, WIDE / 2], [0, FOCAL, HIGH / 2], [0, 0, 1]])
    sigma = np.full_like(depth, 0.03)
    return Sight("0", image, Camera(K, WIDE, HIGH), DepthMap(depth, sigma))


def test_a_click_finds_the_thing_with_its_width_and_distance(sight):
    colour = colour_at(sight.image, 130, 100)
    assert colour is not None
    assert colour.hues.hold(np.array([356.0], np.float32))[0]
    found = found_by(colour, sight)
    (thing,) = found.things
    assert thing.distance_m == pytest.approx(FAR_M, abs=0.1)
    (line,) = found.lines
    wide_m = float(line.split("**")[1].split()[0])
    assert wide_m == pytest.approx(60 / FOCAL * FAR_M, rel=0.05)
    assert found.mask[100, 130]
    assert not found.mask[20, 20]


def test_hues_are_taken_through_red_and_grey_has_none(sight):
    turned = sight.image.copy()
    turned[..., 1] = turned[..., 2]  # pure red: hues on both sides of 0
    hues = colour_at(turned, 130, 100).hues
    assert hues.from_deg > hues.to_deg
    grey = np.full((40, 40, 3), 128, np.uint8)
    assert colour_at(grey, 20, 20) is None
    assert colour_at(grey[..., 0], 20, 20) is None
    assert colour_at(sight.image, -50, 9999) is not None  # the nearest pixel: green


def test_the_flag_is_read_back_by_commands():
    verb = load_verb("obstacles")
    colour = Colour(Hues(350, 10), least_saturation=0.33, most=3, name="cone")
    args = ["synthetic:street", *flag_of(colour).split()]
    job = parse_settings(resolve(verb.settings, args, None), args, prog="", description="")
    assert job.detector == colour
    assert flag_of(Colour(Hues(0, 30))) == "--detector colour:0-30"


def test_what_is_found_is_drawn(sight):
    found = found_by(replace(colour_at(sight.image, 130, 100), most=2), sight)
    drawn = marked(sight.image, found.mask)
    assert drawn[20, 20].sum() < sight.image[20, 20].sum() / 2
    assert np.array_equal(drawn[100, 130], sight.image[100, 130])
    assert marked(sight.image[..., 0], found.mask).shape == sight.image.shape
