"""Where a lens puts the light of a direction, and where the light of a pixel comes from.

OpenCV's lens models: pinhole with k1 k2 p1 p2 [k3 [k4 k5 k6 [s1-s4 [tx ty]]]], and the fisheye of
Kannala and Brandt, k1-k4. Both hold only up to an angle: beyond it their polynomial turns back, and
what it says of such directions is the picture of another one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.camera import Camera

# Coefficients that the longest form of each model has; shorter ones end with zeros.
MOST_COEFFICIENTS = {"pinhole": 14, "fisheye": 4}
# A flat picture cannot show what is 90 degrees off its axis; this far the search for the angle
# at which a pinhole model turns back goes.
PINHOLE_LIMIT_RAD = np.deg2rad(88.0)
FISHEYE_LIMIT_RAD = np.pi
# Steps of that search: 0.02 degrees.
LIMIT_STEPS = 4400
# Newton's steps from pixel to direction, the step after which a pixel is done, and the residual
# that counts as arrived, in units of the focal length: a thousandth of a pixel at 1000 px.
NEWTON_STEPS = 12
STANDS = 1e-13
ARRIVED = 1e-6
DIFFERENCE = 1e-6

Pixels: TypeAlias = Float64


@dataclass(frozen=True, eq=False)
class Lens:
    """The way between directions in a camera's frame and its pixels.

    Args:
        camera: with its distortion.
        coefficients: all of its model's, zeros where the camera has fewer.
        limit_rad: angle off the axis up to which the model holds.
    """

    camera: Camera
    coefficients: Float64
    limit_rad: float

    @classmethod
    def of(cls, camera: Camera) -> Lens:
        """The lens of a camera."""
        coefficients = np.zeros(MOST_COEFFICIENTS[camera.model])
        coefficients[: len(camera.distortion)] = camera.distortion
        return cls(camera, coefficients, _limit_rad(camera.model, coefficients))

    def pixels(self, directions: Float64) -> tuple[Pixels, Bool]:
        """Where directions are seen.

        Args:
            directions: (..., 3) of any length, in the camera's frame (x right, y down, z forward).

        Returns:
            (..., 2) pixels, and (...) whether the model holds there. Where it does not, pixels are
            NaN. A pixel may be outside of the picture: see `inside`.
        """
        angle = np.arctan2(np.hypot(directions[..., 0], directions[..., 1]), directions[..., 2])
        holds = angle <= self.limit_rad
        with np.errstate(divide="ignore", invalid="ignore"):
            xy = self._plane(directions, angle)
        K = self.camera.K
        uv = np.empty(xy.shape)
        uv[..., 0] = K[0, 0] * xy[..., 0] + K[0, 1] * xy[..., 1] + K[0, 2]
        uv[..., 1] = K[1, 1] * xy[..., 1] + K[1, 2]
        uv[~holds] = np.nan
        return uv, holds

    def directions(self, uv: Pixels) -> Float64:
        """Where the light of pixels comes from.

        Args:
            uv: (..., 2) pixels.

        Returns:
            (..., 3) unit vectors in the camera's frame; NaN where no direction that the model holds
            for is seen at that pixel.
        """
        angle, azimuth = self._angles(uv)
        return _turned(angle, azimuth)

    def nearest_directions(self, uv: Pixels) -> Float64:
        """As `directions`; where nothing is seen (a dark corner) that at the edge of what is."""
        angle, azimuth = self._angles(uv)
        dark = np.isnan(angle)
        x, y = self._in_focal_lengths(uv)
        around = np.arctan2(y, x)
        return _turned(np.where(dark, self.limit_rad, angle), np.where(dark, around, azimuth))

    def _in_focal_lengths(self, uv: Pixels) -> tuple[Float64, Float64]:
        """(...) x and y of pixels from the centre, where the lens has put them."""
        K = self.camera.K
        y = (uv[..., 1] - K[1, 2]) / K[1, 1]
        return (uv[..., 0] - K[0, 2] - K[0, 1] * y) / K[0, 0], y

    def _angles(self, uv: Pixels) -> tuple[Float64, Float64]:
        """(...) angles off the axis, NaN where nothing is seen, and around it."""
        x, y = self._in_focal_lengths(uv)
        wanted = np.stack([x, y], axis=-1)
        r = np.hypot(x, y)
        azimuth = np.arctan2(y, x)
        angles = np.linspace(0.0, self.limit_rad, LIMIT_STEPS)
        radii = _radial(self.camera.model, self.coefficients, angles)
        angle = np.interp(r, radii, angles, right=np.nan)
        if self.camera.model == "fisheye":
            angle = self._fisheye_angle(r, angle)
        else:
            angle, azimuth = self._pinhole_angles(wanted, angle, azimuth)
        return np.where(angle <= self.limit_rad, angle, np.nan), azimuth

    def inside(self, uv: Pixels) -> Bool:
        """(...) whether pixels (..., 2) lie between pixels of the picture."""
        width, height = self.camera.size_px
        with np.errstate(invalid="ignore"):
            wide = (uv[..., 0] >= 0) & (uv[..., 0] <= width - 1)
            return np.asarray(wide & (uv[..., 1] >= 0) & (uv[..., 1] <= height - 1))

    def _plane(self, directions: Float64, angle: Float64) -> Float64:
        """(..., 2) where directions meet the plane at distance one, after distortion."""
        if self.camera.model == "fisheye":
            side = np.hypot(directions[..., 0], directions[..., 1])
            bent = _radial("fisheye", self.coefficients, angle)
            scale = np.divide(bent, side, out=np.ones(side.shape), where=side > 0)
            return np.asarray(directions[..., :2] * scale[..., None])
        return _pinhole_plane(directions[..., :2] / directions[..., 2:], self.coefficients)

    def _fisheye_angle(self, r: Float64, angle: Float64) -> Float64:
        """Newton's steps to the angle that is bent to `r`, from a near one."""
        for _ in range(2):
            miss = _radial("fisheye", self.coefficients, angle) - r
            angle = angle - miss / _radial_slope(self.coefficients, angle)
        return angle

    def _pinhole_angles(
        self, wanted: Float64, angle: Float64, azimuth: Float64
    ) -> tuple[Float64, Float64]:
        """Angle off the axis and around it of what is bent to `wanted`, by Newton's steps."""
        r = np.tan(angle)
        xy = np.stack([r * np.cos(azimuth), r * np.sin(azimuth)], axis=-1)
        moving = np.isfinite(xy).all(axis=-1)
        for _ in range(NEWTON_STEPS):
            step = _newton_step(xy[moving], wanted[moving], self.coefficients)
            xy[moving] -= step
            moving[moving] = np.abs(step).max(axis=-1) > STANDS
        with np.errstate(invalid="ignore"):
            left = np.abs(_pinhole_plane(xy, self.coefficients) - wanted).max(axis=-1)
            xy[~(left < ARRIVED)] = np.nan
        return np.arctan(np.hypot(xy[..., 0], xy[..., 1])), np.arctan2(xy[..., 1], xy[..., 0])


def _turned(angle: Float64, azimuth: Float64) -> Float64:
    """(..., 3) unit vectors."""
    side = np.sin(angle)
    return np.stack([side * np.cos(azimuth), side * np.sin(azimuth), np.cos(angle)], axis=-1)


def _limit_rad(model: str, coefficients: Float64) -> float:
    """Angle at which what is seen further out begins to come nearer to the axis again."""
    end = PINHOLE_LIMIT_RAD if model == "pinhole" else FISHEYE_LIMIT_RAD
    angles = np.linspace(0.0, end, LIMIT_STEPS)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        grows = np.diff(_radial(model, coefficients, angles)) > 0
    return float(angles[-1] if grows.all() else angles[max(int(np.argmin(grows)), 1)])


def _radial(model: str, k: Float64, angle: Float64) -> Float64:
    """Distance from the axis, in focal lengths, at which what is `angle` off it is seen."""
    if model == "fisheye":
        a2 = angle * angle
        return np.asarray(angle * (1 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3])))))
    r = np.tan(angle)
    return np.asarray(r * _ratio(r * r, k))


def _radial_slope(k: Float64, angle: Float64) -> Float64:
    a2 = angle * angle
    return np.asarray(1 + a2 * (3 * k[0] + a2 * (5 * k[1] + a2 * (7 * k[2] + a2 * 9 * k[3]))))


def _ratio(r2: Float64, k: Float64) -> Float64:
    """Radial factor of the pinhole model at squared distance `r2`."""
    above = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    below = 1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]))
    return np.asarray(above / below)


def _pinhole_plane(xy: Float64, k: Float64) -> Float64:
    """(..., 2) distorted points of the plane at distance one.

    Source: OpenCV, module calib, "Detailed description", with all 14 coefficients.
    """
    x, y = xy[..., 0], xy[..., 1]
    r2, product = x * x + y * y, 2 * x * y
    radial = _ratio(r2, k)
    bent = np.empty(xy.shape)
    bent[..., 0] = x * radial + k[2] * product + k[3] * (r2 + 2 * x * x)
    bent[..., 1] = y * radial + k[2] * (r2 + 2 * y * y) + k[3] * product
    bent[..., 0] += r2 * (k[8] + r2 * k[9])
    bent[..., 1] += r2 * (k[10] + r2 * k[11])
    return _tilted(bent, k[12], k[13]) if k[12:].any() else bent


def _newton_step(xy: Float64, wanted: Float64, k: Float64) -> Float64:
    """(N, 2) what to take off points of the plane that shall be bent to `wanted`."""
    miss = _pinhole_plane(xy, k) - wanted
    step = np.eye(2) * DIFFERENCE
    ahead, behind = ([_pinhole_plane(xy + way * each, k) for each in step] for way in (1, -1))
    J = (np.stack(ahead, axis=-1) - np.stack(behind, axis=-1)) / (2 * DIFFERENCE)
    determinant = J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] * J[..., 1, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        dx = (J[..., 1, 1] * miss[..., 0] - J[..., 0, 1] * miss[..., 1]) / determinant
        dy = (J[..., 0, 0] * miss[..., 1] - J[..., 1, 0] * miss[..., 0]) / determinant
    return np.stack([dx, dy], axis=-1)


def _tilted(bent: Float64, tau_x: float, tau_y: float) -> Float64:
    """Points as a sensor sees them that is turned about x, then y.

    Source: OpenCV, the Scheimpflug part of the same description.
    """
    cx, sx, cy, sy = np.cos(tau_x), np.sin(tau_x), np.cos(tau_y), np.sin(tau_y)
    about_x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    about_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    R: npt.NDArray[np.float64] = about_y @ about_x
    onto = np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]]) @ R
    x, y = bent[..., 0], bent[..., 1]
    w = onto[2, 0] * x + onto[2, 1] * y + onto[2, 2]
    tilted = np.empty(bent.shape)
    tilted[..., 0] = (onto[0, 0] * x + onto[0, 1] * y + onto[0, 2]) / w
    tilted[..., 1] = (onto[1, 0] * x + onto[1, 1] * y + onto[1, 2]) / w
    return tilted
