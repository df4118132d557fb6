"""How pictures become left and right, and which pairs are wanted."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest

from pseudolidar.errors import CalibrationSizeMismatch, PairMismatch, UsageError
from pseudolidar.sources.capture.eyes import Eyes, fitting, layout_by_size
from pseudolidar.sources.capture.live_pairs import EveryInterval, OnRequest
from pseudolidar.sources.capture.shots import Shot, ShotPair
from pseudolidar.sources.capture.stamps import Stamp
from tests.body_rigs import rig
from tests.videos import H264, decoded, pictures, turned, write_video


def shots(*greys: np.ndarray, time_ns: int = 0) -> ShotPair:
    return ShotPair(
        tuple(
            Shot(av.VideoFrame.from_ndarray(grey, format="gray"), Stamp(time_ns, time_ns))
            for grey in greys
        )
    )


def grey(value: int, width: int = 64, height: int = 48) -> np.ndarray:
    return np.full((height, width), value, np.uint8)


def test_both_eyes_in_one_picture_are_told_by_the_size_of_one() -> None:
    assert layout_by_size((128, 48), (64, 48)) == "side-by-side"
    assert layout_by_size((64, 96), (64, 48)) == "top-bottom"
    for other in ((64, 48), (128, 96), (48, 128)):
        with pytest.raises(UsageError, match="one camera, with pictures of"):
            layout_by_size(other, (64, 48))


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("layout", [None, "side-by-side", "top-bottom"])
def test_left_is_left_unless_they_are_exchanged(layout: str | None, swap: bool) -> None:
    taken = {
        None: shots(grey(10), grey(200)),
        "side-by-side": shots(np.hstack([grey(10), grey(200)])),
        "top-bottom": shots(np.vstack([grey(10), grey(200)])),
    }[layout]
    left, right, notes = Eyes(layout, swap).pair(taken)
    assert (int(left.mean()), int(right.mean())) == ((200, 10) if swap else (10, 200))
    assert left.shape == right.shape == (48, 64)
    assert notes == ()


def test_pictures_are_made_smaller_in_both_directions() -> None:
    eyes = Eyes(scale=0.5)
    assert eyes.size_of((64, 48)) == (32, 24)
    left, right, _ = eyes.pair(shots(grey(10), grey(200)))
    assert left.shape == right.shape == (24, 32)


@pytest.mark.parametrize("layout", ["side-by-side", "top-bottom"])
def test_eyes_do_not_mix_where_they_meet(layout: str) -> None:
    """Eyes of 65x47 at half the size: neither of them ends with a whole pixel."""
    one, other = grey(10, 65, 47), grey(200, 65, 47)
    both = np.concatenate([one, other], axis=1 if layout == "side-by-side" else 0)
    left, right, _ = Eyes(layout, scale=0.5).pair(shots(both))
    assert left.shape == right.shape == (24, 32)
    assert (set(np.unique(left)), set(np.unique(right))) == ({10}, {200})


def test_a_picture_that_cannot_be_halved_is_refused_at_any_size() -> None:
    for scale in (1.0, 0.5):
        with pytest.raises(PairMismatch, match="65x48 cannot be halved"):
            Eyes("side-by-side", scale=scale).pair(shots(grey(10, 65, 48)))


def test_a_video_that_was_held_upright_has_upright_pairs(tmp_path: Path) -> None:
    path = turned(write_video(tmp_path / "a.mp4", pictures(1), **H264), 1)
    shot = Shot(decoded(path)[0], Stamp(0, 0))
    assert shot.size_px == (48, 64)
    for scale, shape in ((1.0, (64, 48, 3)), (0.5, (32, 24, 3))):
        left, _, notes = Eyes(scale=scale).pair(ShotPair((shot, shot)))
        assert left.shape == shape
        assert "rotated" in notes[0]


def test_a_rig_for_another_size_is_scaled_where_that_is_asked_for() -> None:
    own = rig()
    assert fitting(own, own.left.size_px, scale_calibration=False) is own
    with pytest.raises(CalibrationSizeMismatch, match="cameras that give 160x100"):
        fitting(own, (160, 100), scale_calibration=False)
    small = fitting(own, (160, 100), scale_calibration=True)
    assert small.left.size_px == (160, 100)
    assert small.left.focal_px == own.left.focal_px / 2


def test_a_pair_is_wanted_for_each_request() -> None:
    wanted = OnRequest()
    pair = shots(grey(0), grey(0))
    assert not wanted(pair)
    wanted.request()
    wanted.request()
    assert [wanted(pair) for _ in range(4)] == [True, True, False, False]


def test_a_pair_is_wanted_when_so_much_has_passed_since_the_last_one() -> None:
    wanted = EveryInterval(0.25)
    second = 1_000_000_000
    times = [7.0, 7.1, 7.249, 7.26, 7.5, 7.51, 9.0, 9.1, 9.25]
    got = [wanted(shots(grey(0), grey(0), time_ns=round(t * second))) for t in times]
    assert [t for t, kept in zip(times, got, strict=True) if kept] == [7.0, 7.26, 7.51, 9.0, 9.25]
