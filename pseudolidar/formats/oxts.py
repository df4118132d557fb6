"""OXTS packets of KITTI raw: where the IMU was and how it moved, a file of 30 numbers a frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pseudolidar.errors import PoseFileError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.text import read_lines
from pseudolidar.geometry.frames import BASE_LINK, MAP
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.motion import BodyMotion
from pseudolidar.structures.pose import Pose

COLUMNS = 30
# Columns of the velocity (forward, left, up, parallel to the ground) and of the rates about the
# IMU's own axes.
VELOCITY, RATES = slice(8, 11), slice(17, 20)
EARTH_RADIUS_M = 6_378_137.0  # as in the KITTI devkit (WGS 84, equatorial)
LARGEST_LATITUDE_DEG = 85.0  # Mercator's limit
FRAME_WORLD = "mercator"


@dataclass(frozen=True)
class OxtsPacket:
    """Position, attitude and motion of the IMU.

    Args:
        latitude_deg: north positive.
        longitude_deg: east positive.
        altitude_m: up.
        roll_rad: left side up is positive.
        pitch_rad: front down is positive.
        yaw_rad: 0 is east, counter-clockwise.
        velocity_m_s: forward, left and up, parallel to the ground and across it.
        rates_rad_s: about the IMU's own axes x, y, z.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rates_rad_s: tuple[float, float, float] = (0.0, 0.0, 0.0)


def read_oxts(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> OxtsPacket:
    """Read one OXTS file.

    Raises:
        PoseFileError: missing file, not 30 numbers in one line, or a position that is none.
    """
    lines = [line for line in read_lines(path, error=PoseFileError, limits=limits) if line.text]
    if len(lines) != 1:
        raise PoseFileError(f"{len(lines)} lines", want=f"one of {COLUMNS} numbers", path=path)
    values = lines[0].numbers(lines[0].words(), count=COLUMNS)
    forward, left, up = values[VELOCITY]
    about_x, about_y, about_z = values[RATES]
    latitude, longitude, altitude, roll, pitch, yaw = values[:6]
    packet = OxtsPacket(
        *(latitude, longitude, altitude, roll, pitch, yaw),
        velocity_m_s=(forward, left, up),
        rates_rad_s=(about_x, about_y, about_z),
    )
    if abs(packet.latitude_deg) > LARGEST_LATITUDE_DEG or abs(packet.longitude_deg) > 180.0:
        raise lines[0].refusal(
            f"latitude {packet.latitude_deg:g}, longitude {packet.longitude_deg:g}",
            want=f"degrees, latitude within {LARGEST_LATITUDE_DEG:g}",
        )
    return packet


def write_oxts(path: Path, packet: OxtsPacket) -> None:
    """Write one OXTS file with all digits; velocities and accuracies are 0."""
    values = [
        *(packet.latitude_deg, packet.longitude_deg, packet.altitude_m),
        *(packet.roll_rad, packet.pitch_rad, packet.yaw_rad),
    ]
    words = [repr(float(value)) for value in values] + ["0"] * (COLUMNS - len(values))
    write_atomic(path, (" ".join(words) + "\n").encode())


def body_pose(packet: OxtsPacket, first: OxtsPacket) -> Pose:
    """`T_map_base_link` with the IMU as `base_link`; `map` is the IMU at the packet `first`.

    Source: KITTI raw development kit, convertOxtsToPose.m (Mercator projection, scaled by the
        cosine of the first latitude).
    """
    scale = math.cos(math.radians(first.latitude_deg))
    T_world_first = Pose(FRAME_WORLD, MAP, _matrix(first, scale))
    return T_world_first.inverse() @ Pose(FRAME_WORLD, BASE_LINK, _matrix(packet, scale))


def body_motion(packet: OxtsPacket) -> BodyMotion:
    """The motion of `base_link`, the IMU, in its own axes.

    Source: KITTI raw development kit, dataformat.txt (vf, vl, vu are level; wx, wy, wz are not).
    """
    R_level_body = _rotation(packet.roll_rad, packet.pitch_rad, 0.0)
    velocity = R_level_body.T @ np.array(packet.velocity_m_s, np.float64)
    return BodyMotion(BASE_LINK, velocity, np.array(packet.rates_rad_s, np.float64))


def packet_at(T_map_base_link: Pose, first: OxtsPacket) -> OxtsPacket:
    """The packet that `body_pose` turns into this pose."""
    scale = math.cos(math.radians(first.latitude_deg))
    matrix = _matrix(first, scale) @ T_map_base_link.matrix
    x_m, y_m, z_m = (float(value) for value in matrix[:3, 3])
    mercator = math.atan(math.exp(y_m / (scale * EARTH_RADIUS_M)))
    R = matrix[:3, :3]
    return OxtsPacket(
        latitude_deg=math.degrees(2.0 * mercator) - 90.0,
        longitude_deg=math.degrees(x_m / (scale * EARTH_RADIUS_M)),
        altitude_m=z_m,
        roll_rad=math.atan2(R[2, 1], R[2, 2]),
        pitch_rad=math.atan2(-R[2, 0], math.hypot(R[2, 1], R[2, 2])),
        yaw_rad=math.atan2(R[1, 0], R[0, 0]),
    )


def _matrix(packet: OxtsPacket, scale: float) -> Float64:
    """(4, 4) of the IMU in Mercator's plane, x east, y north, z up."""
    radius_m = scale * EARTH_RADIUS_M
    matrix = np.eye(4)
    matrix[:3, :3] = _rotation(packet.roll_rad, packet.pitch_rad, packet.yaw_rad)
    matrix[:3, 3] = (
        radius_m * math.radians(packet.longitude_deg),
        radius_m * math.log(math.tan(math.radians(90.0 + packet.latitude_deg) / 2.0)),
        packet.altitude_m,
    )
    return matrix


def _rotation(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Float64:
    """R_z(yaw) R_y(pitch) R_x(roll)."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    Rx = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    Ry = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    Rz = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(Rz @ Ry @ Rx, dtype=np.float64)
