"""The keyframes of a piece of path: the last ones held together by motions across them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.geometry.twists import inverted
from pseudolidar.mapping.disparity_offset import Offset
from pseudolidar.mapping.keyframe import Keyframe
from pseudolidar.mapping.path import Doubt, Hung, Path
from pseudolidar.mapping.registration import covariance, inliers, precisely
from pseudolidar.mapping.window import Edge, agreed
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection

# So many keyframes are held together; each new one is compared with the one before the last, too.
WINDOW, ACROSS = 6, 2


@dataclass(frozen=True, eq=False)
class _Node:
    """A keyframe in the window.

    Args:
        keyframe: what it shows.
        T_odom_camera: (4, 4) its pose.
        doubt: how unsure that is.
    """

    keyframe: Keyframe
    T_odom_camera: Float64
    doubt: Doubt


class Keyframes:
    """Keyframes of one piece, from its first one on.

    Args:
        first: whose camera is `odom`.
        rig: rectified.
        offset: known by now.
        least_inliers: points that must agree on a motion across.
    """

    def __init__(
        self, first: Keyframe, rig: StereoRig, offset: Offset, *, least_inliers: int
    ) -> None:
        self._rig, self._least_inliers = rig, least_inliers
        self._nodes = [_Node(first, np.eye(4), Doubt.none())]
        self._start = 0  # number of the first node in the window
        self._edges: list[Edge] = []
        self.path = Path()
        self.path.add_key(Hung.itself(offset))

    @property
    def newest(self) -> Keyframe:
        """With which frames are compared."""
        return self._nodes[-1].keyframe

    @property
    def T_odom_newest(self) -> Float64:
        """(4, 4) its pose."""
        return self._nodes[-1].T_odom_camera

    @property
    def doubt(self) -> Doubt:
        """How unsure that pose is."""
        return self._nodes[-1].doubt

    def add(self, keyframe: Keyframe, hung: Hung, correction: DisparityCorrection | None) -> None:
        """The next keyframe.

        Args:
            keyframe: what it shows.
            hung: at the newest one.
            correction: systematic error of the disparities, as known by now.
        """
        before = self._nodes[-1]
        T_odom = before.T_odom_camera @ hung.T_key_frame
        self._nodes.append(_Node(keyframe, T_odom, before.doubt.after(hung)))
        self.path.add_key(hung)
        last = self._start + len(self._nodes) - 1
        self._edges.append(Edge(last - 1, last, hung.T_key_frame, hung.covariance))
        across = self._across(correction)
        if across is not None:
            self._edges.append(across)
            self._agree()
        if len(self._nodes) > WINDOW:
            del self._nodes[0]
            self._start += 1
            self._edges = [edge for edge in self._edges if edge.first >= self._start]

    def _across(self, correction: DisparityCorrection | None) -> Edge | None:
        """The motion to the newest keyframe from the one before the last, if that sees enough."""
        if len(self._nodes) <= ACROSS:
            return None
        first, second = self._nodes[-1 - ACROSS], self._nodes[-1]
        guess = inverted(second.T_odom_camera) @ first.T_odom_camera
        sight = second.keyframe.sight
        motion = precisely(first.keyframe, sight, self._rig, guess, correction)
        if motion is None or inliers(motion) < self._least_inliers:
            return None
        last = self._start + len(self._nodes) - 1
        T_first_second = inverted(motion.T_to_from)
        return Edge(last - ACROSS, last, T_first_second, covariance(motion))

    def _agree(self) -> None:
        """Move the keyframes of the window to where all motions between them agree best."""
        T = np.stack([node.T_odom_camera for node in self._nodes])
        edges = [
            replace(edge, first=edge.first - self._start, second=edge.second - self._start)
            for edge in self._edges
        ]
        T = agreed(T, edges)
        self._nodes = [
            replace(node, T_odom_camera=pose) for node, pose in zip(self._nodes, T, strict=True)
        ]
        for place in range(1, len(T)):
            self.path.move_key(self._start + place, inverted(T[place - 1]) @ T[place])
