"""Chains of transforms between named frames, and what is between two times of one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from pseudolidar.geometry.quaternion import quaternion_wxyz, rotation_of, slerp
from pseudolidar.structures.pose import Pose


def chain(tree: Iterable[Pose], dst: str, src: str) -> Pose | None:
    """`T_dst_src` along a tree of `T_parent_child`; None where it does not connect them."""
    parents = {pose.src: pose for pose in tree}
    up_src, up_dst = _ups(parents, src), _ups(parents, dst)
    for name, T_name_src in up_src.items():
        if name in up_dst:
            return up_dst[name].inverse() @ T_name_src
    return None


def ancestors(tree: Iterable[Pose], name: str) -> tuple[str, ...]:
    """The frame itself and all above it in a tree of `T_parent_child`, nearest first."""
    return tuple(_ups({pose.src: pose for pose in tree}, name))


def _ups(parents: Mapping[str, Pose], name: str) -> dict[str, Pose]:
    """`T_ancestor_name` of the frame itself and of all above it, nearest first."""
    ups = {name: Pose.identity(name, name)}
    at, T_at_name = name, ups[name]
    while at in parents and parents[at].dst not in ups:  # else a circle, which is no tree
        T_at_name = parents[at] @ T_at_name
        at = T_at_name.dst
        ups[at] = T_at_name
    return ups


def between(early: Pose, late: Pose, share: float) -> Pose:
    """The pose at `share` (0-1) of the time between two: linear, rotation on the shortest arc."""
    a, b = (quaternion_wxyz(pose.matrix[:3, :3]) for pose in (early, late))
    t_m = early.translation_m * (1 - share) + late.translation_m * share
    return Pose.from_rotation(
        early.dst, early.src, rotation_of(slerp(a, b, share)), np.asarray(t_m)
    )
