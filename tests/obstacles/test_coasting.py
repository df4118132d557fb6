"""Tracks that are not seen are told where they should be, until they are passed."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pseudolidar.obstacles.coasting import LastSeen, coasting_obstacle
from pseudolidar.obstacles.tracker import Followed
from tests.formats.made_obstacles import car, upright
from tests.obstacles.scene import CAMERA


@pytest.mark.parametrize(("z_m", "told"), [(12.0, True), (0.5, True), (-0.2, False)])
def test_what_is_half_behind_the_camera_has_been_passed(z_m: float, told: bool) -> None:
    last = car()
    # beside the camera, along its axis: its front is in the picture in each case
    box = replace(last.box, pose=upright(0.9, 0.9, z_m, 0.0))
    track = replace(last.track, box=box, sigma_ahead_m=0.3)
    found = coasting_obstacle(track, last, CAMERA)
    assert (found is not None) is told


def test_what_was_seen_last_is_forgotten_with_its_track() -> None:
    last, seen = LastSeen(), car()
    far = replace(seen.track, sigma_ahead_m=0.3)
    box = replace(seen.box, pose=upright(0.0, 0.9, 9.0, 0.0))
    near = replace(far, box=box, track_id=8)
    assert last(Followed((seen, replace(seen, track=near))), CAMERA) == ()
    coasting = last(Followed((), coasting=(far, near)), CAMERA)
    assert [one.track.track_id for one in coasting] == [8, 7]  # the nearest first
    assert last(Followed((), ended=(7,)), CAMERA) == ()
    assert list(last._last) == [8]
