"""Loops: keyframes that see a place again, each verified before it is told.

A place is looked for by its words among all earlier ones. A candidate must give one pose from
either side, on which many points all over the picture agree, and depths that fit; and a second
keyframe nearby must find the same loop. A false loop bends the whole map, a missed one leaves it
as odometry had it: so whatever is doubtful is refused, and counted with the reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.geometry.twists import inverted, log_twist
from pseudolidar.mapping.keyframe import movable_pixels
from pseudolidar.mapping.loop_check import Refusal, consistent, verified
from pseudolidar.mapping.place import Place, depth_cells, described, grey_cells
from pseudolidar.mapping.place_store import PlaceFile, PlaceNote, PlaceStore
from pseudolidar.mapping.words import WordIndex
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Detection
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.loop import LoopClosure, LoopEnd

# A frame is remembered when the camera went so far since the last one, m, or turned so far,
# degrees.
EVERY_M, EVERY_DEG = 3.0, 15.0
# Two loops confirm each other when their ends are this near along the path, m, and agree so well,
# m and degrees.
CONFIRM_M, AGREE_M, AGREE_DEG = 20.0, 0.4, 1.5
# Odometry is never off by more than this share of the path between, and this, m.
MOST_DRIFT, MOST_DRIFT_M = 0.1, 1.0


@dataclass(frozen=True)
class LoopFinder:
    """Finds places that were seen before.

    Args:
        candidates: how many of the most similar places are verified for each keyframe.
        apart_m: places of the same piece nearer than this along the path are no return.
        similarity: places must share so much, 0-1.
    """

    candidates: int = 2
    apart_m: float = 40.0
    similarity: float = 0.08

    def start(self, rig: StereoRig, file: PlaceFile | None = None) -> LoopSearch:
        """Begin with the cameras of all frames to come.

        Args:
            rig: rectified.
            file: that places are kept in; None for a temporary one without a name.

        Raises:
            UsageError: numbers that mean nothing.
            OutputError: a temporary file cannot be made.
        """
        if self.candidates < 1 or not self.apart_m > 0 or not 0 <= self.similarity < 1:
            raise UsageError(
                f"candidates {self.candidates}, apart {self.apart_m:g} m, similarity "
                f"{self.similarity:g}",
                want="1 or more, above 0 m, 0 to 1",
            )
        return LoopSearch(self, rig, file or PlaceFile())


class LoopSearch:
    """Remembers places, and tells loops; give it the frames that it wants, in order.

    Args:
        settings: as declared.
        rig: rectified; the correction it has is used unless `add` is given another.
        file: where places are kept.
    """

    def __init__(self, settings: LoopFinder, rig: StereoRig, file: PlaceFile) -> None:
        self._settings, self._rig = settings, rig
        self._index = WordIndex()
        self._places = PlaceStore(file)
        self._waiting: list[_Found] = []
        self._refused: Counter[Refusal] = Counter()
        self._unconfirmed = 0

    @property
    def places(self) -> int:
        """How many keyframes are remembered."""
        return len(self._places)

    @property
    def bytes(self) -> int:
        """What they take on disk."""
        return self._places.bytes

    @property
    def whole(self) -> bool:
        """Whether all that is remembered can be read."""
        return self._places.whole

    @property
    def refused(self) -> dict[Refusal, int]:
        """How many candidates were refused, by reason; those not confirmed yet among them."""
        waiting = sum(not found.told for found in self._waiting)
        return {**self._refused, "unconfirmed": self._unconfirmed + waiting}

    def wants(self, T_odom_camera: Float64, piece: int = 0) -> bool:
        """Whether a frame there is far enough from the last one that is remembered.

        Args:
            T_odom_camera: (4, 4) where odometry has it.
            piece: of odometry's path.
        """
        if not self._places or self._places[-1].end.piece != piece:
            return True
        step = log_twist(inverted(self._places[-1].T_odom_camera) @ T_odom_camera)
        turned_deg = float(np.rad2deg(np.linalg.norm(step[3:])))
        return bool(np.linalg.norm(step[:3]) >= EVERY_M or turned_deg >= EVERY_DEG)

    def add(
        self,
        index: int,
        frame: StereoFrame,
        disparity: DisparityMap,
        T_odom_camera: Float64,
        *,
        piece: int = 0,
        movable: Sequence[Detection] = (),
        correction: DisparityCorrection | None = None,
    ) -> list[LoopClosure]:
        """Remember a keyframe, and tell the loops that are certain by now.

        Args:
            index: of the frame in its source.
            frame: of the same rig as all, later than the one before.
            disparity: of its left image, as matched.
            T_odom_camera: (4, 4) where odometry has it.
            piece: of odometry's path.
            movable: things in its left image that may move by themselves.
            correction: systematic error of the disparities as known by now; the rig's by default.

        Returns:
            Loops that this keyframe confirms: with it as the later end, and ones found before.

        Raises:
            CalibrationSizeMismatch: the frame has another size than the rig.
            OutputError: the disk is full or gone.
        """
        self._rig.check_size(*frame.size_px)
        rig = self._rig if correction is None else self._rig.with_correction(correction)
        covered = movable_pixels(movable, disparity.values.shape)
        uv, d, descriptors = described(frame, disparity, rig, movable=covered)
        place = Place(
            len(self._places),
            LoopEnd(index, frame.timestamp_ns, piece),
            T_odom_camera,
            self._along_m(T_odom_camera, piece),
            uv,
            d,
            descriptors,
            depth_cells(disparity, rig).astype(np.float16),
            grey_cells(frame),
        )
        self._places.add(place)
        self._index.add(descriptors)
        for other in self._similar(place):
            loop = self._verified(other, place)
            if loop is not None:
                notes = self._places[other.number], self._places[place.number]
                return self._confirmed(_Found(loop, *notes))
        return []

    def _along_m(self, T_odom_camera: Float64, piece: int) -> float:
        """Path from the beginning of the piece."""
        if not self._places or self._places[-1].end.piece != piece:
            return 0.0
        last = self._places[-1]
        step_m = np.linalg.norm(T_odom_camera[:3, 3] - last.T_odom_camera[:3, 3])
        return last.along_m + float(step_m)

    def _similar(self, place: Place) -> list[Place]:
        """The places most like this one, none of them passed just before."""
        likeness = self._index.similar()
        for other in reversed(self._places):
            near = place.along_m - other.along_m < self._settings.apart_m
            if other.end.piece != place.end.piece or not near:
                break
            likeness[other.number] = 0.0
        best = np.argsort(-likeness, kind="stable")[: self._settings.candidates]
        chosen = [int(i) for i in best if likeness[i] > self._settings.similarity]
        return [self._places.load(i) for i in chosen]

    def _verified(self, earlier: Place, later: Place) -> LoopClosure | None:
        """The loop to a candidate; what is none is counted."""
        loop = verified(earlier, later, self._rig)
        if isinstance(loop, LoopClosure) and _beyond_drift(loop, earlier, later):
            loop = "drift"
        if isinstance(loop, LoopClosure):
            return loop
        self._refused[loop] += 1
        return None

    def _confirmed(self, found: _Found) -> list[LoopClosure]:
        """What becomes certain by a loop: nothing, or that one and others not told yet."""
        confirming = [one for one in self._waiting if one.confirms(found)]
        left = [one for one in self._waiting if not one.near_end_of(found.later)]
        self._unconfirmed += sum(not one.told for one in left)
        self._waiting = [one for one in self._waiting if one not in left] + [found]
        if not confirming:
            return []
        told = [one for one in (*confirming, found) if not one.told]
        for one in told:
            one.told = True
        return [one.loop for one in told]


@dataclass(eq=False)
class _Found:
    """A loop that waits for another to confirm it."""

    loop: LoopClosure
    earlier: PlaceNote
    later: PlaceNote
    told: bool = False

    def near_end_of(self, later: PlaceNote) -> bool:
        """Whether a later place is near enough to confirm it."""
        return _along(self.later, later) < CONFIRM_M

    def confirms(self, other: _Found) -> bool:
        """Whether another keyframe found the same loop."""
        if other.later is self.later or not self.near_end_of(other.later):
            return False
        if _along(self.earlier, other.earlier) >= CONFIRM_M:
            return False
        ends = zip((self.earlier, self.later), (other.earlier, other.later), strict=True)
        T_one, T_other = (inverted(a.T_odom_camera) @ b.T_odom_camera for a, b in ends)
        apart = consistent(self.loop, other.loop, T_one, T_other)
        turned_deg = float(np.rad2deg(np.linalg.norm(apart[3:])))
        return bool(np.linalg.norm(apart[:3]) < AGREE_M and turned_deg < AGREE_DEG)


def _along(one: PlaceNote | Place, other: PlaceNote | Place) -> float:
    """Path between two places, m; infinite between pieces."""
    same = one.end.piece == other.end.piece
    return abs(one.along_m - other.along_m) if same else float("inf")


def _beyond_drift(loop: LoopClosure, earlier: Place, later: Place) -> bool:
    """Whether odometry would have to be worse than it ever is."""
    if earlier.end.piece != later.end.piece:
        return False
    return loop.correction_m > MOST_DRIFT_M + MOST_DRIFT * _along(earlier, later)
