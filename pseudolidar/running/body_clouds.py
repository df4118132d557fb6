"""What the pairs of a body have become, as one cloud in the frame of the body."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from pseudolidar.clouds.merge import merged
from pseudolidar.geometry.frames import MAP, ODOM
from pseudolidar.running.products.converted import Converted
from pseudolidar.structures.body import BASE_LINK, BodyFrame
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import RecordedCloud

# Column that says which pair saw a point: its number in the rig file, from 0.
SOURCE = "source"


def joined_on_body(
    frame: BodyFrame, parts: Mapping[str, Converted], lost: Iterable[str] = ()
) -> Converted:
    """The clouds of a body's pairs in `base_link`, each point with the number of its pair.

    Args:
        frame: what the pairs saw.
        parts: what they have become, by the name of the pair; clouds in the left camera.
        lost: why others have become nothing.
    """
    clouds = [
        _marked(part.cloud.transformed(frame.T_base_link_left[name]), frame.order.index(name))
        for name, part in parts.items()
    ]
    cloud = replace(merged(clouds), timestamp_ns=frame.timestamp_ns)
    counts: dict[str, float] = {}
    for name, part in parts.items():
        counts[f"points_{name}"] = int(np.count_nonzero(part.cloud.valid))
        for key, value in part.counts.items():
            counts[key] = counts.get(key, 0) + value
    whole = RecordedCloud(
        cloud,
        frame.id,
        frame.index,
        frame.timestamp_ns,
        body_tree(frame),
        frame.scan,
        (*frame.notes, *lost),
    )
    return Converted(whole, cloud, counts=counts)


def _marked(cloud: PointCloud, number: int) -> PointCloud:
    if cloud.shape is not None:
        cloud = cloud[cloud.valid]
    source = np.full(len(cloud), number, np.uint8)
    # Pixels of several pictures are no pixels of one.
    return replace(cloud, uv=None, extra={**cloud.extra, SOURCE: source})


def body_tree(frame: BodyFrame) -> tuple[Pose, ...]:
    """All transforms between `map`, `odom`, `base_link`, the cameras of all pairs and the LiDAR."""
    pose = Pose.identity(MAP, BASE_LINK) if frame.pose is None else frame.pose
    tree = [Pose.identity(MAP, ODOM), Pose(ODOM, BASE_LINK, pose.matrix)]
    for name, pair in frame.pairs.items():
        T_base_left = frame.T_base_link_left[name]
        T_base_right = T_base_left @ pair.rig.T_right_left.inverse()
        for T in (T_base_left, T_base_right):
            tree.append(Pose(BASE_LINK, f"{name}_{T.src}", T.matrix))
    if frame.T_base_link_lidar is not None:
        tree.append(frame.T_base_link_lidar)
    return tuple(tree)
