"""Detectors on real pictures: the bike of the avoidance task, and what stands on KITTI's roads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pseudolidar.clouds.ground_fit import GroundFit
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.obstacles.cloud import Cloud
from pseudolidar.obstacles.colour import Colour
from pseudolidar.obstacles.hues import Hues
from pseudolidar.obstacles.measure import measured
from pseudolidar.obstacles.onnx_detector import OnnxDetector
from pseudolidar.obstacles.overlap import box_iou
from pseudolidar.obstacles.sight import Sight
from pseudolidar.obstacles.template import Template
from pseudolidar.running.matching import MatchFrame, Refining
from pseudolidar.running.sighting import SMALL_THINGS_KEPT, SightFrame
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.source import pairs_of
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.clean import Clean
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.disparity import DepthMap
from pseudolidar.structures.image_size import ImageSize

pytestmark = pytest.mark.real
# Where the template was cut out of the left picture, and where it is in the right one.
LEFT, RIGHT = (547, 479), (536, 479)
FRAMES = (0, 4, 6, 7)
REACH_M = 30.0


@pytest.fixture(scope="module")
def measured_bike(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Sight:
    """The pair with its depth, by the matrices with the number that belongs into the first row."""
    folder = real_data / "bike_avoidance"
    matrices = (folder / "camera_data.txt").read_text()
    left, right = matrices.split("p_right")
    assert right.count("2176.0") == right.count("792.0") == 1
    right = right.replace("2176.0", "1856.0").replace("792.0", "552.0")
    corrected = tmp_path_factory.mktemp("bike") / "corrected.txt"
    corrected.write_text(f"{left}p_right{right}")
    source = pairs_of(opened_with_rig(recognise(str(folder)), corrected))
    match = MatchFrame.load(source, Census(), Refining(), SMALL_THINGS_KEPT)
    return SightFrame.of(match, GroundFit())(source.load(0)).sight


@pytest.fixture(scope="module")
def bike(real_data: Path) -> Sight:
    """The pair without depth: these detectors need none."""
    left, right = (
        read_image(real_data / f"bike_avoidance/{eye}.png").pixels for eye in ("left", "right")
    )
    camera = Camera(np.array([[640.0, 0, 640], [0, 640, 480], [0, 0, 1]]), 1280, 960)
    return Sight("0", left, camera, DepthMap(np.full((960, 1280), np.nan, np.float32)), right, 0.2)


def test_the_bike_is_found_by_its_picture_in_both_eyes(bike: Sight, real_data: Path) -> None:
    finder = Template(real_data / "bike_avoidance/bike.png", smallest=0.9, largest=1.1).load()
    (match,) = finder.matches(bike)
    assert (match.place.x, match.place.y) == pytest.approx(LEFT, abs=0.05)
    assert (match.place.width, match.place.height) == (46, 30)
    assert match.disparity_px == pytest.approx(LEFT[0] - RIGHT[0], abs=0.5)
    assert match.place.score > 0.99


def test_the_bike_is_the_largest_blue_thing(bike: Sight) -> None:
    (found,) = Colour(Hues.parse("222-255"), least_saturation=0.7).load()(bike)
    left, top, right, bottom = found.box_px
    assert LEFT[0] <= left < right <= LEFT[0] + 46
    assert LEFT[1] <= top < bottom <= LEFT[1] + 30


@pytest.mark.parametrize("by", ["template", "colour", "network"])
def test_the_bike_is_as_far_as_its_disparity_says(
    by: str, measured_bike: Sight, real_data: Path
) -> None:
    network = real_data / "models/yolox_nano/yolox_nano.onnx"
    detector = {
        "template": Template(real_data / "bike_avoidance/bike.png", smallest=0.9, largest=1.1),
        "colour": Colour(Hues.parse("222-255"), least_saturation=0.7),
        "network": OnnxDetector(network, tiles=ImageSize(416, 416), classes="motorbike"),
    }[by]
    (found,) = measured(measured_bike, detector.load()(measured_bike))
    left, top, right, bottom = found.detection.box_px  # by colour its blue part alone
    assert LEFT[0] - 5 < left < right < LEFT[0] + 50
    assert LEFT[1] - 5 < top < bottom < LEFT[1] + 35
    # f B = 640 px * 0.5 m; a template at whole pixels says 11, its sub-pixel match 10.6
    assert 640 * 0.5 / 11 < found.distance_m < 640 * 0.5 / 10.4
    assert abs(found.distance_m - 640 * 0.5 / 10.6) < found.sigma_distance_m < 2.0


def test_nothing_else_looks_like_the_bike(real_data: Path) -> None:
    source = pairs_of(recognise(str(real_data / "kitti_object/training")).open())
    frame = source.load(0)
    depth = DepthMap(np.full(frame.left.shape[:2], np.nan, np.float32))
    one = Sight(frame.id, frame.left, frame.rig.left, depth, frame.right, frame.rig.baseline_m)
    assert Template(real_data / "bike_avoidance/bike.png").load()(one) == ()


def test_what_is_labelled_to_30_m_is_found_by_its_points(real_data: Path) -> None:
    source = pairs_of(recognise(str(real_data / "kitti_object/training")).open())
    match = MatchFrame.load(source, Census(), Refining(), Clean())
    sight, detect = SightFrame.of(match, GroundFit()), Cloud().load()
    overlaps = []
    for index in FRAMES:
        one = sight(source.load(index)).sight
        found = detect(one)
        assert 5 <= len(found) <= 40
        for thing in found:
            assert not (thing.mask & one.is_ground).any()
        overlaps += [
            max(box_iou(label.detection.box_px, thing.box_px) for thing in found)
            for label in one.labels
            if not label.ignore
            and label.box.pose.translation_m[2] < REACH_M
            and label.truncation <= 0.15
            and label.occlusion <= 1
        ]
    assert len(overlaps) == 7
    assert min(overlaps) > 0.3
    assert np.count_nonzero(np.array(overlaps) > 0.5) >= 5
