"""Which nodes of an octree a view needs, the most needed first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.quaternion import rotation_of
from pseudolidar.structures.arrays import Bool, Float64, Int64
from pseudolidar.viewer.octree.tree import Octree
from pseudolidar.viewer.picking import BESIDE_RAD

# Points of a node that would lie closer together than this on the page add nothing, px.
FINEST_PX = 1.2
# What is nearer to the eye counts as if it were here, as a share of the node's half edge.
NEAREST_SHARE = 0.25
# Angles of cameras that are believed, rad: browsers have about 1.3.
LEAST_FOV, MOST_FOV = 0.02, 3.0
MOST_HEIGHT_PX = 4320


@dataclass(frozen=True, eq=False)
class Eye:
    """From where somebody looks, in the frame of what is looked at.

    Args:
        position_m: (3,).
        R_world_eye: (3, 3) x right, y down, z forward.
        fov: vertical angle, rad.
        aspect: width over height of the page.
        height_px: of the page.
    """

    position_m: Float64
    R_world_eye: Float64
    fov: float
    aspect: float
    height_px: int

    @classmethod
    def of(
        cls,
        *,
        wxyz: Float64,
        position_m: Float64,
        fov: float,
        width_px: int,
        height_px: int,
        T_map_scene: Float64,
    ) -> Eye | None:
        """What a browser says of its camera, in another frame; None where that is no camera."""
        length = float(np.linalg.norm(wxyz))
        numbers = np.concatenate([wxyz, position_m, [fov, width_px, height_px]])
        if not (np.isfinite(numbers).all() and length > 0 and width_px > 0 and height_px > 0):
            return None
        R, t = T_map_scene[:3, :3], T_map_scene[:3, 3]
        return cls(
            np.asarray(R @ position_m + t),
            np.asarray(R @ rotation_of(wxyz / length)),
            float(np.clip(fov, LEAST_FOV, MOST_FOV)),
            width_px / height_px,
            min(int(height_px), MOST_HEIGHT_PX),
        )

    @property
    def focal_px(self) -> float:
        """Pixels of a thing as large as it is far away."""
        return float(0.5 * self.height_px / np.tan(0.5 * self.fov))

    def sides(self) -> tuple[Float64, Float64]:
        """(5, 3) normals to the inside and (5,) offsets m of what bounds the view: n p + d >= 0.

        The page is `-1` to `1` wide and high.
        """
        return self.sides_of((-1.0, -1.0), (1.0, 1.0))

    def sides_of(
        self, low: tuple[float, float], high: tuple[float, float]
    ) -> tuple[Float64, Float64]:
        """The same of a part of the page.

        Args:
            low: its left upper corner, -1 to 1.
            high: its right lower corner.
        """
        up = float(np.tan(0.5 * self.fov))
        across = up * self.aspect
        normals = np.array(
            [
                (1, 0, -low[0] * across),
                (-1, 0, high[0] * across),
                (0, 1, -low[1] * up),
                (0, -1, high[1] * up),
                (0, 0, 1),
            ]
        )
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        turned = normals @ self.R_world_eye.T
        return turned, -turned @ self.position_m


def within(tree: Octree, sides: tuple[Float64, Float64]) -> Bool:
    """(M,) whether a node may have points within planes of `Eye.sides`."""
    normals, offsets = sides
    middles, halves = tree.boxes_m
    inside = middles @ normals.T + offsets + halves @ np.abs(normals).T
    return np.asarray((inside >= 0).all(axis=1))


def along(tree: Octree, origin: Float64, direction: Float64) -> Int64:
    """Numbers of the nodes that may have points on a line of sight, or as near as is clicked.

    Args:
        tree: any.
        origin: (3,) of the line, in the frame of the tree.
        direction: (3,) of the line.
    """
    middles, halves = tree.boxes_m
    away, towards = middles - origin, direction / np.linalg.norm(direction)
    radii = np.linalg.norm(halves, axis=1)
    ahead = away @ towards
    beside = np.linalg.norm(away - ahead[:, None] * towards, axis=1)
    farthest_m = ahead + halves @ np.abs(towards)  # of each box, along the line
    reach = radii + BESIDE_RAD * np.maximum(farthest_m, 0)
    return np.flatnonzero((farthest_m > 0) & (beside <= reach))


def needs_px(tree: Octree, eye: Eye) -> Float64:
    """(M,) how far apart points are on the page without a node; 0 where it is not seen.

    That of a node is never below that of one that it is part of: in the order of their needs,
    coarse ones come before the fine ones that they hold.
    """
    middles, halves = tree.boxes_m
    beside = np.maximum(np.abs(middles - eye.position_m) - halves, 0)
    near_m = np.maximum(np.linalg.norm(beside, axis=1), NEAREST_SHARE * tree.half_m)
    spacing_m = 2 * tree.cube.spacing_m(tree.nodes["level"])
    return np.where(within(tree, eye.sides()), spacing_m * eye.focal_px / near_m, 0.0)


def chosen(needs: Float64, counts: Int64, budget: int) -> Int64:
    """Numbers of the nodes that are drawn, the most needed first.

    Args:
        needs: (M,) of `needs_px`.
        counts: (M,) points of each.
        budget: points in all.
    """
    order = np.argsort(-needs, kind="stable")
    order = order[needs[order] >= FINEST_PX]
    return np.asarray(order[np.cumsum(counts[order]) <= budget])


def point_sizes_m(tree: Octree, drawn: Int64) -> Float64:
    """(D,) sides that the points of drawn nodes need to close the surfaces that they lie on.

    Args:
        tree: with D drawn nodes among its M.
        drawn: (D,) their numbers.
    """
    parents, numbers = tree.parents, drawn.tolist()
    sizes_m = np.asarray(tree.cube.spacing_m(tree.nodes["level"]))
    for number in numbers:
        if tree.whole[number]:
            sizes_m[number] = tree.apart_m(number)
    # Coarse points lie among the fine ones of the nodes below.
    for number in sorted(numbers, reverse=True):
        above = int(parents[number])
        if above >= 0:
            sizes_m[above] = min(sizes_m[above], sizes_m[number])
    return np.asarray(sizes_m[drawn])
