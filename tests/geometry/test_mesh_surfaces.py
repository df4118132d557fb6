"""Lines of sight that meet surfaces, normals, and places on them."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.geometry.mesh_rays import first_hit
from pseudolidar.geometry.mesh_surface import spread_over, vertex_normals
from pseudolidar.structures.mesh import Mesh

UTM = np.array([450_000.0, 5_400_000.0, 100.0])


def square(at_m: float = 0.0, origin: np.ndarray = UTM) -> Mesh:
    """4 m x 2 m at a height, of two triangles."""
    corners = np.array([(0, 0, at_m), (4, 0, at_m), (4, 2, at_m), (0, 2, at_m)]) + origin
    return Mesh(corners, np.int32([[0, 1, 2], [0, 2, 3]]), "map")


def test_a_line_meets_the_nearer_of_two_surfaces_from_both_sides():
    low, high = square(0.0), square(3.0)
    both = Mesh(
        np.concatenate([low.vertices, high.vertices]),
        np.concatenate([low.triangles, high.triangles + 4]),
        "map",
    )
    for side, height in ((10.0, 3.0), (-10.0, 0.0)):
        eye = np.add(UTM, (1.0, 0.5, side))
        hit = first_hit(both, eye, np.array([0.1, 0.05, -np.sign(side)]) * 7)
        assert hit is not None
        way = abs(side - height)
        assert hit == pytest.approx(
            np.add(UTM, (1.0 + 0.1 * way, 0.5 + 0.05 * way, height)), abs=1e-8
        )


def test_lines_beside_and_behind_meet_nothing():
    eye = np.add(UTM, (1, 1, 5))
    assert first_hit(square(), eye, np.array([0, 0, 1.0])) is None
    assert first_hit(square(), eye, np.array([1.0, 0, 0])) is None
    assert first_hit(square(), eye, np.array([4.0, 0, -5])) is None
    # In the bounds of the triangles' shadows, and beside them.
    alone = Mesh(square().vertices, square().triangles[:1], "map")
    assert first_hit(alone, np.add(UTM, (0.5, 1.9, 5)), np.array([0, 0, -1.0])) is None


def test_random_lines_meet_a_bowl_where_its_formula_says():
    n = 81
    x, y = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n))
    at = np.stack([x, y, x * x + y * y], axis=-1).reshape(-1, 3)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + n + 1], axis=1)
    upper = np.stack([corner, corner + n + 1, corner + n], axis=1)
    bowl = Mesh(at, np.concatenate([lower, upper]).astype(np.int32), "map")
    rng = np.random.default_rng(0)
    for x0, y0 in rng.uniform(-0.9, 0.9, (20, 2)):
        hit = first_hit(bowl, np.array([x0, y0, 9.0]), np.array([0, 0, -1.0]))
        assert hit is not None
        assert hit[:2] == pytest.approx((x0, y0))
        assert hit[2] == pytest.approx(x0**2 + y0**2, abs=(2 / (n - 1)) ** 2 / 2)


def test_normals_are_those_of_the_faces_and_none_of_a_vertex_alone():
    mesh = square()
    lonely = Mesh(np.concatenate([mesh.vertices, UTM[None]]), mesh.triangles, "map")
    assert np.allclose(vertex_normals(lonely), [(0, 0, 1)] * 4 + [(0, 0, 0)])


def test_places_cover_a_surface_evenly():
    mesh = square(origin=np.zeros(3))
    corners, weights = spread_over(mesh, 8000)
    places = np.einsum("nc,nci->ni", weights, mesh.vertices[corners])
    assert np.all((places >= 0) & (places <= (4, 2, 0)))
    heaps, _, _ = np.histogram2d(places[:, 0], places[:, 1], bins=(4, 2), range=((0, 4), (0, 2)))
    assert np.abs(heaps - 1000).max() < 120
    assert np.allclose(weights.sum(axis=1), 1)


def test_a_sliver_without_area_gets_no_places():
    mesh = square(origin=np.zeros(3))
    bad = Mesh(
        mesh.vertices,
        np.concatenate([np.int32([[1, 1, 1]]), mesh.triangles, np.int32([[2, 2, 2]])]),
        "map",
    )
    corners, _ = spread_over(bad, 500)
    assert (corners != corners[:, :1]).any(axis=1).all()
