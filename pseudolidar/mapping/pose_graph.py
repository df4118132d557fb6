"""Loops closed: poses of all frames that odometry and loops agree on.

Only the ends of loops are nodes of the graph: the frames between them hang on a chain, whose
covariances add up to one edge, and follow it afterwards by as much as each step is unsure. So the
graph has as many nodes as loops have ends, however long the path is.

Source: Choi, Zhou & Koltun, Robust Reconstruction of Indoor Scenes, CVPR 2015 (line process), as
Open3D has it.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.errors import PoseMissing
from pseudolidar.geometry.open3d_library import load_open3d
from pseudolidar.geometry.pose_doubt import step_doubt
from pseudolidar.geometry.twists import adjoint, exp_twist, inverted, log_twist
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.loop import ClosedPath, LoopClosure, LoopEnd
from pseudolidar.structures.pose import Trajectory

# What covariances of odometry do not hold (rows, lens): a path of 1 m, and of more by its root,
# is off by this share, m, and turned by this, rad. KITTI: 0.1 degrees in 10 m.
UNKNOWN_M, UNKNOWN_RAD = 0.01, float(np.deg2rad(0.03))
# A camera that stands does not drift; no step is surer than this, m and rad.
LEAST_M, LEAST_RAD = 1e-4, 1e-5
# Loops that disagree by more standard deviations are dropped: with half a weight at this many.
DOUBTED_SIGMAS, LEAST_WEIGHT = 6.0, 0.25
# What matched points do not tell of a loop's error (offset of disparities, lens), m and rad.
LOOP_M, LOOP_RAD = 0.03, 0.001
# Doubt sets in by these factors of that number.
PATIENCE = (1000.0, 100.0, 10.0, 3.0, 1.0)
# More loops are not solved together.
MOST_LOOPS = 200
# Open3D counts rotations first.
ROTATION_FIRST = np.array([3, 4, 5, 0, 1, 2])
ITERATIONS = 100


def closed(trajectories: Sequence[Trajectory], loops: Sequence[LoopClosure]) -> ClosedPath:
    """Poses of all frames with the loops closed.

    Args:
        trajectories: of odometry's pieces, `T_odom_camera`, as it tells them at the end; with their
            covariances where it knows them.
        loops: verified; ends are found by their time and piece. Of more than 200 every second,
            third... between the same pieces is taken: Open3D's solver is dense.

    Returns:
        As many trajectories, of the same times. The first frame of the first piece of each map
        stays where it was.

    Raises:
        PoseMissing: a loop ends at a frame that its piece has no pose of.
        MissingDependency: open3d is absent.
    """
    chains = [Chain.of(trajectory) for trajectory in trajectories]
    loops = _thinned(loops)
    maps = _maps(len(chains), loops)
    if not loops:
        return ClosedPath(tuple(trajectories), maps)
    graph = _Graph.of(chains, loops, maps)
    poses, kept = graph.solved()
    moved = [graph.moved(piece, chain, poses) for piece, chain in enumerate(chains)]
    used = tuple(loop for loop, good in zip(loops, kept, strict=True) if good)
    dropped = tuple(loop for loop, good in zip(loops, kept, strict=True) if not good)
    if dropped:
        # Without those that disagree pieces may have nothing that joins them.
        return ClosedPath(*_again(trajectories, used), used, dropped)
    return ClosedPath(tuple(moved), maps, used, dropped)


def _thinned(loops: Sequence[LoopClosure]) -> list[LoopClosure]:
    """About so many that can be solved, spread over the path; some between any two pieces."""
    every = -(-len(loops) // MOST_LOOPS) or 1
    counted: Counter[tuple[int, int]] = Counter()
    taken = []
    for loop in loops:
        pieces = (loop.earlier.piece, loop.later.piece)
        if counted[pieces] % every == 0:
            taken.append(loop)
        counted[pieces] += 1
    return taken


def _again(
    trajectories: Sequence[Trajectory], used: tuple[LoopClosure, ...]
) -> tuple[tuple[Trajectory, ...], tuple[int, ...]]:
    path = closed(trajectories, used)
    return path.trajectories, path.maps


@dataclass(frozen=True, eq=False)
class Chain:
    """A piece of path with how unsure each of its steps is.

    Args:
        trajectory: of odometry.
        steps: (N, 6, 6) covariance of the step to each frame, a twist on its right; the first 0.
    """

    trajectory: Trajectory
    steps: Float64

    @classmethod
    def of(cls, trajectory: Trajectory) -> Chain:
        """By what odometry knows, and by what it does not."""
        T = trajectory.T_world_body
        steps = np.zeros((len(T), 6, 6))
        for i in range(1, len(T)):
            step = inverted(T[i - 1]) @ T[i]
            way_m = float(np.linalg.norm(step[:3, 3]))
            doubt = np.repeat([LEAST_M**2 + UNKNOWN_M**2 * way_m, 0.0], 3)
            doubt[3:] = LEAST_RAD**2 + UNKNOWN_RAD**2 * way_m
            steps[i] = np.diag(doubt)
            if trajectory.covariance is not None:
                before, now = trajectory.covariance[i - 1 : i + 1]
                steps[i] += step_doubt(before, now, step)
        return cls(trajectory, steps)

    def place(self, end: LoopEnd) -> int:
        """Which of its frames an end is.

        Raises:
            PoseMissing: none.
        """
        times = self.trajectory.timestamps_ns
        at = int(np.searchsorted(times, end.timestamp_ns))
        if at == len(times) or times[at] != end.timestamp_ns:
            raise PoseMissing(
                f"a loop at frame {end.index}, {end.timestamp_ns} ns, of which piece {end.piece} "
                "has no pose",
                want="ends of loops among the frames of the path",
            )
        return at

    def between(self, first: int, last: int) -> Float64:
        """(last - first + 1, 6, 6) covariance that grows along a part, as its last frame sees it.

        The first is 0, the last that of the whole part.
        """
        T = self.trajectory.T_world_body
        grown = np.zeros((last - first + 1, 6, 6))
        for i in range(first + 1, last + 1):
            carried = adjoint(inverted(T[last]) @ T[i])
            grown[i - first] = grown[i - first - 1] + carried @ self.steps[i] @ carried.T
        return grown

    def bent(self, first: int, last: int, T_first: Float64, T_last: Float64) -> Float64:
        """(last - first + 1, 4, 4) poses of a part whose ends were moved."""
        T = self.trajectory.T_world_body
        by_chain = T_first @ inverted(T[first]) @ T[first : last + 1]
        grown = self.between(first, last)
        error = log_twist(inverted(by_chain[-1]) @ T_last)
        pull = np.linalg.solve(grown[-1], error) if last > first else error
        bent = np.empty_like(by_chain)
        for i, pose in enumerate(by_chain):
            carried = adjoint(inverted(pose) @ by_chain[-1])
            bent[i] = pose @ exp_twist(carried @ grown[i] @ pull)
        if last > first:
            bent[-1] = T_last
        return bent


def _maps(pieces: int, loops: Sequence[LoopClosure]) -> tuple[int, ...]:
    """(pieces,) number of the map of each piece: pieces that loops join have one."""
    first = list(range(pieces))
    for loop in loops:
        one, other = first[loop.earlier.piece], first[loop.later.piece]
        first = [min(one, other) if root in (one, other) else root for root in first]
    numbers = {root: number for number, root in enumerate(sorted(set(first)))}
    return tuple(numbers[root] for root in first)


@dataclass(frozen=True, eq=False)
class _Edge:
    first: int
    second: int
    T_first_second: Float64
    covariance: Float64
    loop: int | None = None


@dataclass(frozen=True, eq=False)
class _Graph:
    """Ends of loops and of pieces, and what is known between them.

    Args:
        nodes: (piece, frame of the piece) of each, by piece and time.
        poses: (N, 4, 4) first guesses, in the map of their piece.
        edges: chains and loops.
        loops: how many.
    """

    nodes: list[tuple[int, int]]
    poses: Float64
    edges: list[_Edge]
    loops: int

    @classmethod
    def of(
        cls, chains: Sequence[Chain], loops: Sequence[LoopClosure], maps: Sequence[int]
    ) -> _Graph:
        ends = [
            tuple((end.piece, chains[end.piece].place(end)) for end in (loop.earlier, loop.later))
            for loop in loops
        ]
        starts = {(piece, 0) for piece, chain in enumerate(chains) if len(chain.trajectory)}
        nodes = sorted(starts.union(*ends))
        number = {node: i for i, node in enumerate(nodes)}
        edges = []
        for before, after in itertools.pairwise(nodes):
            if before[0] == after[0]:
                chain = chains[before[0]]
                T = chain.trajectory.T_world_body
                step = inverted(T[before[1]]) @ T[after[1]]
                doubt = chain.between(before[1], after[1])[-1]
                edges.append(_Edge(number[before], number[after], step, doubt))
        own = np.diag(np.repeat([LOOP_M**2, LOOP_RAD**2], 3))
        for i, (loop, (earlier, later)) in enumerate(zip(loops, ends, strict=True)):
            doubt = loop.covariance + own
            edges.append(_Edge(number[earlier], number[later], loop.T_earlier_later, doubt, loop=i))
        starts_T = _piece_starts(chains, loops, ends, maps)
        poses = [starts_T[p] @ chains[p].trajectory.T_world_body[i] for p, i in nodes]
        return cls(nodes, np.stack(poses), edges, len(loops))

    def solved(self) -> tuple[Float64, list[bool]]:
        """(N, 4, 4) poses that the edges agree on, and which loops they keep.

        Loops far from where odometry has them would be doubted at once: at first all are believed,
        then doubt comes in steps (graduated non-convexity, Yang et al. 2020).
        """
        poses = self.poses
        for patience in PATIENCE:
            poses, kept = _optimised(poses, self.edges, patience)
        return poses, kept

    def moved(self, piece: int, chain: Chain, poses: Float64) -> Trajectory:
        """The poses of a piece when those of its nodes are these."""
        T = chain.trajectory.T_world_body
        out = T.copy()
        at = [(i, frame) for i, (p, frame) in enumerate(self.nodes) if p == piece]
        for (i, first), (j, last) in itertools.pairwise(at):
            out[first : last + 1] = chain.bent(first, last, poses[i], poses[j])
        if at:
            i, last = at[-1]
            out[last:] = poses[i] @ inverted(T[last]) @ T[last:]
        return Trajectory(chain.trajectory.timestamps_ns, out, chain.trajectory.covariance)


def _piece_starts(
    chains: Sequence[Chain],
    loops: Sequence[LoopClosure],
    ends: Sequence[tuple[tuple[int, int], ...]],
    maps: Sequence[int],
) -> dict[int, Float64]:
    """For each piece (4, 4) `T_map_odom`, by the first loops that join it to its map."""
    starts: dict[int, Float64] = {}
    for piece, number in enumerate(maps):
        if number not in maps[:piece]:
            starts[piece] = np.eye(4)
    while len(starts) < len(chains):
        for loop, (earlier, later) in zip(loops, ends, strict=True):
            T_earlier, T_later = (chains[p].trajectory.T_world_body[i] for p, i in (earlier, later))
            T = T_earlier @ loop.T_earlier_later @ inverted(T_later)
            if earlier[0] in starts and later[0] not in starts:
                starts[later[0]] = starts[earlier[0]] @ T
            elif later[0] in starts and earlier[0] not in starts:
                starts[earlier[0]] = starts[later[0]] @ inverted(T)
    return starts


def _optimised(
    poses: Float64, edges: Sequence[_Edge], patience: float
) -> tuple[Float64, list[bool]]:
    """Poses nearer to agreement, and which loops have more than the least weight."""
    registration = load_open3d().pipelines.registration
    graph = registration.PoseGraph()
    for pose in poses:
        graph.nodes.append(registration.PoseGraphNode(pose))
    for edge in edges:
        graph.edges.append(_open3d_edge(registration, edge))
    option = registration.GlobalOptimizationOption(
        max_correspondence_distance=patience * _reach(edges),
        edge_prune_threshold=LEAST_WEIGHT if patience == PATIENCE[-1] else 0.0,
        preference_loop_closure=1.0,
        reference_node=0,
    )
    criteria = registration.GlobalOptimizationConvergenceCriteria()
    criteria.max_iteration = ITERATIONS
    method = registration.GlobalOptimizationLevenbergMarquardt()
    registration.global_optimization(graph, method, criteria, option)
    left = {(e.target_node_id, e.source_node_id) for e in graph.edges if e.uncertain}
    kept = [(edge.first, edge.second) in left for edge in edges if edge.loop is not None]
    return np.stack([np.asarray(node.pose) for node in graph.nodes]), kept


def _open3d_edge(registration: Any, edge: _Edge) -> Any:
    """Open3D's error is a twist on the right of what maps the source to the target."""
    information = np.linalg.inv(edge.covariance)[np.ix_(ROTATION_FIRST, ROTATION_FIRST)]
    return registration.PoseGraphEdge(
        edge.second,
        edge.first,
        edge.T_first_second,
        information,
        uncertain=edge.loop is not None,
    )


def _reach(edges: Sequence[_Edge]) -> float:
    """Open3D's distance at which a loop has half its say: it counts in mean information."""
    mean = float(np.mean([np.linalg.inv(edge.covariance)[2, 2] for edge in edges]))
    return DOUBTED_SIGMAS / float(np.sqrt(mean))
