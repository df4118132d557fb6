"""Obstacles of one frame after the other to tracks: who is who, how fast, when it is here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pseudolidar.errors import SequenceTime, StructureError
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.obstacles.assignment import assigned
from pseudolidar.obstacles.contact import contact_of
from pseudolidar.obstacles.motion_filter import (
    Belief,
    Dynamics,
    Place,
    Straight,
    Turning,
    summed,
)
from pseudolidar.obstacles.movers import mover_of_class
from pseudolidar.obstacles.overlap import BoxPx
from pseudolidar.obstacles.placing import RELATIVE, all_placed, relative_pose
from pseudolidar.obstacles.pursued import Pursued
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Track
from pseudolidar.structures.camera import LEFT_FRAME
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose

# Without poses the camera's own motion is in that of everything: its speed, and by how much it
# changes within a second, one standard deviation each.
OWN_SPEED_M_S, OWN_WANDER_M_S = 10.0, 1.5
# For so long a box in the picture tells where it will be.
MOMENT_S = 0.25
# What stands mostly goes on standing: its velocity changes by this share of what that of a thing
# does which moves at this speed or faster.
STANDING_SHARE, BRISK_M_S = 0.3, 4.0


@dataclass(frozen=True)
class Tracker:
    """Follow obstacles from frame to frame, each with a filter of its place and velocity.

    Errors of a place are of three kinds: what changes from frame to frame, which averages out; what
    stays for a while (how a thing is hidden, the matcher's on that surface), and what the
    calibration of the rig leaves, which stays for ever and makes a thing that comes nearer seem
    slower or faster. The filter carries those that stay as states of their own, so that places and
    velocities are no surer than they let them be.

    Args:
        motion: how things move.
        persistent: share of the variance along the ray that stays from frame to frame, 0-1; what
            the calibration leaves is apart from that.
        persistent_across: likewise across the ray.
        persistent_s: for how long they stay.
        confirm: a track is believed when it was seen in so many frames.
        coast_s: a track that is not seen is predicted for so long, then it ends.
        doubt: a track that is not yet believed ends after so many frames without it.
    """

    motion: Straight | Turning = field(default_factory=Turning)
    persistent: float = 0.3
    persistent_across: float = 0.8
    persistent_s: float = 3.0
    confirm: int = 3
    coast_s: float = 2.0
    doubt: int = 2

    def load(self) -> Following:
        """A tracker that has seen nothing yet."""
        return Following(self)

    @property
    def shares(self) -> tuple[float, float]:
        """Of the variances along the ray and across it that stay."""
        return self.persistent, self.persistent_across

    def dynamics(self, one: Pursued, *, over_ground: bool) -> Dynamics:
        """How a thing moves, as seen from the ground or from the camera."""
        wander = mover_of_class(one.name).wander_m_s
        if not over_ground:
            return Dynamics(math.hypot(wander, OWN_WANDER_M_S), self.motion, self.persistent_s)
        quick = min(1.0, one.speed()[0] / BRISK_M_S)
        wander *= STANDING_SHARE + (1.0 - STANDING_SHARE) * quick
        return Dynamics(wander, self.motion, self.persistent_s)


@dataclass(frozen=True, eq=False)
class Followed:
    """A frame's obstacles with their tracks, and what was not seen.

    Args:
        obstacles: all of the frame, in their order, each with its track.
        coasting: tracks that were believed and are not seen now: where they should be.
        ended: identities of tracks that are given up with this frame.
    """

    obstacles: tuple[Obstacle, ...]
    coasting: tuple[Track, ...] = ()
    ended: tuple[int, ...] = ()


class Following:
    """Follows obstacles: fed frame by frame, in order.

    It can be pickled; `saved` gives its state as plain JSON values, `resumed` takes it.
    """

    def __init__(self, settings: Tracker) -> None:
        self.settings = settings
        self._world = ""
        self._now_ns: int | None = None
        self._own: tuple[Float64, Float64 | None] | None = None
        self._next_id = 1
        self._pursued: tuple[Pursued, ...] = ()

    def __call__(
        self, obstacles: Sequence[Obstacle], timestamp_ns: int, T_map_camera: Pose | None = None
    ) -> Followed:
        """Give every obstacle of a frame its track.

        Velocities are over ground, along the axes of `camera_left`, where poses are given, else
        relative to the camera. A sequence whose poses begin or end midway starts anew there.

        Args:
            obstacles: of the frame, in `camera_left`.
            timestamp_ns: of the frame; later than of the one before.
            T_map_camera: pose of the left camera, where it is known.

        Raises:
            SequenceTime: the frame is not later than the one before.
            StructureError: a pose of another frame.
        """
        T = relative_pose() if T_map_camera is None else T_map_camera
        if T.src != LEFT_FRAME:
            raise StructureError(f"T_{T.dst}_{T.src}", want=f"T_map_{LEFT_FRAME}", where="Tracker")
        ended = self._begin_frame(timestamp_ns, T)
        places = all_placed(obstacles, T, self.settings.shares)
        tracks: dict[int, Pursued] = {}
        # Believed tracks choose first: a doubtful one must not take what is theirs.
        for believed in (True, False):
            self._assign(obstacles, places, T, tracks, believed=believed)
        seen_ids = {one.track_id for one in tracks.values()}
        for index, (obstacle, place) in enumerate(zip(obstacles, places, strict=True)):
            if index not in tracks:
                tracks[index] = self._begun(obstacle, place, T)
        unseen, given_up = self._unseen(seen_ids)
        to_camera = T.inverse()
        seen = [tracks[index] for index in range(len(obstacles))]
        self._pursued = tuple(sorted([*seen, *unseen], key=lambda one: one.track_id))
        return Followed(
            tuple(
                replace(obstacle, track=self._told(one, to_camera))
                for obstacle, one in zip(obstacles, seen, strict=True)
            ),
            tuple(self._told(one, to_camera) for one in unseen if one.confirmed),
            (*ended, *given_up),
        )

    def _begin_frame(self, now_ns: int, T: Pose) -> tuple[int, ...]:
        """Predict all tracks to the time of the frame; those that cannot be are given up."""
        before = self._now_ns
        if before is not None and now_ns <= before:
            raise SequenceTime(
                f"a frame at {now_ns} ns after one at {before} ns", want="frames in order of time"
            )
        self._now_ns = now_ns
        ended: tuple[int, ...] = ()
        if T.dst != self._world:
            ended = tuple(one.track_id for one in self._pursued)
            self._world, self._pursued, self._own = T.dst, (), None
        eye = T.translation_m
        if before is None:
            self._own = (eye, None)
            return ended
        seconds = (now_ns - before) / NS_PER_S
        self._own = (eye, None if self._own is None else (eye - self._own[0]) / seconds)
        self._pursued = tuple(
            replace(one, belief=one.belief.after(seconds, self._dynamics(one)))
            for one in self._pursued
        )
        return ended

    def _dynamics(self, one: Pursued) -> Dynamics:
        return self.settings.dynamics(one, over_ground=self._over_ground)

    def _assign(
        self,
        obstacles: Sequence[Obstacle],
        places: Sequence[Place],
        T: Pose,
        tracks: dict[int, Pursued],
        *,
        believed: bool,
    ) -> None:
        """Give tracks the obstacles that are left; `tracks` gets them by obstacle."""
        assert self._now_ns is not None  # _begin_frame
        left = [index for index in range(len(obstacles)) if index not in tracks]
        old = [one for one in self._pursued if one.confirmed is believed]
        for row, column in assigned(
            [(one.name, one.belief, self._box_of_late(one)) for one in old],
            [(obstacles[i], places[i]) for i in left],
        ):
            index = left[column]
            one = old[row].again(obstacles[index], places[index], T, self._now_ns)
            confirmed = one.confirmed or one.seen >= self.settings.confirm
            tracks[index] = replace(one, confirmed=confirmed)

    def _box_of_late(self, one: Pursued) -> BoxPx | None:
        """Its box in the picture, where that was a moment ago."""
        assert self._now_ns is not None  # _begin_frame
        late = self._now_ns - one.last_ns <= MOMENT_S * NS_PER_S
        return one.box_px if late else None

    def _begun(self, obstacle: Obstacle, place: Place, T: Pose) -> Pursued:
        assert self._now_ns is not None  # _begin_frame
        speed = mover_of_class(obstacle.detection.name).speed_m_s
        own = 0.0 if self._over_ground else OWN_SPEED_M_S
        belief = Belief.begun(place, math.hypot(speed, own), self.settings.motion)
        one = Pursued.begun(self._next_id, obstacle, belief, T, self._now_ns)
        self._next_id += 1
        return replace(one, confirmed=self.settings.confirm <= 1)

    def _unseen(self, seen_ids: set[int]) -> tuple[list[Pursued], tuple[int, ...]]:
        """Tracks that were not seen: those that go on, and those that are given up."""
        unseen = [
            replace(one, missed=one.missed + 1)
            for one in self._pursued
            if one.track_id not in seen_ids
        ]
        kept = [one for one in unseen if self._goes_on(one)]
        kept_ids = {one.track_id for one in kept}
        return kept, tuple(one.track_id for one in unseen if one.track_id not in kept_ids)

    def _goes_on(self, one: Pursued) -> bool:
        assert self._now_ns is not None  # _begin_frame
        if not one.confirmed:
            return one.missed < self.settings.doubt
        return self._now_ns - one.last_ns <= self.settings.coast_s * NS_PER_S

    def _told(self, one: Pursued, T_camera_world: Pose) -> Track:
        """A track as others see it, in the camera's frame."""
        assert self._now_ns is not None  # _begin_frame
        R = T_camera_world.matrix[:3, :3]
        velocity, sigma = one.velocity_along(R)
        speed, sigma_speed = one.speed()
        box = one.box_in(T_camera_world)
        contact, covariance = None, one.covariance_along(R)
        if self._own_m_s is not None:
            relative = velocity - summed(R * self._own_m_s)
            contact = contact_of(box, relative, covariance)
        return Track(
            one.track_id,
            box,
            velocity,
            sigma,
            name=one.name,
            state=one.state,
            over_ground=self._over_ground,
            age_s=(self._now_ns - one.first_ns) / NS_PER_S,
            unseen_s=(self._now_ns - one.last_ns) / NS_PER_S,
            seen=one.seen,
            speed_m_s=speed,
            sigma_speed_m_s=sigma_speed,
            contact=contact,
            sigma_ahead_m=math.sqrt(max(float(covariance[2, 2]), 0.0)),
        )

    @property
    def _over_ground(self) -> bool:
        return self._world != RELATIVE

    @property
    def _own_m_s(self) -> Float64 | None:
        """(3,) velocity of the camera in the world; None where it is not known yet."""
        if not self._over_ground:
            return np.zeros(3)
        return None if self._own is None else self._own[1]

    def saved(self) -> dict[str, Any]:
        """All that it remembers, as plain JSON values, without loss."""
        own = self._own
        return {
            "world": self._world,
            "now_ns": self._now_ns,
            "own": own and [own[0].tolist(), None if own[1] is None else own[1].tolist()],
            "next_id": self._next_id,
            "tracks": [one.as_dict() for one in self._pursued],
        }

    def resumed(self, saved: dict[str, Any]) -> Following:
        """A tracker with these settings that remembers what another one saved."""
        other = Following(self.settings)
        other._world, other._now_ns = saved["world"], saved["now_ns"]
        if saved["own"] is not None:
            eye, velocity = saved["own"]
            other._own = (np.array(eye), None if velocity is None else np.array(velocity))
        other._next_id = saved["next_id"]
        other._pursued = tuple(Pursued.of(fields) for fields in saved["tracks"])
        return other
