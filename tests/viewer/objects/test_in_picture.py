"""Boxes of objects over pictures."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from pseudolidar.pipelines.view import View, reel_by

from pseudolidar.geometry.box_in_view import outline_px
from pseudolidar.geometry.lines_in_view import NEAREST_M, in_front, lines_px
from pseudolidar.obstacles.labels import Labels
from pseudolidar.running.products.converted import Converted
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.disparity import DepthMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import DepthFrame
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.objects.in_picture import FARTHEST_PX, PictureEye, boxes_in_picture
from pseudolidar.viewer.objects.scene import ObjectScene
from pseudolidar.viewer.objects.shown import ShownObject
from pseudolidar.viewer.objects.teller import ScenesAtOnce, Wish
from tests.formats.made_obstacles import car


@pytest.fixture(scope="module")
def seen() -> tuple[Moment, ObjectScene]:
    """A frame of a rendered street, and what is in it."""
    reel = reel_by(View().conversion(Synthetic("street", frames=1, width_px=512)))
    moment = reel.load(0)
    scene = ScenesAtOnce.of(Wish(detect=Labels().load()), {}, reel.sighted)(moment)
    assert scene.objects
    assert scene.truths
    return moment, scene


def frame_of(moment: Moment) -> StereoFrame:
    assert moment.converted is not None
    assert isinstance(moment.converted.frame, StereoFrame)
    return moment.converted.frame


def test_boxes_stand_where_things_were_found(seen: tuple[Moment, ObjectScene]):
    moment, scene = seen
    camera = frame_of(moment).rig.left
    boxes = boxes_in_picture(scene, moment, right=False)
    assert [one.key for one in boxes[: len(scene.objects)]] == [one.key for one in scene.objects]
    assert {one.key for one in boxes[len(scene.objects) :]} == {""}
    for one, shown in zip(boxes, scene.objects, strict=False):
        assert one.box_px == shown.obstacle.detection.box_px
        assert one.text == f"{shown.name} {shown.obstacle.distance_m:.1f} m"
        assert one.colour == shown.colour
        outline = outline_px(shown.obstacle.box, camera)
        if outline is not None:  # the whole box is before the camera
            low, high = one.edges_px.min(axis=(0, 1)), one.edges_px.max(axis=(0, 1))
            assert [*low, *high] == pytest.approx(outline)


def test_in_the_right_picture_they_stand_where_the_right_camera_sees_them(
    seen: tuple[Moment, ObjectScene],
):
    """By the labels, whose places in the right picture are known from their boxes in space."""
    moment, scene = seen
    frame = frame_of(moment)
    T = frame.rig.T_right_left
    labels = {label.detection.box_px: label.box for label in frame.labels or ()}
    left, right = (boxes_in_picture(scene, moment, right=eye) for eye in (False, True))
    looked = 0
    for one, there, truth in zip(
        left[len(scene.objects) :], right[len(scene.objects) :], scene.truths, strict=True
    ):
        box = labels[truth.box_px]
        assert box is not None
        whole = outline_px(replace(box, pose=T @ box.pose), frame.rig.right)
        before = outline_px(box, frame.rig.left)
        if whole is None or before is None:
            continue
        looked += 1
        assert [*there.edges_px.min(axis=(0, 1))] == pytest.approx(whole[:2])
        # The 2D box goes with the nearest face, the outline's left side with that or one behind.
        shift = one.box_px[0] - there.box_px[0]
        assert before[0] - whole[0] - 1e-6 <= shift
        assert shift == pytest.approx(frame.rig.fB_px_m / truth.distance_m - frame.rig.doffs_px)
        assert one.box_px[1::2] == there.box_px[1::2]
    assert looked


def test_labels_have_words_where_nothing_else_has(seen: tuple[Moment, ObjectScene]):
    moment, scene = seen
    assert not any(one.text for one in boxes_in_picture(scene, moment, right=False) if not one.key)
    alone = boxes_in_picture(replace(scene, objects=()), moment, right=False)
    assert alone
    assert all(one.text.endswith(" m") for one in alone)


def test_there_are_none_without_pictures_or_in_a_picture_that_is_not_there(
    seen: tuple[Moment, ObjectScene],
):
    moment, scene = seen
    assert boxes_in_picture(scene, Moment("", 0), right=False) == ()
    frame = frame_of(moment)
    depth = DepthMap(np.ones(frame.left.shape[:2], np.float32))
    single = DepthFrame(frame.left, depth, frame.rig.left, "a", 0, 0)
    assert moment.converted is not None
    one_eyed = replace(moment, converted=Converted(single, moment.converted.cloud))
    assert boxes_in_picture(scene, one_eyed, right=True) == ()
    left = boxes_in_picture(scene, one_eyed, right=False)
    assert [one.box_px for one in left[:2]] == [
        one.obstacle.detection.box_px for one in scene.objects[:2]
    ]


def test_what_is_beside_the_camera_is_cut_and_sent_as_numbers(seen: tuple[Moment, ObjectScene]):
    moment, _ = seen
    eye = PictureEye.of(moment, right=False)
    assert eye is not None
    beside = ShownObject.of(1, car(), eye.T_forward_camera)
    around = replace(beside, corners_m=beside.corners_m - [22.0, 0, 0])  # around the camera
    fields = eye.object(around).fields
    assert json.loads(json.dumps(fields, allow_nan=False)) == fields
    edges = np.array(fields["edges"])
    assert 0 < len(edges) < 12
    assert np.abs(edges).max() <= FARTHEST_PX


def test_lines_are_cut_at_the_plane_before_the_camera():
    through, behind, before = (
        [[0, 0, -1], [2, 0, 3]],
        [[0, 0, -1], [0, 1, 0]],
        [[0, 0, 2], [1, 1, 1]],
    )
    cut = in_front(np.array([through, behind, before], np.float32))
    assert len(cut) == 2
    assert cut[0] == pytest.approx(np.array([[0.5 * (1 + NEAREST_M), 0, NEAREST_M], [2, 0, 3]]))
    assert cut[1] == pytest.approx(np.array(before))
    P = np.array([[100.0, 0, 50, -30], [0, 100, 20, 0], [0, 0, 1, 0]])
    assert lines_px(np.array([before]), P)[0] == pytest.approx(np.array([[35, 20], [120, 120]]))
    assert len(in_front(np.zeros((0, 2, 3), np.float32))) == 0
