"""What pictures say of the poses that odometry is judged by: of vision's path, and of the truth.

    python -m tests.benchmarks.truth_by_pictures [NAME ...]

Names: 06 and 0002 (KITTI), street (rendered, exact poses: the control); all by default. Corners
near the optical axis, where lenses bend nothing, are followed straight from one frame to another
five frames later, from where the truth has them on: vision's path has no part in that. "off" is how
far they are from where poses would have them (median, px right and down), "turned" how far
rotations of truth and vision differ (degrees about x, y, z). Then both paths from a frame on, as
they are and with the truth's axes turned by the constant angle that makes its steps point as
vision's do (none, were they the camera's); NEES of steps.
"""

from __future__ import annotations

import sys

import numpy as np

from pseudolidar.geometry.tracking import MatchedPair, track
from pseudolidar.geometry.triangulation import points_by_q
from pseudolidar.geometry.twists import exp_twist, inverted, log_twist
from pseudolidar.mapping.registration import offsets_px
from pseudolidar.mapping.visual_odometry import VisualOdometry
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.clean import Clean, Cleaner
from pseudolidar.structures.arrays import Float64
from tests.benchmarks.odometry import say, sources
from tests.mapping.worlds import Drive, drift

GAP = 5
# Frames from which on paths are told: the truth of 06 has settled after twelve.
STARTS = {"06": (0, 12), "0002": (0,), "street": (0,)}
# Tangent of the angle to the axis.
NEAR_AXIS = 0.35


class Watched:
    """A sequence, vision's path along it and the truth."""

    def __init__(self, name: str) -> None:
        source = sources(name)[0]
        frames = [source.load(i) for i in range(len(source.ids))]
        match, clean = Census().load(), Cleaner.load(Clean())
        self.rig = frames[0].rig
        chain = VisualOdometry().start(self.rig)
        matched = [(frame, clean(frame, match(frame)).disparity) for frame in frames]
        self.states = [chain.register(*each) for each in matched]
        (path,) = chain.trajectories()
        self.vision, self.truth = path.T_world_body, Drive.of(frames).T_odom
        self.correction = chain.correction
        self.pairs = [MatchedPair.of(*each) for each in matched]

    def off_px(self, first: int) -> tuple[Float64, Float64]:
        """(2,) px by vision and (2,) by the truth, of points followed from a frame over `GAP`."""
        guess = inverted(self.truth[first + GAP]) @ self.truth[first]
        tracks = track(self.pairs[first], self.pairs[first + GAP], self.rig, guess)
        d = tracks.d_from - offsets_px(tracks, self.rig, self.correction)[0]
        K = self.rig.left.K
        tangent = np.abs(tracks.uv_from[:, 0] - K[0, 2]) / K[0, 0]
        tracks, d = tracks[tangent < NEAR_AXIS], d[tangent < NEAR_AXIS]
        points = points_by_q(d, *tracks.uv_from.T, self.rig)
        errors = []
        for poses in (self.vision, self.truth):
            moved = inverted(poses[first + GAP]) @ poses[first]
            x, y, z = moved[:3, :3] @ points.T + moved[:3, 3:]
            seen = np.column_stack([K[0, 0] * x / z + K[0, 2], K[1, 1] * y / z + K[1, 2]])
            errors.append(tracks.uv_to - seen)
        by_vision, by_truth = (np.median(each, axis=0) for each in errors)
        return by_vision, by_truth

    def turned_deg(self, first: int) -> Float64:
        """(3,) rotation that the truth has and vision has not over `GAP`, about x, y, z."""
        steps = [inverted(T[first]) @ T[first + GAP] for T in (self.truth, self.vision)]
        return np.degrees(log_twist(inverted(steps[0]) @ steps[1])[3:])

    def direction(self, start: int) -> Float64:
        """(4, 4) the camera's axes in the truth's, by the mean direction of steps."""
        way = [np.diff(T[start:, :3, 3], axis=0) for T in (self.vision, self.truth)]
        seen, told = (
            np.einsum("nji,nj->ni", T[start:-1, :3, :3], each).mean(axis=0)
            for T, each in zip((self.vision, self.truth), way, strict=True)
        )
        seen, told = (each / np.linalg.norm(each) for each in (seen, told))
        return exp_twist(np.concatenate([np.zeros(3), np.cross(seen, told)]))

    def summary(self, start: int, truth: Float64) -> str:
        """Errors of the path from a frame on."""
        told = drift(inverted(self.vision[start]) @ self.vision[start:], truth_from(truth, start))
        nees = []
        for at in range(start + 1, len(truth)):
            step = self.states[at].step
            error = log_twist(step.T_to_from @ inverted(truth[at - 1]) @ truth[at])
            nees.append(error @ step.information @ error / 6)
        return (
            f"end {told.end_rel:.2%}, t_rel {told.t_rel:.2%}, {told.r_deg_per_m:.4f} deg/m, "
            f"NEES {np.mean(nees):.1f} (median {np.median(nees):.1f})"
        )


def truth_from(truth: Float64, start: int) -> Float64:
    """Poses from a frame on, in its own."""
    return inverted(truth[start]) @ truth[start:]


def main(names: list[str]) -> None:
    """Print what pictures say."""
    np.set_printoptions(precision=2, suppress=True, floatmode="fixed")
    for name in names or list(STARTS):
        watched = Watched(name)
        say(f"{name}: over {GAP} frames, off by vision, off by the truth, turned")
        for first in range(0, len(watched.truth) - GAP, 2):
            by_vision, by_truth = watched.off_px(first)
            say(f"  from {first:2d}  {by_vision}  {by_truth}  {watched.turned_deg(first)}")
        for start in STARTS[name]:
            say(f"  from {start} on: {watched.summary(start, watched.truth)}")
            C = watched.direction(start)
            turned = inverted(C) @ watched.truth @ C
            angle = np.degrees(log_twist(C)[3:])
            say(f"    its axes turned by {angle}: {watched.summary(start, turned)}")


if __name__ == "__main__":
    main(sys.argv[1:])
