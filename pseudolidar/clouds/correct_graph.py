"""Small surfaces of a cloud as the nodes of a graph, and one sparse solve for what is known at few.

A node is a cell of (column, row, disparity). Its neighbours are the nearest nodes of the same
surface, and its weights rebuild its disparity of theirs. What a node and its neighbours hold must
agree with these weights, so that a correction may be affine in the disparity along a surface, as
the errors of rigs are, and does not pass over the edges of objects.

Source: You et al., Pseudo-LiDAR++: Accurate Depth for 3D Object Detection in Autonomous Driving,
    ICLR 2020, section 4.2; there the nodes are points and their depths are rebuilt.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.structures.arrays import Float64, Int64

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

# A cell is this share of the image's width wide, half as high, and so deep (px of disparity). Half
# and twice the size: KITTI errors change by less than 0.1 % of the depth.
CELLS_ACROSS, CELL_DISPARITY_PX = 80, 1.5
# One step of distance between nodes: a cell's width in columns or rows, or so much disparity, px.
STEP_DISPARITY_PX = 2.0
# Nodes farther apart than so many steps are of different surfaces.
SAME_SURFACE_STEPS = 2.5
# Weights are drawn to those of a Gaussian of the distance by so much of the disparities' spread.
REGULARISATION, LEAST_REGULARISATION = 1e-3, 1e-6
LEAST_KERNEL = 1e-6
# A correction departs by so much from what its neighbours call for, px, and by so much from none.
# The ratio makes it fade out within about 6 nodes (100 px of KITTI) from the last known one.
SHAPE_PX, FREE_PX = 0.1, 3.5
# Solves, each with Cauchy weights by the residuals of the one before (four more change nothing).
SOLVES = 3
# Residuals below this many sigma are never taken for outliers.
LEAST_SCALE = 0.3
# A point takes its correction of so many nodes, by their distance, no less than this (steps).
BLENDED, LEAST_STEPS = 4, 0.05


@dataclass(frozen=True, eq=False)
class Known:
    """Values that are known at some points.

    Args:
        point: (M,) int64 rows of the points.
        value: (M,) px.
        sigma: (M,) px, one standard deviation.
    """

    point: Int64
    value: Float64
    sigma: Float64


@dataclass(frozen=True, eq=False)
class SurfaceGraph:
    """The nodes of a cloud and how they hold together.

    Args:
        steps: (N, 3) column, row and disparity of each point, in steps.
        node_of: (N,) int64 the node of each point.
        tree: of the nodes' positions in steps.
        shape: (nodes, nodes) sparse `(I - W)^T (I - W)`.
    """

    steps: Float64
    node_of: Int64
    tree: cKDTree
    shape: Any

    @classmethod
    def of(
        cls, u: Float64, v: Float64, d: Float64, *, width_px: int, neighbours: int
    ) -> SurfaceGraph:
        """Make nodes of points.

        Args:
            u: (N,) columns, px.
            v: (N,) rows, px.
            d: (N,) disparities, px.
            width_px: of the image.
            neighbours: of each node.
        """
        from scipy.spatial import cKDTree

        cell_px = width_px / CELLS_ACROSS
        steps = np.stack([u / cell_px, v / cell_px, d / STEP_DISPARITY_PX], axis=1)
        node_of = _cells(u / cell_px, 2 * v / cell_px, d / CELL_DISPARITY_PX)
        size = np.bincount(node_of)
        nodes = np.stack([np.bincount(node_of, column) / size for column in steps.T], axis=1)
        tree = cKDTree(nodes)
        return cls(steps, node_of, tree, _shape(nodes, tree, neighbours))

    def spread(self, known: Known) -> tuple[Float64, Float64]:
        """Carry what is known at some points to all.

        Minimises `|(I - W) x|^2 / shape^2 + sum((x - value)^2 / sigma^2) + |x|^2 / free^2`, robust
        to values that those around them contradict.

        Returns:
            (N,) px, 0 far from all that is known, and (N,) how much of it is known, 0 to 1: the
            solution where every value is 1.
        """
        from scipy import sparse
        from scipy.sparse.linalg import splu

        count = self.tree.n
        node = self.node_of[known.point]
        weight = 1.0 / known.sigma**2
        x = np.zeros(count)
        for turn in range(SOLVES):
            if turn:
                ratio = np.abs(known.value - x[node]) / known.sigma
                scale = max(LEAST_SCALE, float(np.median(ratio)))
                weight = 1.0 / known.sigma**2 / (1.0 + (ratio / scale) ** 2)
            held = np.bincount(node, weight, count) + 1.0 / FREE_PX**2
            # Symmetric and positive definite: no pivoting, and an ordering for such.
            solver = splu(
                sparse.csc_matrix(self.shape + sparse.diags(held)),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
            x = solver.solve(np.bincount(node, weight * known.value, count))
        share = np.clip(solver.solve(np.bincount(node, weight, count)), 0.0, 1.0)
        distance, near = _nearest(self.tree, self.steps, min(BLENDED, count))
        blend = 1.0 / np.maximum(distance, LEAST_STEPS) ** 2
        blend /= blend.sum(axis=1, keepdims=True)
        return (blend * x[near]).sum(axis=1), (blend * share[near]).sum(axis=1)


def _cells(*coordinates: Float64) -> Int64:
    """(N,) number of the occupied cell, of edge 1, that each point is in."""
    flat = np.zeros(len(coordinates[0]), np.int64)
    for coordinate in coordinates:
        cell = np.floor(coordinate).astype(np.int64)
        cell -= cell.min()
        flat = flat * (cell.max() + 1) + cell
    return np.asarray(np.unique(flat, return_inverse=True)[1], np.int64)


def _nearest(tree: cKDTree, positions: Float64, count: int) -> tuple[Float64, Int64]:
    """(N, count) distances and numbers of the nearest nodes, nearest first."""
    distance, near = tree.query(positions, np.arange(1, count + 1))
    return np.asarray(distance, np.float64), np.asarray(near, np.int64)


def _shape(nodes: Float64, tree: cKDTree, neighbours: int) -> Any:
    """`(I - W)^T (I - W) / SHAPE_PX^2`; W rebuilds the disparity of nodes of their neighbours'.

    Of the weights that sum to 1 and rebuild the disparity, those nearest to a Gaussian of the
    distance are taken. A node without neighbours on its surface is on its own.

    Source: Roweis & Saul, Nonlinear dimensionality reduction by locally linear embedding, Science
        2000, regularised as there.
    """
    from scipy import sparse

    count = len(nodes)
    neighbours = min(neighbours, count - 1)
    if neighbours < 1:
        return sparse.csr_matrix((count, count))
    distance, near = (found[:, 1:] for found in _nearest(tree, nodes, neighbours + 1))
    joined = distance <= SAME_SURFACE_STEPS
    apart = np.where(joined, nodes[near, 2] - nodes[:, 2:], 0.0)
    kernel = np.maximum(np.exp(-(distance**2) / 2), LEAST_KERNEL)
    spread = (apart**2).sum(axis=1, keepdims=True) / neighbours
    ridge = (REGULARISATION * spread + LEAST_REGULARISATION) / kernel
    # (a a^T + diag(ridge)) w = 1 in closed form (Sherman & Morrison).
    plain = joined / ridge
    tilted = apart * plain
    along = tilted.sum(axis=1, keepdims=True) / (1 + (apart * tilted).sum(axis=1, keepdims=True))
    weights = plain - tilted * along
    total = weights.sum(axis=1, keepdims=True)
    held = total[:, 0] > 0
    weights = np.divide(weights, total, out=np.zeros_like(weights), where=held[:, None])
    starts = np.arange(0, count * neighbours + 1, neighbours)
    W: Any = sparse.csr_matrix((weights.ravel(), near.ravel(), starts), (count, count))
    rest = sparse.diags(held.astype(np.float64)) - W
    return (rest.T @ rest) / SHAPE_PX**2
