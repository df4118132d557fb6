"""Tracks as plain JSON values, and back without loss; unknown numbers are null."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pseudolidar.structures.box import Box3D, Contact, Track
from pseudolidar.structures.pose import Pose

BOX = "box"


def track_fields(track: Track) -> dict[str, Any]:
    """All that is known of a track."""
    box, contact = track.box, track.contact
    return {
        "track": track.track_id,
        "track_state": track.state,
        "track_class": track.name,
        "velocity_m_s": track.velocity_m_s.tolist(),
        "sigma_velocity_m_s": track.sigma_velocity_m_s.tolist(),
        "over_ground": track.over_ground,
        "speed_m_s": _known(track.speed_m_s),
        "sigma_speed_m_s": _known(track.sigma_speed_m_s),
        "age_s": track.age_s,
        "unseen_s": track.unseen_s,
        "seen": track.seen,
        "contact": None if contact is None else dict(vars(contact)),
        "track_box": {
            "frame": box.pose.dst,
            "centre_m": box.pose.translation_m.tolist(),
            "size_m": [box.length_m, box.width_m, box.height_m],
            "sigma_m": None if box.sigma_m is None else box.sigma_m.tolist(),
            "sigma_ahead_m": _known(track.sigma_ahead_m),
            "rotation": box.pose.matrix[:3, :3].tolist(),
        },
    }


def track_of(fields: dict[str, Any]) -> Track | None:
    """The track again; None where the fields have none.

    Raises:
        KeyError, TypeError, ValueError: a field is missing or of another kind.
        StructureError: an impossible value.
    """
    if fields.get("track") is None:
        return None
    state = fields["track_state"]
    if state not in ("tentative", "confirmed", "coasting"):
        raise ValueError(f"track_state {state!r}")
    contact = fields["contact"]
    return Track(
        int(fields["track"]),
        _box(fields["track_box"]),
        np.array(fields["velocity_m_s"], float),
        np.array(fields["sigma_velocity_m_s"], float),
        str(fields["track_class"]),
        state,
        bool(fields["over_ground"]),
        float(fields["age_s"]),
        float(fields["unseen_s"]),
        int(fields["seen"]),
        _number(fields["speed_m_s"]),
        _number(fields["sigma_speed_m_s"]),
        None if contact is None else Contact(**{name: float(contact[name]) for name in contact}),
        _number(fields["track_box"].get("sigma_ahead_m")),
    )


def _box(fields: dict[str, Any]) -> Box3D:
    pose = Pose.from_rotation(
        str(fields["frame"]),
        BOX,
        np.array(fields["rotation"], float),
        np.array(fields["centre_m"], float),
    )
    length_m, width_m, height_m = (float(value) for value in fields["size_m"])
    sigma = fields["sigma_m"]
    return Box3D(
        pose, length_m, width_m, height_m, None if sigma is None else np.array(sigma, float)
    )


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
