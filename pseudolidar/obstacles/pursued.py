"""What a tracker remembers of a thing that it follows, and of itself, between two frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pseudolidar.obstacles.motion_filter import PLACE, VELOCITY, Belief, Place, product, summed
from pseudolidar.obstacles.overlap import BoxPx
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Box3D, TrackState
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose

# Sizes are the mean of about so many of the last frames.
SIZE_FRAMES = 10


@dataclass(frozen=True, eq=False)
class Pursued:
    """One thing.

    Args:
        track_id: identity.
        belief: where it is and how it moves, at the time of the last frame.
        names: class names it was given, with the sum of their scores.
        size_m: (3,) length, width, height.
        sigma_size_m: (3,) one standard deviation of them.
        R_world_box: (3, 3) how it is turned.
        box_px: where it was in the picture when it was last seen.
        first_ns: when it was first seen.
        last_ns: when it was last seen.
        seen: in how many frames.
        missed: in how many frames since it was last seen.
        confirmed: it was seen often enough to be believed.
    """

    track_id: int
    belief: Belief
    names: dict[str, float]
    size_m: Float64
    sigma_size_m: Float64
    R_world_box: Float64
    box_px: BoxPx
    first_ns: int
    last_ns: int
    seen: int = 1
    missed: int = 0
    confirmed: bool = False

    @classmethod
    def begun(
        cls, track_id: int, obstacle: Obstacle, belief: Belief, T: Pose, now_ns: int
    ) -> Pursued:
        """Seen for the first time."""
        size_m, sigma_m, R = _looks(obstacle, T)
        names = {obstacle.detection.name: obstacle.detection.score}
        box_px = obstacle.detection.box_px
        return cls(track_id, belief, names, size_m, sigma_m, R, box_px, now_ns, now_ns)

    @property
    def name(self) -> str:
        """The class that it was taken for most."""
        return max(self.names, key=lambda name: self.names[name])

    @property
    def state(self) -> TrackState:
        """What it is told as."""
        if not self.confirmed:
            return "tentative"
        return "coasting" if self.missed else "confirmed"

    def again(self, obstacle: Obstacle, place: Place, T: Pose, now_ns: int) -> Pursued:
        """Seen again, at a place."""
        name, score = obstacle.detection.name, obstacle.detection.score
        size_m, sigma_m, R = _looks(obstacle, T)
        gain = 1.0 / min(self.seen + 1, SIZE_FRAMES)
        return replace(
            self,
            belief=self.belief.seen_with_doubt(place, self.seen),
            names={**self.names, name: self.names.get(name, 0.0) + score},
            size_m=self.size_m + gain * (size_m - self.size_m),
            sigma_size_m=sigma_m,
            R_world_box=R,
            box_px=obstacle.detection.box_px,
            last_ns=now_ns,
            seen=self.seen + 1,
            missed=0,
        )

    def box_in(self, T_camera_world: Pose) -> Box3D:
        """Its box in a camera's frame, with sigma."""
        centre = T_camera_world.apply(self.belief.mean[PLACE][None])[0]
        turned = product(T_camera_world.matrix[:3, :3], self.R_world_box)
        pose = Pose.from_rotation(T_camera_world.dst, "box", turned, centre)
        box_axes = np.ascontiguousarray(self.R_world_box.T)
        variances = variances_along(box_axes, self.belief.covariance[PLACE, PLACE])
        sigma = np.concatenate([np.sqrt(variances), self.sigma_size_m])
        length_m, width_m, height_m = (float(m) for m in self.size_m)
        return Box3D(pose, length_m, width_m, height_m, sigma)

    def velocity_along(self, axes: Float64) -> tuple[Float64, Float64]:
        """(3,) velocity along axes (3, 3), unit rows, and one standard deviation of each."""
        variances = variances_along(axes, self.belief.covariance[VELOCITY, VELOCITY])
        return summed(axes * self.belief.mean[VELOCITY]), np.sqrt(variances)

    def covariance_along(self, axes: Float64) -> Float64:
        """(6, 6) of position and velocity along axes (3, 3), unit rows."""
        columns, P = np.ascontiguousarray(axes.T), self.belief.covariance
        parts = (PLACE, VELOCITY)
        return np.block([[product(product(axes, P[a, b]), columns) for b in parts] for a in parts])

    def speed(self) -> tuple[float, float]:
        """On the level, and one standard deviation."""
        v, P = self.belief.mean[3:5], self.belief.covariance[3:5, 3:5]
        speed = float(np.hypot(v[0], v[1]))
        along = v / speed if speed > 0 else np.array([1.0, 0.0])
        variance = float(summed(summed(P * along) * along))
        return speed, float(np.sqrt(max(variance, 0.0)))

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain JSON values, without loss."""
        return {
            "track_id": self.track_id,
            "mean": self.belief.mean.tolist(),
            "covariance": self.belief.covariance.tolist(),
            "names": self.names,
            "size_m": self.size_m.tolist(),
            "sigma_size_m": self.sigma_size_m.tolist(),
            "R_world_box": self.R_world_box.tolist(),
            "box_px": list(self.box_px),
            "first_ns": self.first_ns,
            "last_ns": self.last_ns,
            "seen": self.seen,
            "missed": self.missed,
            "confirmed": self.confirmed,
        }

    @classmethod
    def of(cls, fields: dict[str, Any]) -> Pursued:
        """The same again."""

        def array(name: str) -> Float64:
            return np.array(fields[name], np.float64)

        left, top, right, bottom = fields["box_px"]
        return cls(
            fields["track_id"],
            Belief(array("mean"), array("covariance")),
            dict(fields["names"]),
            array("size_m"),
            array("sigma_size_m"),
            array("R_world_box"),
            (left, top, right, bottom),
            fields["first_ns"],
            fields["last_ns"],
            fields["seen"],
            fields["missed"],
            fields["confirmed"],
        )


def variances_along(axes: Float64, covariance: Float64) -> Float64:
    """(3,) variances along axes (3, 3), unit rows."""
    return np.maximum(summed(product(axes, covariance) * axes), 0.0)


def _looks(obstacle: Obstacle, T_world_camera: Pose) -> tuple[Float64, Float64, Float64]:
    """Size, its sigma, and how it is turned in the world."""
    box = obstacle.box
    size_m = np.array([box.length_m, box.width_m, box.height_m])
    sigma_m = np.array(box.sigma_m)[3:]
    R = product(T_world_camera.matrix[:3, :3], box.pose.matrix[:3, :3])
    return size_m, sigma_m, R
