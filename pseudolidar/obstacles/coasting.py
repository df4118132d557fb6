"""Tracks that are not seen, as obstacles where they should be."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.box_in_view import nearest_depth_m, outline_px, seen_px
from pseudolidar.obstacles.tracker import Followed
from pseudolidar.structures.box import Box3D, Detection, Track
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.obstacle import Obstacle


def coasting_obstacle(track: Track, last: Obstacle, camera: Camera) -> Obstacle | None:
    """A track that is only predicted, as an obstacle; None where it should be out of the picture.

    What is half behind the camera has been passed.

    Nothing of it was seen: it has no pixels, and its confidence is 0.

    Args:
        track: its box in the frame of `camera`, with sigma.
        last: as it was seen last, for what a track does not know.
        camera: that does not see it.
    """
    box = track.box
    distance_m, box_px = nearest_depth_m(box, camera), seen_px(box, camera)
    if distance_m is None or box_px is None or box.pose.translation_m[2] <= 0:
        return None
    detection = Detection(track.name, box_px, last.detection.score)
    return Obstacle(
        detection,
        distance_m,
        _sigma_of_face_m(track),
        box,
        last.sigma_heading_rad,
        "track",
        confidence=0.0,
        truncated=outline_px(box, camera) != box_px,
        track=track,
    )


class LastSeen:
    """Obstacles as they were seen last, for those of their tracks that coast."""

    def __init__(self) -> None:
        self._last: dict[int, Obstacle] = {}

    def __call__(self, followed: Followed, camera: Camera) -> tuple[Obstacle, ...]:
        """Tracks that coast, where they should be in view, the nearest first.

        Args:
            followed: the next frame.
            camera: of that frame.
        """
        self._last |= {one.track.track_id: one for one in followed.obstacles if one.track}
        for track_id in followed.ended:
            self._last.pop(track_id, None)
        found = (
            coasting_obstacle(track, self._last[track.track_id], camera)
            for track in followed.coasting
        )
        return tuple(sorted((one for one in found if one), key=lambda one: one.distance_m))


def _sigma_of_face_m(track: Track) -> float:
    """Of the nearest face along the camera's axis: of the centre, and of half the size."""
    box: Box3D = track.box
    assert box.sigma_m is not None  # of every track that is followed
    towards = box.pose.matrix[2, :3] / 2
    return float(np.hypot(track.sigma_ahead_m, np.linalg.norm(towards * box.sigma_m[3:])))
