import numpy as np
import pytest

from pseudolidar.errors import MemoryLimit, UsageError
from pseudolidar.mapping.occupancy import Occupancy
from pseudolidar.mapping.occupancy_map import OccupancyMap
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.occupancy_grid import FREE, OCCUPIED, UNKNOWN

EYE_M = np.array([0.0, 0.0, 1.5])


def cloud(xyz: np.ndarray, sigma_m: float = 0.02) -> PointCloud:
    return PointCloud(xyz.astype(np.float32), "map", sigma_m=np.full(len(xyz), sigma_m, np.float32))


def wall(x_m: float, low_m: float = 0.0, high_m: float = 2.0) -> np.ndarray:
    """Points across the way, 4 m wide."""
    y, z = np.meshgrid(np.arange(-2, 2, 0.04), np.arange(low_m + 0.02, high_m, 0.04))
    return np.stack([np.full(y.size, x_m), y.ravel(), z.ravel()], axis=1)


def floor(slope: float = 0.0) -> np.ndarray:
    x, y = np.meshgrid(np.arange(1, 8, 0.03), np.arange(-2, 2, 0.03))
    return np.stack([x.ravel(), y.ravel(), slope * x.ravel()], axis=1)


def seen(*views: np.ndarray, **settings) -> OccupancyMap:
    occupancy = Occupancy(**settings).start()
    for points in views:
        occupancy.integrate(cloud(points), EYE_M)
    return occupancy


def cell(occupancy: OccupancyMap, x_m: float, y_m: float) -> int:
    grid = occupancy.flat()
    row = int((y_m - grid.origin_m[1]) // grid.resolution_m)
    column = int((x_m - grid.origin_m[0]) // grid.resolution_m)
    return int(grid.cells[row, column])


def test_a_wall_is_taken_the_way_there_free_and_behind_it_unknown():
    ground, beside = floor(), wall(9.03) + np.array([0.0, 5.0, 0.0])
    occupancy = seen(np.concatenate([ground[ground[:, 0] < 5], wall(5.03), beside]))
    hits = occupancy.occupied()
    upright = hits.xyz[(hits.xyz[:, 2] > 0.3) & (hits.xyz[:, 1] < 2.5)]
    assert np.allclose(upright[:, 0], 5.05, atol=1e-5)
    assert cell(occupancy, 5.05, 0.0) == OCCUPIED
    assert cell(occupancy, 3.05, 0.0) == FREE
    assert cell(occupancy, 7.05, 0.0) == UNKNOWN
    assert hits.extra["occupancy"].min() > 0.5


def test_what_moved_away_is_carved_and_what_stays_is_kept():
    gone, stays = np.concatenate([floor(), wall(3.03)]), np.concatenate([floor(), wall(6.03, 0, 3)])
    occupancy = seen(gone, stays, stays, stays)
    assert cell(occupancy, 3.05, 0.0) == FREE
    assert cell(occupancy, 6.05, 0.0) == OCCUPIED


def test_an_unsure_point_takes_less():
    """A normal error of 0.1 m is within half a voxel of 0.1 m with 38.3 %."""
    sure, unsure = Occupancy().start(), Occupancy().start()
    sure.integrate(cloud(wall(5.05), 0.001), EYE_M)
    for _ in range(2):
        unsure.integrate(cloud(wall(5.05), 0.1), EYE_M)
    odds = [
        np.log(p / (1 - p)) for p in (m.occupied().extra["occupancy"].max() for m in (sure, unsure))
    ]
    assert odds[0] == pytest.approx(0.85, abs=0.01)
    assert odds[1] == pytest.approx(2 * 0.85 * 0.383, abs=0.01)


def test_obstacles_are_counted_from_the_ground_beneath_them():
    """On a ramp of 20 % a kerb of 0.1 m is none, a box of 0.6 m is one, a bridge at 3 m is none."""
    ramp = floor(slope=0.2)
    kerb, box = wall(3.03, 0.6, 0.71), wall(5.03, 1.0, 1.65)
    bridge = wall(6.5, 4.3, 4.5)
    occupancy = seen(*[np.concatenate([ramp, kerb, box[np.abs(box[:, 1]) < 1], bridge])] * 2)
    assert cell(occupancy, 3.05, 0.0) == FREE
    assert cell(occupancy, 5.05, 0.0) == OCCUPIED
    assert cell(occupancy, 5.05, 1.7) == FREE
    assert cell(occupancy, 6.55, 1.7) == FREE


def test_cells_may_be_wider_than_voxels():
    """As a robot wants them: an obstacle anywhere in a cell takes it, the rest is as it was."""
    ground = floor()
    views = [np.concatenate([ground[ground[:, 0] < 5], wall(5.03)])] * 2
    fine, wide = seen(*views), seen(*views, cell_m=0.4)
    assert wide.flat().resolution_m == pytest.approx(0.4)
    assert np.allclose(np.mod(wide.flat().origin_m, 0.4), [0.0, 0.0])
    assert wide.occupied().xyz.tolist() == fine.occupied().xyz.tolist()
    assert cell(wide, 5.05, 0.0) == OCCUPIED
    assert cell(wide, 3.05, 0.0) == FREE
    # A cell is taken where a voxel's width of it is, and nowhere else.
    taken = []
    for grid in (fine.flat(), wide.flat()):
        rows, columns = np.nonzero(grid.cells == OCCUPIED)
        xy = (np.stack([columns, rows], axis=1) + 0.5) * grid.resolution_m + grid.origin_m
        taken.append({tuple(at) for at in np.floor(xy / 0.4).astype(int).tolist()})
    assert taken[0] == taken[1]


@pytest.mark.parametrize("cell_m", [0.05, 0.25, 0.0, -0.1, np.nan, np.inf])
def test_cells_that_are_no_whole_voxels_are_refused(cell_m):
    with pytest.raises(UsageError, match=r"Take 0\.1, 0\.2"):
        Occupancy(cell_m=cell_m)


def test_memory_is_refused_beyond_the_cap_and_follows_what_was_seen():
    with pytest.raises(MemoryLimit, match="far-m"):
        seen(wall(20.0), memory_mb=1)
    assert seen(wall(5.0)).blocks < 100


def test_nothing_seen_is_unknown():
    empty = Occupancy().start()
    assert (empty.flat().cells == UNKNOWN).all()
    assert not len(empty.occupied())
