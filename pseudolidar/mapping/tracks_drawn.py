"""What odometry looked at in a frame, drawn into its picture."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.grey import grey8_of
from pseudolidar.structures.arrays import Float64, UInt8
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.odometry import AGREES, OdometryState

# Points that do not agree with the motion, and those that do, RGB: apart also for those who see
# no difference between red and green.
WRONG_RGB, RIGHT_RGB = np.array([255, 90, 30]), np.array([60, 220, 255])
# The picture is darkened to this share, so that lines are seen.
DARKENED = 0.6
# Lines are drawn to 1/16 px.
SUBPIXEL_BITS = 4
RADIUS_PX, TEXT_HEIGHT_PX, MARGIN_PX = 2, 16, 6


def tracks_drawn(frame: StereoFrame, state: OdometryState) -> UInt8:
    """(H, W, 3) RGB: each point with its way since the keyframe, and the frame's state in words.

    A frame of which nothing was measured has no points, and its picture a frame in the colour of
    those that do not agree.

    Args:
        frame: the one that `state` is of.
        state: what odometry told of it.
    """
    grey = (grey8_of(frame.left) * DARKENED).astype(np.uint8)
    picture = np.ascontiguousarray(np.repeat(grey[:, :, None], 3, axis=2))
    if state.tracks is not None:
        for which in (state.weights < AGREES, state.weights >= AGREES):  # those that agree on top
            _draw_ways(
                picture,
                state.tracks.uv_from[which],
                state.tracks.uv_to[which],
                state.weights[which],
            )
    if not state.measured:
        _frame(picture)
    _write(picture, words_of(state))
    return picture


def words_of(state: OdometryState) -> str:
    """The state of a frame in a line."""
    if not state.measured:
        return f"{state.status}: {state.why}"
    if state.status == "first":
        return f"first of piece {state.piece}"
    assert state.step is not None  # of every frame that is neither
    if state.tracks is None:
        return f"placed by its scan, {state.step.distance_m:.3f} m"
    parts = [
        f"{state.inliers} of {state.n_tracks} points agree",
        f"keyframe {state.keyframe_gap} back",
        f"{state.step.distance_m:.3f} m",
    ]
    return ", ".join([*parts, *(["next keyframe"] if state.keyframe else [])])


def _draw_ways(picture: UInt8, start: Float64, end: Float64, weights: Float64) -> None:
    import cv2

    scale = 1 << SUBPIXEL_BITS
    ways = np.rint(np.stack([start, end], axis=1) * scale).astype(np.int32)
    share = weights[:, None]
    colours = np.rint(share * RIGHT_RGB + (1 - share) * WRONG_RGB).astype(int).tolist()
    for way, colour in zip(ways, colours, strict=True):
        first, last = (tuple(point.tolist()) for point in way)
        cv2.line(picture, first, last, colour, 1, cv2.LINE_AA, SUBPIXEL_BITS)
        cv2.circle(picture, last, RADIUS_PX * scale, colour, -1, cv2.LINE_AA, SUBPIXEL_BITS)


def _frame(picture: UInt8) -> None:
    for edge in (np.s_[:4], np.s_[-4:], np.s_[:, :4], np.s_[:, -4:]):
        picture[edge] = WRONG_RGB


def _write(picture: UInt8, words: str) -> None:
    import cv2

    width = picture.shape[1]
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, TEXT_HEIGHT_PX / 32
    length_px = cv2.getTextSize(words, font, scale, 1)[0][0]
    scale *= min(1.0, (width - 2 * MARGIN_PX) / max(1, length_px))
    picture[: TEXT_HEIGHT_PX + MARGIN_PX] //= 3
    at = (MARGIN_PX, TEXT_HEIGHT_PX)
    cv2.putText(picture, words, at, font, scale, (255, 255, 255), 1, cv2.LINE_AA)
