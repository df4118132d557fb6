"""What is drawn: clouds, and the rig in the map, as nodes of viser, changed in place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.geometry.quaternion import quaternion_wxyz
from pseudolidar.structures.arrays import AnyArray, Float32, Float64, UInt8
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.colouring import Colouring, Scale
from pseudolidar.viewer.kept_shader import keep_shader
from pseudolidar.viewer.moment import Moment, Sight
from pseudolidar.viewer.objects.lines import coloured
from pseudolidar.viewer.octree.tree import Octree
from pseudolidar.viewer.placement import Placement, moved
from pseudolidar.viewer.stills import Still, StillCloud, StillMesh, StillOctree, StillPath, middle_m
from pseudolidar.viewer.thinned import thinned

if TYPE_CHECKING:
    from viser import ViserServer

# Nodes: what lies still, what moves with the rig.
MAP, RIG = "/map", "/map/rig"
# Points of one cloud of a frame.
MOST_POINTS = 150_000
# A cloud that is not moved aside.
NOWHERE = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Look:
    """How clouds look.

    Args:
        colouring: what their colours mean.
        point_m: side of a point.
        most_points: of each cloud.
        visible: whether it is drawn.
        edges: of a mesh draw the edges alone.
    """

    colouring: Colouring = Colouring()
    point_m: float = 0.04
    most_points: int = MOST_POINTS
    visible: bool = True
    edges: bool = False


# A map is drawn with more points than a frame, which are thinned to what browsers take.
STILL_LOOK = Look(most_points=2_000_000)


class Stage:
    """The scene of a server.

    Args:
        server: draws.
    """

    def __init__(self, server: ViserServer) -> None:
        self._server, self._scene = server, server.scene
        self._scene.set_up_direction("+z")
        keep_shader(self._scene)
        self._map = self._scene.add_frame(MAP, show_axes=False)
        self._rig = self._scene.add_frame(RIG, axes_length=1.0, axes_radius=0.02)
        self._clouds: dict[str, Any] = {}
        self._stills: dict[str, PointCloud] = {}
        self._coarse: set[str] = set()
        self._drawn_as: dict[str, Look] = {}
        self._sight: Sight | None = None
        self.placement = Placement()
        self.looks: dict[str, Look] = {}
        self.every_still: list[Still] = []
        self.paths: dict[str, Any] = {}  # lines of those that lie still, by name
        # (3,) in the frame of the clouds, of a thing that stays where it is; None for nothing.
        self.followed: Callable[[Moment], Float64 | None] = lambda _moment: None
        self.shown: dict[str, PointCloud] = {}
        self._hidden: frozenset[str] = frozenset()
        self._shifts: Mapping[str, tuple[float, float, float]] = {}

    def put(self, still: Still) -> None:
        """Draw what does not change; it stays. Of a large cloud what all browsers draw."""
        self.every_still.append(still)
        if isinstance(still, StillOctree):
            self._coarse.add(still.name)
            still = still.coarse()
        if not self.placement.settled:
            self.placement.settle(middle_m(still))
        if isinstance(still, StillCloud):
            # Who goes through the clouds in another thread goes on with those it began with.
            self._stills = {**self._stills, still.name: still.cloud}
            self._put_cloud(still.name)
        if not isinstance(still, StillPath):
            return
        places = (still.places_m - self.placement.origin_m).astype(np.float32)
        if len(places) > 1:
            segments = np.stack([places[:-1], places[1:]], axis=1)
            colours = coloured([still.colour], len(segments))
            self.paths[still.name] = self._scene.add_line_segments(
                f"{MAP}/{still.name}", segments, colours, thickness=3.0, thickness_units="screen"
            )

    @property
    def stills(self) -> Mapping[str, PointCloud]:
        """Clouds that do not change, by name; of large ones the coarsest points."""
        return self._stills

    @property
    def whole_stills(self) -> Mapping[str, PointCloud]:
        """The same without large ones: what figures and files are made of."""
        return {name: c for name, c in self._stills.items() if name not in self._coarse}

    @property
    def trees(self) -> dict[str, Octree]:
        """Large clouds by name."""
        return {s.name: s.tree for s in self.every_still if isinstance(s, StillOctree)}

    @property
    def still_places(self) -> AnyArray:
        """(N, 3) points and vertices of what lies still, of large clouds the coarsest.

        Where there is nothing but paths, their places.
        """
        clouds = [cloud.xyz for cloud in self._stills.values()]
        clouds += [one.mesh.vertices for one in self.every_still if isinstance(one, StillMesh)]
        if not clouds:
            clouds = [one.places_m for one in self.every_still if isinstance(one, StillPath)]
        return np.concatenate(clouds) if clouds else np.zeros((0, 3))

    @property
    def extent_m(self) -> tuple[Float64, float] | None:
        """(3,) middle of what lies still, in the scene, and how large it is; None without."""
        places = self.still_places
        if not len(places):
            return None
        low, high = np.quantile(places, (0.02, 0.98), axis=0)
        middle = 0.5 * (low + high) - self.placement.origin_m
        return np.asarray(middle), float(np.linalg.norm(high - low))

    def _put_cloud(self, name: str) -> None:
        cloud, look = self._stills[name], self.looks.get(name, STILL_LOOK)
        look = replace(look, colouring=look.colouring.settled(cloud))
        self.looks[name] = self._drawn_as[name] = look
        drawn = thinned(cloud, look.most_points)
        points = (drawn.xyz - self.placement.origin_m).astype(np.float32)
        self._update(name, f"{MAP}/{name}", points, look.colouring.colours(drawn), look)

    def look(self, name: str) -> Look:
        """How a cloud looks, by its name."""
        return self.looks.get(name, Look())

    def show(self, moment: Moment) -> None:
        """Draw a frame in the place of the one before."""
        self._sight = moment.sight
        with self._server.atomic():
            self._place(moment)
            self.shown = {name: self._draw_cloud(name, one) for name, one in moment.clouds.items()}
            for name in self._clouds.keys() - moment.clouds.keys() - self._stills.keys():
                self._clouds[name].visible = False
            for name in self._stills:
                if self.looks.get(name) is not self._drawn_as.get(name):
                    self._put_cloud(name)

    def of_camera(self, xyz_m: Float64) -> Float64 | None:
        """(3,) where a point of the left camera's frame is in the scene; None without a camera."""
        sight = self._sight
        return None if sight is None else self.placement.of_rig(sight.forward(xyz_m))

    def pickable(self) -> Mapping[str, tuple[PointCloud, Float64]]:
        """Clouds that are drawn, by name, each with the (4, 4) pose of its frame in the scene."""
        found = self.drawn_of(self.shown, self.placement.T_scene_rig)
        return found | self.drawn_of(self._stills, self.placement.T_scene_map)

    def drawn_of(
        self, clouds: Mapping[str, PointCloud], T: Float64
    ) -> dict[str, tuple[PointCloud, Float64]]:
        """Those of some clouds that are drawn, each with the pose of its frame, aside as it is.

        Args:
            clouds: by name.
            T: (4, 4) the pose of their frame, in anything.
        """
        return {
            name: (cloud, _aside(T, self._shifts.get(name, NOWHERE)))
            for name, cloud in clouds.items()
            if self._is_visible(name)
        }

    def arrange(
        self, hidden: frozenset[str], shifts: Mapping[str, tuple[float, float, float]]
    ) -> None:
        """Leave out some clouds, and move others aside, whatever their looks.

        Args:
            hidden: names of clouds.
            shifts: by name, m in the frame that a cloud is in.
        """
        self._hidden, self._shifts = hidden, shifts
        for name in (*self.shown, *self._stills):
            if (handle := self._clouds.get(name)) is not None:
                self._arrange(name, handle)

    def _arrange(self, name: str, handle: Any) -> None:
        handle.visible = self._is_visible(name)
        handle.position = self._shifts.get(name, NOWHERE)

    def _is_visible(self, name: str) -> bool:
        return self.look(name).visible and name not in self._hidden

    def show_axes(self, *, shown: bool) -> None:
        """Draw the axes of the rig, or not."""
        self._rig.show_axes = shown

    def scale(self, name: str) -> Scale | None:
        """The bar of a cloud's colours; None where they are no numbers."""
        return self.look(name).colouring.scale()

    def _place(self, moment: Moment) -> None:
        self.placement.move(moment.T_map_forward, self.followed(moment))
        for node, T in (
            (self._rig, self.placement.T_local_rig),
            (self._map, self.placement.T_scene_local),
        ):
            node.wxyz, node.position = quaternion_wxyz(T[:3, :3]), T[:3, 3]

    def _draw_cloud(self, name: str, cloud: PointCloud) -> PointCloud:
        """What of its points is drawn."""
        look = self.look(name)
        settled = replace(look, colouring=look.colouring.settled(cloud))
        self.looks[name] = settled
        drawn = thinned(cloud, look.most_points, settled.colouring.telling(cloud))
        points, colours = drawn.xyz.astype(np.float32), settled.colouring.colours(drawn)
        self._update(name, f"{RIG}/{name}", points, colours, settled)
        return drawn

    def _update(self, name: str, node: str, points: Float32, colours: UInt8, look: Look) -> None:
        handle = self._clouds.get(name)
        if handle is None:
            self._clouds[name] = self._scene.add_point_cloud(
                node,
                points,
                colours,
                point_size=look.point_m,
                point_shape="rounded",
                point_shading="flat",
                precision="float32",
                visible=self._is_visible(name),
                position=self._shifts.get(name, NOWHERE),
            )
            return
        handle.points, handle.colors, handle.point_size = points, colours, look.point_m
        self._arrange(name, handle)


def _aside(T: Float64, shift_m: tuple[float, float, float]) -> Float64:
    """(4, 4) the pose of a frame whose points are moved by so much in it."""
    aside = T.copy()
    aside[:3, 3] = moved(T, np.array(shift_m))
    return aside
