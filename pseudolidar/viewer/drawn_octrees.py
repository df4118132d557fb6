"""Large clouds, drawn for each browser as finely as its own view needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.geometry.twists import inverted
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.browsers import Browsers
from pseudolidar.viewer.colouring import Colouring
from pseudolidar.viewer.octree.chosen import (
    Eye,
    along,
    chosen,
    needs_px,
    point_sizes_m,
    within,
)
from pseudolidar.viewer.octree.tree import Octree
from pseudolidar.viewer.placement import inverse_ray
from pseudolidar.viewer.stage import MAP, STILL_LOOK, Stage
from pseudolidar.viewer.stills import SHARED_POINTS

if TYPE_CHECKING:
    from viser import ClientHandle, PointCloudHandle, ViserServer

# Points of all large clouds that a browser draws, if nobody says otherwise.
BUDGET_POINTS = 2_000_000
# What a browser is sent before it is looked again where its camera is.
PASS_POINTS, PAUSE_S = 300_000, 0.05
# Points out of sight that a browser keeps, as a share of the budget; messages that may wait for it.
KEPT_SHARE, MOST_WAITING = 0.25, 48
# Points up to this far from the middles of their nodes lose less than half a millimetre as float16.
HALF_PRECISION_M = 2.0

# Points that are looked through for what lies in a box.
MOST_WITHIN = 2_000_000

Node = tuple[str, int]


@dataclass
class Looker:
    """What a browser has.

    Args:
        client: to draw for.
        has: nodes of viser by octree and number, the longest unused first.
        coloured: how the nodes of each octree were coloured.
    """

    client: ClientHandle
    has: dict[Node, PointCloudHandle] = field(default_factory=dict)
    coloured: dict[str, Colouring] = field(default_factory=dict)


class DrawnOctrees:
    """Draws, in a thread of its own, what browsers look at.

    Args:
        server: of the browsers.
        stage: draws the coarsest points, and says how they look.
        trees: by name.
    """

    def __init__(self, server: ViserServer, stage: Stage, trees: Mapping[str, Octree]) -> None:
        self._server, self._stage, self._trees = server, stage, trees
        self._shared = {name: tree.coarsest(SHARED_POINTS) for name, tree in trees.items()}
        self.budget = BUDGET_POINTS
        self._browsers: Browsers[Looker] | None = None
        if trees:
            self._browsers = Browsers(server, Looker, self._draw, name="octrees", pause_s=PAUSE_S)

    @property
    def lookers(self) -> Mapping[int, Looker]:
        """What each browser has, by its number."""
        return {} if self._browsers is None else self._browsers.lookers

    @property
    def points(self) -> int:
        """Of all large clouds."""
        return sum(map(len, self._trees.values()))

    @property
    def visible(self) -> tuple[str, ...]:
        """Names of those that are drawn."""
        return tuple(name for name in self._trees if self._stage.look(name).visible)

    def wake(self) -> None:
        """Look again what is to be drawn: something has changed."""
        if self._browsers is not None:
            self._browsers.wake()

    def close(self) -> None:
        """Draw nothing more."""
        if self._browsers is not None:
            self._browsers.close()

    def pickable(
        self, origin: Float64, direction: Float64
    ) -> Mapping[str, tuple[PointCloud, Float64]]:
        """What may lie on a line of sight of the scene, by name, as `Stage.pickable` has it.

        Args:
            origin: (3,) of the line.
            direction: (3,) of the line.
        """
        T_scene_map = self._stage.placement.T_scene_map
        from_m, towards = inverse_ray(T_scene_map, origin, direction)
        return {
            name: (tree.cloud(along(tree, from_m, towards).tolist()), T_scene_map)
            for name, tree in self._trees.items()
            if self._stage.look(name).visible
        }

    def within(
        self, sides_of: Callable[[Float64], tuple[Float64, Float64]]
    ) -> Mapping[str, tuple[PointCloud, Float64, int]]:
        """What may lie between planes, by name: points, pose (4, 4) in the map, points left out.

        Args:
            sides_of: pose of a cloud relative to the origin of the scene to planes in its frame,
                as `Eye.sides` has them.
        """
        T_local_map = self._stage.placement.T_local_map
        found = {}
        for name in self.visible:
            tree = self._trees[name]
            numbers = np.flatnonzero(within(tree, sides_of(T_local_map)))
            counts = np.cumsum(tree.nodes["count"][numbers])
            some = numbers[counts <= MOST_WITHIN]  # the coarsest come first
            left_out = int(counts[-1:].sum() - counts[: len(some)][-1:].sum())
            found[name] = tree.cloud(some.tolist()), T_local_map, left_out
        return found

    def drawn_points(self, client_id: int) -> int:
        """How many points a browser draws besides those that all of them draw."""
        looker = self.lookers.get(client_id)
        shown = [] if looker is None else [n for n, h in list(looker.has.items()) if h.visible]
        return sum(self._count(node) for node in shown)

    def seen(self, client: ClientHandle) -> Mapping[str, PointCloud]:
        """The points that a browser has on its page, by name; none before it says how it looks."""
        looker, eye = self.lookers.get(client.client_id), self._eye(client)
        if looker is None or eye is None:
            return {}
        drawn = [node for node, handle in list(looker.has.items()) if handle.visible]
        found = {}
        for name in self.visible:
            fine = [number for of, number in drawn if of == name]
            tree, sides = self._trees[name], eye.sides()
            numbers = np.union1d(self._shared[name], np.array(fine, np.int64))
            cloud = tree.cloud(numbers[within(tree, sides)[numbers]].tolist())
            normals, offsets = sides
            inside = (cloud.xyz @ normals.T + offsets >= 0).all(axis=1)
            found[name] = cloud[np.asarray(inside)]
        return found

    def has_room(self, client: ClientHandle) -> bool:
        """Whether a browser has taken most of what it was sent."""
        return _waiting(client) <= MOST_WAITING

    def _draw(self, looker: Looker) -> bool:
        """Send what is missing most; whether something is missing still."""
        if not self.has_room(looker.client):
            return True
        wanted, sizes_m = self._wanted(looker.client)
        self._recolour(looker)
        sent, missing = 0, False
        for node in wanted:
            if node not in looker.has:
                missing = sent >= PASS_POINTS
                if missing:
                    break
                looker.has[node] = self._add(looker.client, node, sizes_m[node])
                sent += self._count(node)
        for node, handle in looker.has.items():
            handle.visible = node in sizes_m
            if node in sizes_m:
                handle.point_size = sizes_m[node]
        self._forget(looker, wanted)
        return missing

    def _wanted(self, client: ClientHandle) -> tuple[list[Node], dict[Node, float]]:
        """Nodes that a view needs, the most needed first, and the sides of their points, m."""
        names = self.visible
        eye = self._eye(client)
        if eye is None or not names:
            return [], {}
        trees = [self._trees[name] for name in names]
        needs = [needs_px(tree, eye) for tree in trees]
        budget = self.budget
        for name, need in zip(names, needs, strict=True):
            need[self._shared[name]] = 0
            budget -= int(self._trees[name].nodes["count"][self._shared[name]].sum())
        counts = np.concatenate([tree.nodes["count"] for tree in trees])
        found = chosen(np.concatenate(needs), counts, max(budget, 0))
        starts = np.cumsum([0] + [len(tree.nodes) for tree in trees])
        which = np.searchsorted(starts, found, side="right") - 1
        sizes: dict[Node, float] = {}
        for place, (name, tree) in enumerate(zip(names, trees, strict=True)):
            numbers = found[which == place] - starts[place]
            share = self._stage.look(name).point_m / STILL_LOOK.point_m
            sides_m = share * point_sizes_m(tree, numbers)
            for number, side_m in zip(numbers.tolist(), sides_m.tolist(), strict=True):
                sizes[name, number] = side_m
        order = [(names[k], int(n - starts[k])) for k, n in zip(which, found, strict=True)]
        return order, sizes

    def _eye(self, client: ClientHandle) -> Eye | None:
        camera = client.camera
        return Eye.of(
            wxyz=np.array(camera.wxyz),
            position_m=np.array(camera.position),
            fov=camera.fov,
            width_px=camera.image_width,
            height_px=camera.image_height,
            T_map_scene=inverted(self._stage.placement.T_scene_map),
        )

    def _add(self, client: ClientHandle, node: Node, side_m: float) -> PointCloudHandle:
        name, number = node
        tree = self._trees[name]
        spread_m = tree.spread_m(number)
        small = np.abs(spread_m).max() <= HALF_PRECISION_M  # stray points are not in their cubes
        place: Float64 = tree.middles_m[number] - self._stage.placement.origin_m
        return client.scene.add_point_cloud(
            f"{MAP}/{name}/{number}",
            spread_m,
            self._stage.look(name).colouring.colours(tree.cloud([number])),
            point_size=side_m,
            point_shape="rounded",
            point_shading="flat",
            precision="float16" if small else "float32",
            position=place,
        )

    def _recolour(self, looker: Looker) -> None:
        for name, tree in self._trees.items():
            colouring = self._stage.look(name).colouring
            if looker.coloured.get(name, colouring) != colouring:
                for (of, number), handle in looker.has.items():
                    if of == name:
                        handle.colors = colouring.colours(tree.cloud([number]))
            looker.coloured[name] = colouring

    def _forget(self, looker: Looker, wanted: list[Node]) -> None:
        """Take from a browser what it has not drawn for the longest time."""
        for node in wanted:
            if node in looker.has:
                looker.has[node] = looker.has.pop(node)  # used last
        held = sum(map(self._count, looker.has))
        most = self.budget * (1 + KEPT_SHARE)
        for node in [node for node, handle in looker.has.items() if not handle.visible]:
            if held <= most:
                return
            looker.has.pop(node).remove()
            held -= self._count(node)

    def _count(self, node: Node) -> int:
        name, number = node
        return int(self._trees[name].nodes["count"][number])


def _waiting(client: Any) -> int:
    """Messages that a browser has not taken yet; viser has no public name for them."""
    return len(client._websock_connection.get_message_buffer().message_from_id)
