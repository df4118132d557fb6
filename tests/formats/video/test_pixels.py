"""Frames that become smaller while they become pixels."""

from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from pseudolidar.formats.video.pixels import to_pixels
from tests.videos import H264, decoded, pictures, turned, write_video


@pytest.mark.parametrize("form", ["gray", "gray16le", "rgb24"])
@pytest.mark.parametrize("smaller_px", [(32, 24), (21, 17)])
def test_a_pixel_is_the_mean_of_its_area(form: str, smaller_px: tuple[int, int]) -> None:
    """To rounding, in each of the two directions."""
    full = pictures(1, seed=4)[0]
    if form.startswith("gray"):
        full = full[..., 0]
    if form == "gray16le":
        full = full.astype(np.uint16) * 250
    frame = av.VideoFrame.from_ndarray(full, form)
    found = to_pixels(frame, rotated=True, smaller_px=smaller_px).pixels
    want = cv2.resize(full, smaller_px, interpolation=cv2.INTER_AREA)
    assert found.shape == want.shape
    assert found.dtype == want.dtype
    scale = 250 if form == "gray16le" else 1
    assert np.abs(found.astype(float) - want).mean() / scale < 0.5
    assert np.abs(found.astype(float) - want).max() / scale <= 3


@pytest.mark.parametrize("color_range", [1, 2])
def test_colours_are_those_of_the_whole_picture(tmp_path: Path, color_range: int) -> None:
    """To rounding in brightness; halved colours are those that are stored, not interpolated."""
    path = write_video(tmp_path / "a.mkv", pictures(1), color_range=color_range, **H264)
    (frame,) = decoded(path)
    whole = to_pixels(frame, rotated=True).pixels
    found = to_pixels(frame, rotated=True, smaller_px=(16, 12)).pixels
    want = cv2.resize(whole, (16, 12), interpolation=cv2.INTER_AREA)
    apart = found.astype(float) - want
    brightness = apart @ (0.299, 0.587, 0.114)  # Source: ITU-R BT.601, 2.5.1
    assert np.abs(brightness).max() <= 1.5
    assert np.abs(apart).mean() < 2
    assert np.abs(apart.mean(axis=(0, 1))).max() < 0.3


def test_a_size_is_that_of_the_turned_picture(tmp_path: Path) -> None:
    path = turned(write_video(tmp_path / "a.mp4", pictures(1), **H264), 1)
    (frame,) = decoded(path)
    plain = to_pixels(frame, rotated=False, smaller_px=(32, 24)).pixels
    found = to_pixels(frame, rotated=True, smaller_px=(24, 32))
    assert found.notes
    assert found.pixels.shape == (32, 24, 3)
    np.testing.assert_array_equal(np.rot90(plain, round(frame.rotation / 90)), found.pixels)
