"""A frame to what objects are looked for in: the depth of its pixels, and the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.clouds.ground import Ground
from pseudolidar.clouds.ground_fit import GroundFit
from pseudolidar.clouds.tool import forward_of, seen_in
from pseudolidar.errors import NoPairs
from pseudolidar.geometry.frame_chain import chain
from pseudolidar.geometry.frames import MAP, camera_tree, frame_tree
from pseudolidar.geometry.planes import Plane
from pseudolidar.obstacles.sight import Sight
from pseudolidar.running.matching import MatchFrame
from pseudolidar.stereo.filters.clean import Clean
from pseudolidar.stereo.reproject import Reproject, Reprojector
from pseudolidar.structures.arrays import Bool, Float32
from pseudolidar.structures.camera import LEFT_FRAME
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DepthMap, DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import DepthFrame, Frame

# Objects are looked for up to this range: farther, a KITTI rig has fewer than 2 px of disparity.
SIGHT_M = 200.0
# Of disparities in which objects are looked for, things as large as a hand stay.
SMALL_THINGS_KEPT = Clean(speckle_m2=0.005)


@dataclass(frozen=True, eq=False)
class Seen:
    """A frame with what is seen in it.

    Args:
        sight: for detectors and measures.
        cloud: of all pixels, in `camera_left`, organised as the picture.
        disparity: of a pair.
        T_map_camera: pose of the left camera, where the source knows it.
    """

    sight: Sight
    cloud: PointCloud
    disparity: DisparityMap | None = None
    T_map_camera: Pose | None = None


@dataclass(frozen=True)
class SightFrame:
    """Matches and reprojects a frame, and finds its ground: pure, picklable, one thread.

    Args:
        match: pair to disparity.
        reproject: disparity to an organised cloud.
        ground: finds the plane that things stand on; None where none is wanted.
        searched_px: disparities below this are looked for in pairs; None where that has no end.
    """

    match: MatchFrame
    reproject: Reprojector
    ground: Ground | None
    searched_px: int | None = None

    @classmethod
    def of(
        cls, match: MatchFrame, ground: GroundFit | None, *, searched_px: int | None = None
    ) -> SightFrame:
        """With everything heavy loaded."""
        reproject = Reproject(organised=True, max_range_m=SIGHT_M).load()
        grounded = None if ground is None else Ground("label", ground)
        return cls(match, reproject, grounded, searched_px)

    def __call__(self, frame: Frame) -> Seen:
        """What is seen in a frame.

        Raises:
            PairIdentical, LowTexture, MapEmpty: there is nothing to be seen.
            NoPairs: it has no picture.
        """
        match frame:
            case StereoFrame():
                return self._pair(frame)
            case DepthFrame():
                return self._depth(frame)
        raise NoPairs(
            f"frame {frame.id}: a {type(frame).__name__}",
            want="pairs, or pictures with their depth",
            fix="Take the rectified pairs of one rig; obstacles are looked for in pictures.",
        )

    def _pair(self, frame: StereoFrame) -> Seen:
        disparity = self.match.disparity(frame)
        cloud = self.reproject(frame, disparity)
        tree = frame_tree(frame.rig, frame.pose)
        ground, is_ground = self._ground(cloud, tree, frame.size_px)
        sight = Sight(
            frame.id,
            frame.left,
            frame.rig.left,
            depth_of(cloud, frame.size_px),
            frame.right,
            frame.rig,
            ground,
            is_ground,
            frame.labels,
            frame.rig.systematic_sigma_px,
            self.searched_px,
        )
        return Seen(sight, cloud, disparity, _pose(tree, known=frame.pose is not None))

    def _depth(self, frame: DepthFrame) -> Seen:
        cloud = self.reproject.of_depth(frame)
        tree = seen_in(frame.camera.frame, camera_tree(frame.camera, frame.pose))
        ground, is_ground = self._ground(cloud, tree, frame.size_px)
        depth = depth_of(cloud, frame.size_px)
        sight = Sight(
            frame.id, frame.image, frame.camera, depth, ground=ground, is_ground=is_ground
        )
        return Seen(sight, cloud, T_map_camera=_pose(tree, known=frame.pose is not None))

    def _ground(
        self, cloud: PointCloud, tree: tuple[Pose, ...], size_px: tuple[int, int]
    ) -> tuple[Plane | None, Bool | None]:
        """The plane in the frame of the cloud, and its pixels; None where none is found."""
        if self.ground is None:
            return None, None
        plane, is_ground = self.ground.found(cloud, tree)
        if plane is None:
            return None, None
        width, height = size_px
        plane = plane.transformed(forward_of(cloud, tree).inverse())
        return plane, is_ground.reshape(height, width)


def depth_of(cloud: PointCloud, size_px: tuple[int, int]) -> DepthMap:
    """Z of the pixels of an organised cloud of a camera, with its sigma where the cloud has one.

    Args:
        cloud: in a camera's frame, row by row.
        size_px: (width, height).
    """
    size = size_px[1], size_px[0]
    z = np.ascontiguousarray(cloud.xyz[:, 2], np.float32)
    if cloud.sigma_m is None:
        return DepthMap(z.reshape(size))
    return DepthMap(z.reshape(size), _along_axis(cloud).reshape(size))


def _along_axis(cloud: PointCloud) -> Float32:
    """(N,) sigma along the ray as one of Z."""
    x, y, z = cloud.xyz.T
    return np.asarray(cloud.sigma_m * z / np.sqrt(x * x + y * y + z * z), np.float32)


def _pose(tree: tuple[Pose, ...], *, known: bool) -> Pose | None:
    """`T_map_camera_left`, where the pose of the body is known."""
    return chain(tree, MAP, LEFT_FRAME) if known else None
