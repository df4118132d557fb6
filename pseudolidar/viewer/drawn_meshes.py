"""Meshes in the scene: a surface with the colours of its vertices, or its edges alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.formats.meshes.glb import encode_glb
from pseudolidar.geometry.mesh_rays import first_hit
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.mesh import Mesh
from pseudolidar.viewer.colouring import Colouring
from pseudolidar.viewer.latest import Latest
from pseudolidar.viewer.meshes import surface_colours
from pseudolidar.viewer.placement import inverse_ray
from pseudolidar.viewer.stage import MAP, Look, Stage
from pseudolidar.viewer.stills import StillMesh
from pseudolidar.viewer.tone import light_shown_as

if TYPE_CHECKING:
    from viser import ViserServer

# GLB has y up: a quarter turn about x brings it back to z up, as quaternion wxyz.
Y_UP_TO_Z_UP = (0.5**0.5, 0.5**0.5, 0.0, 0.0)
EDGE_COLOUR = (120, 170, 220)


class DrawnMeshes:
    """Draws meshes; viser's own have one colour alone, so that ours are sent as GLB.

    Args:
        server: draws.
        stage: says where the map is, and how things look.
    """

    def __init__(self, server: ViserServer, stage: Stage) -> None:
        self._scene, self._stage = server.scene, stage
        self._meshes: dict[str, StillMesh] = {}
        self._near: dict[str, Mesh] = {}
        self._surfaces: dict[str, Any] = {}
        self._edges: dict[str, Any] = {}
        self._coloured: dict[str, Colouring] = {}
        self._work: Latest[Mapping[str, Colouring]] = Latest(self._colour_all, name="meshes")
        self._take_new()
        self._colour_all(self._settled(), lambda: False)

    @property
    def points(self) -> Mapping[str, PointCloud]:
        """Vertices by name of the mesh: they say what its colours can mean."""
        return {name: one.points for name, one in self._meshes.items()}

    def redraw(self) -> None:
        """Draw as looks say now; in other colours when they are made, a second for a million."""
        self._take_new()
        wanted = self._settled()
        if any(self._coloured.get(name) != colouring for name, colouring in wanted.items()):
            self._work.ask(wanted)
        for name in self._meshes:
            look = self._stage.look(name)
            if look.visible and look.edges and name not in self._edges:
                self._edges[name] = self._scene.add_mesh_simple(
                    f"{MAP}/{name}/edges",
                    self._near[name].vertices,
                    self._near[name].triangles,
                    color=EDGE_COLOUR,
                    wireframe=True,
                )
        self._show()

    def idle(self, timeout_s: float) -> bool:
        """Wait until all colours are drawn; tells whether they are."""
        return self._work.idle(timeout_s)

    def close(self) -> None:
        """Colour nothing more."""
        self._work.close()

    def pickable(
        self, origin: Float64, direction: Float64
    ) -> Mapping[str, tuple[PointCloud, Float64]]:
        """The place of each drawn surface on a line of sight, by name, as `Stage.pickable` has it.

        Args:
            origin: (3,) of the line, in the scene.
            direction: (3,) of the line.
        """
        T = self._stage.placement.T_scene_map
        from_m, towards = inverse_ray(T, origin, direction)
        found = {
            name: first_hit(one.mesh, from_m, towards)
            for name, one in self._meshes.items()
            if self._stage.look(name).visible
        }
        return {
            name: (PointCloud(place[None], self._meshes[name].mesh.frame), T)
            for name, place in found.items()
            if place is not None
        }

    def _take_new(self) -> None:
        """Take in the meshes that were laid on the stage since the last time."""
        for one in self._stage.every_still:
            if isinstance(one, StillMesh) and one.name not in self._meshes:
                self._near[one.name] = self._near_origin(one.mesh)
                colouring = Colouring("height") if one.mesh.rgb is None else Colouring()
                self._stage.looks.setdefault(one.name, Look(colouring))
                # A new dict: another thread may be going through the old one.
                self._meshes = {**self._meshes, one.name: one}

    def _settled(self) -> Mapping[str, Colouring]:
        """How the surfaces that are drawn are coloured, with ends that suit them."""
        found = {}
        for name, one in self._meshes.items():
            look = self._stage.look(name)
            settled = look.colouring.settled(one.points)
            if settled != look.colouring:
                self._stage.looks[name] = replace(look, colouring=settled)
            if look.visible and not look.edges:
                found[name] = settled
        return found

    def _show(self) -> None:
        for handles, of_edges in ((self._surfaces, False), (self._edges, True)):
            for name, handle in list(handles.items()):
                look = self._stage.look(name)
                handle.visible = look.visible and look.edges is of_edges

    def _colour_all(self, wanted: Mapping[str, Colouring], overtaken: Callable[[], bool]) -> None:
        for name, colouring in wanted.items():
            if self._coloured.get(name) != colouring and not overtaken():
                self._colour(name, colouring)
                self._coloured[name] = colouring
        self._show()

    def _colour(self, name: str, colouring: Colouring) -> None:
        rgb = surface_colours(self._meshes[name], colouring)
        data = encode_glb(self._near[name], light=light_shown_as(rgb))
        if name in self._surfaces:
            self._surfaces[name].glb_data = data
            return
        self._surfaces[name] = self._scene.add_glb(
            f"{MAP}/{name}/surface", data, wxyz=Y_UP_TO_Z_UP, cast_shadow=False,
            receive_shadow=False,
        )  # fmt: skip

    def _near_origin(self, mesh: Mesh) -> Mesh:
        """Places as they are on the wire: relative to the origin, which float32 can tell."""
        places = mesh.vertices - self._stage.placement.origin_m
        return replace(mesh, vertices=places.astype(np.float32), normals=None)
