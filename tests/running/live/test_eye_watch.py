"""Exchanged cameras whose first pictures show nothing are told while they run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import CloudEmpty
from pseudolidar.running.live.eye_watch import FIRST_S, EyeWatch, Watched
from pseudolidar.running.live.newest import Newest
from pseudolidar.running.products.product import Product
from pseudolidar.structures.frame import StereoFrame
from tests.body_rigs import rig
from tests.videos import pictures

SHIFT_PX = 9
PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def pair() -> StereoFrame:
    camera = replace(rig().left, width_px=480, height_px=270)
    of_size = replace(rig(), left=camera, right=replace(camera, frame=rig().right.frame))
    wide = pictures(1, 480 + SHIFT_PX, 270, seed=8)[0]
    left, right = (np.ascontiguousarray(part) for part in (wide[:, :480], wide[:, SHIFT_PX:]))
    return StereoFrame(left, right, of_size, "000000", 0, 1)


def exchanged(pair: StereoFrame) -> StereoFrame:
    return replace(pair, left=pair.right, right=pair.left)


def test_two_pairs_that_tell_are_enough_and_dark_ones_are_looked_at_more_rarely(
    pair: StereoFrame, caplog: pytest.LogCaptureFixture
) -> None:
    dark = replace(pair, left=np.zeros_like(pair.left), right=np.zeros_like(pair.right))
    watch = EyeWatch(swap=False)
    assert [watch(dark), watch(dark)] == [FIRST_S, 2 * FIRST_S]
    assert watch(exchanged(pair)) == 4 * FIRST_S
    assert watch.order == "unknown"
    assert not caplog.records
    assert watch(exchanged(pair)) is None
    assert watch.order == "exchanged"
    (told,) = caplog.records
    assert "pass --swap" in told.getMessage()


def test_cameras_that_are_named_right_are_left_alone(
    pair: StereoFrame, caplog: pytest.LogCaptureFixture
) -> None:
    watch = EyeWatch(swap=True)
    assert [watch(pair), watch(pair)] == [FIRST_S, None]
    assert watch.order == "right"
    assert not caplog.records


def test_a_pair_is_looked_at_although_nothing_becomes_of_it(pair: StereoFrame) -> None:
    looked: list[StereoFrame] = []

    def work(_: StereoFrame) -> Product:
        raise CloudEmpty("nothing is left")

    with (
        Newest("eyes", looked.append, idle_s=0.01) as newest,
        pytest.raises(CloudEmpty),
    ):
        Watched(work, newest)(pair)
    assert looked == [pair]
