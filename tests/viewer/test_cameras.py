"""Cameras in the scene: where they stand, how much they see, and what."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from pseudolidar.pipelines.view import View

from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.geometry.quaternion import quaternion_wxyz
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.cameras import PHOTO_PX, cameras_of
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.reel import SourceReel
from tests.viewer.clients import wait_until


@pytest.fixture(scope="module")
def reel() -> SourceReel:
    return View().reel_of(Synthetic("street", frames=2, width_px=400, height_px=100))


@pytest.fixture(scope="module")
def moment(reel: SourceReel) -> Moment:
    return reel.load(0)


@pytest.fixture(scope="module")
def app(reel: SourceReel, moment: Moment) -> Iterator[App]:
    with App.made(Address(port=0), Opened((reel,))) as made:
        made.view.show(moment)
        yield made


def test_both_stand_where_the_rig_has_them_and_open_as_they_see(moment: Moment):
    left, right = cameras_of(moment)
    assert moment.converted is not None
    frame = moment.converted.frame
    assert isinstance(frame, StereoFrame)
    rig = frame.rig
    for one in (left, right):
        # The middle of the picture is ahead, its columns go to the right, its rows down.
        assert np.allclose(one.T_forward_camera[:3, :3], R_BODY_OPTICAL, atol=0.01)
        angle_rad, aspect = one.opening
        assert np.tan(angle_rad / 2) == pytest.approx(50 / rig.left.K[1, 1])
        assert aspect == 4
    between_m = right.T_forward_camera[:3, 3] - left.T_forward_camera[:3, 3]
    assert np.allclose(between_m, rig.baseline_m * left.T_forward_camera[:3, 0], atol=1e-6)
    assert right.length_m < left.length_m


def test_the_left_one_has_the_photo(moment: Moment):
    left, right = cameras_of(moment)
    assert left.photo is not None
    assert left.photo.shape == (PHOTO_PX // 4, PHOTO_PX, 3)
    assert moment.converted is not None
    assert isinstance(moment.converted.frame, StereoFrame)
    whole = moment.converted.frame.left
    assert np.allclose(left.photo.mean(axis=(0, 1)), whole.mean(axis=(0, 1)), atol=1)
    assert right.photo is None
    assert cameras_of(Moment("clouds alone", 0, clouds=moment.clouds)) == ()


def test_they_are_changed_in_place_and_switched_off(app: App, reel: SourceReel, moment: Moment):
    nodes = dict(app.cameras._nodes)
    assert set(nodes) == {"left", "right"}
    (switch,) = [
        one
        for one in app.view.gui._gui_input_handle_from_uuid.values()
        if getattr(one._impl.props, "label", "") == "Cameras"
    ]
    assert switch.visible
    switch.value = False
    wait_until(lambda: not any(node.visible for node in nodes.values()))
    app.view.show(reel.load(1))
    assert not any(node.visible for node in nodes.values())
    switch.value = True
    wait_until(lambda: all(node.visible for node in nodes.values()))
    app.view.show(replace(moment, converted=None, sight=None))  # a frame without pictures
    assert not any(node.visible for node in nodes.values())
    other = View().reel_of(Synthetic("street", frames=1, width_px=200, height_px=100)).load(0)
    for shown in (moment, reel.load(1), other):  # the last one is of another rig
        app.view.show(shown)
        assert app.cameras._nodes == nodes
        for one in cameras_of(shown):
            node = nodes[one.name]
            assert node.visible
            assert (node.fov, node.aspect) == one.opening
            assert np.allclose(node.position, one.T_forward_camera[:3, 3])
            assert np.allclose(node.wxyz, quaternion_wxyz(one.T_forward_camera[:3, :3]))
            assert one.photo is None or np.array_equal(node.image, one.photo)


def test_clouds_alone_have_no_switch_for_them():
    with App.made(Address(port=0), Opened()) as app:
        app.view.show(Moment("a", 0))
        assert not app.cameras.there
        assert not app.scene._seen.visible
