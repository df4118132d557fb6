"""Triangles with texture coordinates and colours, and the shapes that worlds are built of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.sources.worlds.materials import Material
from pseudolidar.structures.arrays import Float32, Float64, Int64

Colour = tuple[float, float, float]
# A place (3,), metres.
Place = Sequence[float] | Float64


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles.

    Args:
        corners: (F, 3, 3) float64 m, world axes (x forward, y left, z up).
        texture: (F, 3, 3) float64 m, the corners in the object's own frame: what the noise sees.
        colour: (F, 3) float32 linear base colour, 0-1.
        kind: (F, 3) int64: `Material`, texture seed, object number (0: no object).
    """

    corners: Float64
    texture: Float64
    colour: Float32
    kind: Int64

    def __len__(self) -> int:
        return len(self.corners)

    def moved(self, T_dst_src: Float64) -> Mesh:
        """The same triangles elsewhere; the texture moves with them."""
        corners = self.corners @ T_dst_src[:3, :3].T + T_dst_src[:3, 3]
        return replace(self, corners=corners)

    def placed(self, offset_m: Place, *, yaw_rad: float = 0.0, scale: float = 1.0) -> Mesh:
        """Turned about z, scaled and shifted; texture coordinates stay as they are."""
        T = turn_z(yaw_rad, offset_m)
        T[:3, :3] *= scale
        return self.moved(T)

    def owned(self, number: int) -> Mesh:
        """The same shape as object `number`."""
        kind = self.kind.copy()
        kind[:, 2] = number
        return replace(self, kind=kind)

    def rows(self, origin_m: Float64) -> Float32:
        """(F, ROW_LENGTH) float32 rows for `surfaces.shade`, corners relative to `origin_m`."""
        corners = (self.corners - origin_m).astype(np.float32)
        texture = self.texture.astype(np.float32)
        return np.hstack(
            [
                corners[:, 0],
                corners[:, 1] - corners[:, 0],
                corners[:, 2] - corners[:, 0],
                texture[:, 0],
                texture[:, 1] - texture[:, 0],
                texture[:, 2] - texture[:, 0],
                self.colour,
            ]
        )


def turn_z(yaw_rad: float, offset_m: Place = (0.0, 0.0, 0.0)) -> Float64:
    """(4, 4) rotation about z (left turn positive), then a shift."""
    T = np.eye(4)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    T[:2, :2] = [[cos, -sin], [sin, cos]]
    T[:3, 3] = offset_m
    return T


def body_pose(place_m: Float64, *, yaw_rad: float, pitch_rad: float, roll_rad: float) -> Float64:
    """(4, 4) pose `R_z(yaw) R_y(pitch) R_x(roll)` at a place; front down is positive pitch."""
    cp, sp = np.cos(pitch_rad), np.sin(pitch_rad)
    cr, sr = np.cos(roll_rad), np.sin(roll_rad)
    T = turn_z(yaw_rad, place_m)
    R_pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    R_roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    T[:3, :3] = T[:3, :3] @ R_pitch @ R_roll
    return T


def above(place_m: Float64, height_m: float) -> Float64:
    """(3,) the spot `height_m` over a place (3,)."""
    return np.asarray(place_m + np.array([0.0, 0.0, height_m]), dtype=np.float64)


def join(meshes: Sequence[Mesh]) -> Mesh:
    """All triangles in one mesh."""
    if not meshes:
        empty = np.zeros((0, 3, 3))
        return Mesh(empty, empty, np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int64))
    return Mesh(
        np.concatenate([m.corners for m in meshes]),
        np.concatenate([m.texture for m in meshes]),
        np.concatenate([m.colour for m in meshes]),
        np.concatenate([m.kind for m in meshes]),
    )


def from_faces(
    points: Float64,
    faces: Sequence[Sequence[int]] | Int64,
    material: Material,
    colour: Colour,
    *,
    texture: Float64 | None = None,
    seed: int = 0,
) -> Mesh:
    """Mesh of indexed triangles; `texture` (N, 3) defaults to the points themselves."""
    index = np.asarray(faces, dtype=np.int64)
    n = len(index)
    kind = np.tile(np.array([int(material), seed, 0], dtype=np.int64), (n, 1))
    shade = np.tile(np.asarray(colour, dtype=np.float32), (n, 1))
    return Mesh(points[index], (points if texture is None else texture)[index], shade, kind)


_BOX_FACES = [
    (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
    (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
]  # fmt: skip


def frustum(
    low: Sequence[float],
    high: Sequence[float],
    material: Material,
    colour: Colour,
    *,
    inset: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    seed: int = 0,
) -> Mesh:
    """Box from corner `low` to corner `high`, its top drawn in.

    Args:
        low: least x, y, z, metres.
        high: largest x, y, z.
        material: surface.
        colour: linear base colour.
        inset: by how much the top is smaller at -x, +x, -y, +y, metres.
        seed: texture seed.
    """
    points = np.array(
        [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    )
    top = np.arange(8) % 2 == 1
    points[top & (points[:, 0] == low[0]), 0] += inset[0]
    points[top & (np.arange(8) >= 4), 0] -= inset[1]
    points[top & (np.arange(8) % 4 < 2), 1] += inset[2]
    points[top & (np.arange(8) % 4 >= 2), 1] -= inset[3]
    return from_faces(points, _BOX_FACES, material, colour, seed=seed)


def sheet(
    points: Float64, material: Material, colour: Colour, *, texture: Float64, seed: int = 0
) -> Mesh:
    """Surface through a grid of points (R, C, 3), with texture coordinates (R, C, 3)."""
    rows, columns = points.shape[:2]
    at = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    flat = points.reshape(-1, 3)
    return from_faces(flat, faces, material, colour, texture=texture.reshape(-1, 3), seed=seed)


def tube(
    path: Float64,
    radii_m: Sequence[float] | Float64,
    material: Material,
    colour: Colour,
    *,
    sides: int = 8,
    seed: int = 0,
) -> Mesh:
    """Tube around a path (N, 3) with a radius at each point; open ends."""
    ahead = np.gradient(path, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    helper = np.where(np.abs(ahead[:, 2:]) > 0.9, [[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    u = np.cross(helper, ahead)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(ahead, u)
    angle = np.linspace(0.0, 2 * np.pi, sides + 1)
    ring = np.cos(angle)[None, :, None] * u[:, None] + np.sin(angle)[None, :, None] * v[:, None]
    radius = np.asarray(radii_m, dtype=np.float64).reshape(-1, 1, 1)
    points = path[:, None] + radius * ring
    return sheet(points, material, colour, texture=points, seed=seed)


def disc(radius_m: float, material: Material, colour: Colour, *, sides: int = 12) -> Mesh:
    """Disc in the x-z plane around the origin; texture coordinates x, z."""
    angle = np.linspace(0.0, 2 * np.pi, sides, endpoint=False)
    rim = np.stack([radius_m * np.cos(angle), 0 * angle, radius_m * np.sin(angle)], 1)
    points = np.vstack([np.zeros((1, 3)), rim])
    faces = [(0, 1 + k, 1 + (k + 1) % sides) for k in range(sides)]
    return from_faces(points, faces, material, colour)


def sphere(levels: int) -> tuple[Float64, Int64]:
    """Unit icosphere: points (N, 3) and faces (20 * 4**levels, 3)."""
    g = (1 + 5**0.5) / 2
    points: list[tuple[float, float, float]] = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0)]
    points += [(0, -1, g), (0, 1, g)]
    points += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    faces = [
        (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4),
        (11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8),
        (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1),
    ]  # fmt: skip
    p, f = np.array(points, dtype=np.float64), np.array(faces, dtype=np.int64)
    for _ in range(levels):
        edges = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        middle = len(p) + inverse.reshape(3, -1)
        p = np.vstack([p, p[unique].mean(axis=1)])
        a, b, c = f.T
        ab, bc, ca = middle
        f = np.concatenate(
            [np.stack(t, 1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
        )
    return p / np.linalg.norm(p, axis=1, keepdims=True), f
