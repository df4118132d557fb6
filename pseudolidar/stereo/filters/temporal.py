"""`--temporal kalman`: disparities fused with those of the frames before, by known poses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.errors import PoseMissing, PseudolidarError, StereoConfig
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.triangulation import corrected_disparity
from pseudolidar.stereo.filters.map_filter import Filtered, sigma_or_usual
from pseudolidar.stereo.filters.sightings import PairSequence, Sighting, Sightings
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.structures.arrays import AnyArray, Bool, Float32, Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame

# What is carried from one frame to the next is less sure by a variance, px^2, and by an error of
# the distance that the poses say was moved, as a share of it (KITTI's 0.5 %, and its clock).
DRIFT_PX2, POSE_SHARE = 0.02, 0.01
# Earlier frames that must agree where there is no measurement now, and by how much sigma is larger.
AGREEING_FRAMES, CARRIED_SIGMAS = 3, 1.5
# Errors of one surface in neighbouring frames are much alike: of n equal ones the variance falls to
# this share + (1 - this) / n, not to 1 / n. Fitted to KITTI raw drive 0002 against Velodyne.
COMMON_SHARE = 0.6


@dataclass(frozen=True)
class Kalman:
    """Fuse each frame with the frames before it, of a source that knows its poses.

    What moves is told by its depth: it joins no earlier frame, unless it moves by less than the
    depths are sure to. Each frame is fused anew from its window: no state is carried on, so results
    do not depend on where a run starts.

    Args:
        window: frames that are fused, this one included.
        gate: largest disagreement, in its standard deviations; beyond it things have moved.
    """

    window: int = 5
    gate: float = 2.5

    def __post_init__(self) -> None:
        if not 2 <= self.window <= 64:
            raise StereoConfig(f"window = {self.window}", want="2 to 64 frames")
        if not 0 < self.gate < 100:
            raise StereoConfig(f"gate = {self.gate:g}", want="above 0, such as 2.5")

    def load(self, matcher: StereoMatcher, source: PairSequence) -> TemporalFilter:
        """The filter; its `sightings` are the matcher with a memory that it needs.

        Args:
            matcher: pair to disparity.
            source: where the frames come from, by their index.

        Raises:
            PoseMissing: the first frame has no pose.
        """
        from pseudolidar.stereo.filters import temporal_kernels  # noqa: F401  made on import

        _check_poses(source)
        return TemporalFilter(self, Sightings(matcher, source, self.window))


def _check_poses(source: PairSequence) -> None:
    try:
        first = source.load(0)
    except PseudolidarError:
        return  # it is named when its turn comes
    if first.pose is None:
        raise PoseMissing(
            "a source without poses",
            want="where each frame stood (KITTI raw with oxts, odometry with poses, synthetic)",
            fix="Leave out --temporal.",
        )


@dataclass(frozen=True)
class TemporalFilter:
    """A loaded `Kalman`."""

    settings: Kalman
    sightings: Sightings

    def __call__(self, frame: StereoFrame, disparity: DisparityMap) -> Filtered:
        """Fuse the map with what the frames before saw of the same surfaces.

        Where there is a measurement now, those join it that agree; what moved does not smear.
        Where there is none, three earlier frames that agree with each other stand in, with a larger
        sigma. A frame without pose, or whose predecessors have none, stays as it is.

        Source: weights of a Kalman filter for a constant state (static surfaces), the gate as in
            Kalman innovation tests.
        """
        now = Sighting(disparity, frame.rig, frame.pose)
        earlier = [
            seen
            for steps in range(1, self.settings.window)
            if (seen := self.sightings.of(frame.index - steps)) is not None
            and seen.pose is not None
        ]
        if frame.pose is None or not earlier:
            return Filtered(disparity, {"pixels_fused": 0, "pixels_carried_over": 0})
        fused, counts = self._fused(now, earlier)
        carried, carried_sigma = self._carried(now, earlier)
        values, sigma = fused.values, sigma_or_usual(fused)
        taken = ~fused.valid & np.isfinite(carried)
        values = np.where(taken, _as_measured(carried, taken, frame.rig), values)
        sigma = np.where(taken, carried_sigma, sigma)
        out = DisparityMap(values, None if disparity.sigma is None else sigma)
        done = {"pixels_fused": counts, "pixels_carried_over": int(np.count_nonzero(taken))}
        return Filtered(out, done)

    def _fused(self, now: Sighting, earlier: list[Sighting]) -> tuple[DisparityMap, int]:
        from pseudolidar.stereo.filters.temporal_kernels import gather

        values, sigma = _true(now), sigma_or_usual(now.disparity)
        shape = values.shape
        sums, weights = np.zeros(shape), np.zeros(shape)
        agreeing, contradicting = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
        for steps, seen in enumerate(earlier, start=1):
            T_seen_now = _motion(now, seen)
            gather(
                values,
                sigma,
                _true(seen),
                sigma_or_usual(seen.disparity),
                T_seen_now,
                _camera(now.rig),
                _camera(seen.rig),
                self.settings.gate,
                DRIFT_PX2 * steps,
                POSE_SHARE * float(np.linalg.norm(T_seen_now[:3, 3])),
                sums,
                weights,
                agreeing,
                contradicting,
            )
        # What moves may agree with the last frame by chance, but not with most of them.
        joined = agreeing > contradicting
        weights[~joined] = 0
        own = 1 / sigma.astype(np.float64) ** 2
        with np.errstate(invalid="ignore"):
            moved = np.where(joined, sums / (own + weights), 0).astype(np.float32)
            alike = COMMON_SHARE + (1 - COMMON_SHARE) * own / (own + weights)
        out_sigma = (sigma * np.sqrt(alike)).astype(np.float32)
        measured = now.disparity
        out = replace(measured, values=measured.values + moved, sigma=out_sigma)
        return out, int(np.count_nonzero(joined))

    def _carried(self, now: Sighting, earlier: list[Sighting]) -> tuple[Float32, Float32]:
        """What earlier frames agree upon in the holes, systematic error taken off."""
        from pseudolidar.stereo.filters.temporal_kernels import agree, scatter

        shape = (len(earlier), *now.disparity.values.shape)
        layers, sigmas = np.empty(shape, np.float32), np.empty(shape, np.float32)
        for seen, layer, sigma in zip(earlier, layers, sigmas, strict=True):
            scatter(
                _true(seen),
                sigma_or_usual(seen.disparity),
                np.linalg.inv(_motion(now, seen)),
                _camera(now.rig),
                _camera(seen.rig),
                layer,
                sigma,
            )
        out, out_sigma = np.empty(shape[1:], np.float32), np.empty(shape[1:], np.float32)
        holes = ~now.disparity.valid
        agree(
            layers,
            sigmas,
            holes,
            DRIFT_PX2,
            self.settings.gate,
            AGREEING_FRAMES,
            out,
            out_sigma,
        )
        return out, np.float32(CARRIED_SIGMAS) * out_sigma


def _motion(now: Sighting, seen: Sighting) -> Float64:
    """(4, 4) `T_seen_now` between the left cameras."""
    assert now.pose is not None
    assert seen.pose is not None
    T_map_now = now.pose @ left_in_base_link(now.rig)
    T_map_seen = seen.pose @ left_in_base_link(seen.rig)
    return np.ascontiguousarray((T_map_seen.inverse().matrix) @ T_map_now.matrix)


def _camera(rig: StereoRig) -> tuple[float, ...]:
    K = rig.left.K
    return (K[0, 0], K[1, 1], K[0, 2], K[1, 2], rig.fB_px_m, rig.doffs_px)


def _offset(values: AnyArray, where: Bool, rig: StereoRig) -> Float32:
    """(H, W) systematic error of the rig at disparities `values`, 0 elsewhere."""
    offset = np.zeros(values.shape, np.float32)
    if rig.correction is not None:
        v, u = (a.astype(np.float64) for a in np.nonzero(where))
        d = values[where].astype(np.float64)
        offset[where] = d - corrected_disparity(d, u, v, rig)
    return offset


def _true(seen: Sighting) -> Float32:
    """(H, W) disparities with the rig's systematic error taken off: poses are about metres."""
    disparity = seen.disparity
    return np.ascontiguousarray(
        disparity.values - _offset(disparity.values, disparity.valid, seen.rig)
    )


def _as_measured(values: Float32, where: Bool, rig: StereoRig) -> Float32:
    """Corrected disparities as the pair would have measured them; the error is smooth."""
    return values + _offset(values, where, rig)
