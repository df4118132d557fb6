import numpy as np
import pytest

from pseudolidar.errors import MemoryLimit
from pseudolidar.geometry.depth import depth_map
from pseudolidar.geometry.mesh_holes import openings
from pseudolidar.mapping.mesh import TsdfMesh
from pseudolidar.mapping.mesh_cleaning import cleaned, decimated, ordered
from pseudolidar.running.installation.part_trials import trial_frame
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.mesh import Mesh
from pseudolidar.structures.pose import Pose
from tests.mapping.mesh_truth import left_pose, surface_errors

WALL_M = 4.0
HERE = Pose.identity("map", "camera_left")


def wall(depth_m: float, sigma_m: float, grey: int = 100):
    """A view of a wall across the axis, with its sigma and colour."""
    shape = trial_frame().left.shape[:2]
    depth = np.full(shape, depth_m, np.float32)
    return depth, np.full(shape, sigma_m, np.float32), np.full((*shape, 3), grey, np.uint8)


def fused(*views, **settings) -> Mesh:
    grid = TsdfMesh(**{"voxel_m": 0.1, "least_looks": 0.1, **settings}).start(trial_frame().rig)
    for view in views:
        grid.integrate(*view, HERE)
    return grid.extract()


@pytest.fixture(scope="module")
def room():
    source = Synthetic("room", frames=2, width_px=256).open()
    frames = [source.load(i) for i in range(2)]
    return source, frames


def test_a_mesh_of_a_room_lies_on_its_surfaces_and_covers_them(room):
    source, frames = room
    grid = TsdfMesh(voxel_m=0.05).start(frames[0].rig)
    for frame in frames:
        depth_m = depth_map(frame.truth, frame.rig).values
        sigma_m = np.full_like(depth_m, 0.02)
        grid.integrate(depth_m, sigma_m, frame.left, left_pose(frame))
    errors = surface_errors(grid.extract(), source, frames, max_depth_m=10.0)
    assert errors.median_m < 0.005
    assert errors.accurate[0.05] > 0.95
    assert errors.accurate[0.1] > 0.98
    assert errors.complete[0.05] > 0.95
    assert errors.complete[0.1] > 0.97


def test_a_wall_is_flat_has_its_colour_and_faces_the_camera():
    mesh = fused(wall(WALL_M, 0.1), wall(WALL_M, 0.1))
    # Pixels at the border have no plane of their own: half a pixel there.
    inside = np.abs(mesh.vertices[:, 1]) < 1.5
    assert np.allclose(mesh.vertices[inside, 2], WALL_M, atol=1e-4)
    assert np.allclose(mesh.vertices[:, 2], WALL_M, atol=0.03)
    assert np.allclose(mesh.normals[inside, 2], -1, atol=1e-3)
    assert (mesh.rgb == 100).all()


def test_the_surer_view_decides_by_its_sigma():
    """Inverse variance weights: 4.0 with 0.05 and 4.1 with 0.1 (a voxel's quarter added)."""
    mesh = fused(wall(4.0, 0.05), wall(4.1, 0.1))
    weights = 1 / (np.array([0.05, 0.1]) ** 2 + 0.025**2)
    want_m = float((weights * [4.0, 4.1]).sum() / weights.sum())
    assert np.median(mesh.vertices[:, 2]) == pytest.approx(want_m, abs=0.005)


def test_a_pixel_without_depth_or_less_sure_than_asked_leaves_nothing():
    nothing = wall(float("nan"), 0.1)
    assert not len(fused(nothing))
    assert not len(fused(wall(WALL_M, 0.6), max_sigma_m=0.5))


def test_what_later_views_look_through_vanishes():
    ghost = wall(2.0, 0.1)
    mesh = fused(ghost, *[wall(WALL_M, 0.05)] * 12)
    assert mesh.vertices[:, 2].min() > 3.5


def test_voxels_double_when_memory_is_short_and_the_surface_stays():
    grid = TsdfMesh(voxel_m=0.1, memory_mb=5, least_looks=0.1).start(trial_frame().rig)
    grid.integrate(*wall(WALL_M, 0.1), HERE)
    assert grid.voxel_m == 0.1
    elsewhere = Pose.from_rotation("map", "camera_left", np.eye(3), np.array([30.0, 0, 5.0]))
    grid.integrate(*wall(WALL_M, 0.1), elsewhere)
    assert grid.voxel_m > 0.1
    depths = grid.extract().vertices[:, 2]
    near = depths < 6
    assert near.any()
    assert np.allclose(depths[near], WALL_M, atol=1e-3)
    assert np.allclose(depths[~near], 9.0, atol=1e-3)


def test_a_map_that_fits_with_no_voxel_size_is_refused():
    grid = TsdfMesh(voxel_m=0.1, memory_mb=1, coarsest_m=0.2).start(trial_frame().rig)
    with pytest.raises(MemoryLimit, match="memory-mb"):
        grid.integrate(*wall(30.0, 0.1), HERE)


def sheet(side: int, without: tuple[int, ...] = ()) -> Mesh:
    """A flat square of `side` x `side` cells of 1 m, some missing."""
    y, x = np.mgrid[0 : side + 1, 0 : side + 1].astype(np.float32)
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    cells = np.array([c for c in range(side * side) if c not in without])
    corner = cells // side * (side + 1) + cells % side
    lower = np.stack([corner, corner + 1, corner + side + 2], axis=1)
    upper = np.stack([corner, corner + side + 2, corner + side + 1], axis=1)
    return Mesh(vertices, np.concatenate([lower, upper]).astype(np.int32), "map")


def test_holes_are_counted_and_measured():
    found = openings(sheet(5, without=(12,)))
    assert (found.borders, found.holes, found.edges) == (2, 1, 24)
    assert found.edges_m == pytest.approx(24.0)
    assert found.holes_m2 == pytest.approx(1.0)
    assert openings(sheet(5)).holes == 0


def test_crumbs_are_dropped_and_large_parts_kept():
    ring_and_middle = sheet(5, without=(6, 7, 8, 11, 13, 16, 17, 18))
    apart = cleaned(ring_and_middle, smallest_part_m2=0.5)
    assert apart.areas_m2.sum() == pytest.approx(17.0)
    assert cleaned(ring_and_middle, smallest_part_m2=2.0).areas_m2.sum() == pytest.approx(16.0)


def test_decimation_keeps_a_flat_sheet_whole():
    few = decimated(sheet(20), 100)
    assert len(few) <= 100
    assert few.areas_m2.sum() == pytest.approx(400.0, rel=1e-3)


def test_the_order_of_a_mesh_is_that_of_its_places():
    mesh = fused(wall(WALL_M, 0.1), wall(WALL_M, 0.1))
    rng = np.random.default_rng(2)
    to = rng.permutation(len(mesh.vertices))
    back = np.argsort(to)
    rolled = np.roll(back[mesh.triangles][rng.permutation(len(mesh))], 1, axis=1).astype(np.int32)
    shuffled = Mesh(mesh.vertices[to], rolled, mesh.frame, mesh.rgb[to], mesh.normals[to])
    one, other = ordered(mesh), ordered(shuffled)
    assert np.array_equal(one.vertices, other.vertices)
    assert np.array_equal(one.triangles, other.triangles)
    assert np.array_equal(np.sort(one.areas_m2), np.sort(mesh.areas_m2))
