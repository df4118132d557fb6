"""Large clouds in comparisons: what is near is taken whole, of the rest what fits, and told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.comparing import large
from pseudolidar.viewer.comparing.companions import Companions
from pseudolidar.viewer.comparing.errors import AROUND_M
from pseudolidar.viewer.comparing.pool import Pool
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.octree.build import built
from pseudolidar.viewer.panels.compare import ComparePanel
from pseudolidar.viewer.reel import NoFrames
from pseudolidar.viewer.server import GuardedServer
from pseudolidar.viewer.stills import StillOctree
from pseudolidar.viewer.view import View

COUNT = 200_000
UTM_M = np.array([4.5e5, 5.4e6, 110.0])
PLACE_M = UTM_M + np.array([100.0, -50.0, 1.5])
OFF_M = 0.03


def ground(seed: int, off_m: float = 0.0) -> PointCloud:
    """400 m of a plane; two of them are as far apart as they are raised."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform((-200, -200, 0), (200, 200, 0), (COUNT, 3)) + UTM_M
    return PointCloud(xyz + np.array([0, 0, off_m]), "map")


@pytest.fixture(scope="module")
def map_() -> PointCloud:
    return ground(1)


@pytest.fixture(scope="module")
def tree(map_: PointCloud):
    return built(map_)


def seen(map_: PointCloud, place_m: np.ndarray) -> Moment:
    """A rig at a place, before which a part of the map lies, a little too high."""
    near = map_.xyz[np.linalg.norm(map_.xyz - place_m, axis=1) < 30] - place_m
    cloud = PointCloud(
        (near[near[:, 0] > 3] + np.array([0, 0, OFF_M])).astype(np.float32), "velodyne"
    )
    T = np.eye(4)
    T[:3, 3] = place_m
    return Moment("a", 0, clouds={"points": cloud}, T_map_forward=T)


def test_around_the_rig_every_point_of_the_map_is_taken(map_: PointCloud, tree):
    moment = seen(map_, PLACE_M)
    whole, large_ = Pool("points", "m.ply"), Pool("points", "m.ply")
    whole.add(moment, {"m.ply": map_})
    large_.add(moment, {}, {"m.ply": tree})
    (want,), (got,) = whole.told(), large_.told()
    assert large_.notes == ()
    assert want.overall.n > 1000
    assert got.overall.n == want.overall.n
    assert got.overall.median == pytest.approx(OFF_M, abs=1e-4)
    assert [row.median for row in got.rows] == pytest.approx(
        [row.median for row in want.rows], abs=1e-4, nan_ok=True
    )


def test_of_too_many_points_some_are_compared_and_that_is_told(
    map_: PointCloud, tree, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(large, "MOST_NEIGHBOURS", 20_000)
    moment = seen(map_, PLACE_M)
    pool = Pool("points", "m.ply")
    pool.add(moment, {}, {"m.ply": tree})
    (told,) = pool.told()
    assert told.overall.median is not None
    assert told.overall.median > 2 * OFF_M  # the gaps
    (note,) = pool.notes
    assert note.startswith("m.ply: ")
    assert " of " in note


def test_two_maps_are_compared_wherever_they_lie(tree):
    pool = Pool("b.ply", "a.ply")
    pool.add(Moment("", 0), {}, {"a.ply": tree, "b.ply": built(ground(1, OFF_M))})
    (told,) = pool.told()
    assert told.overall.n == pytest.approx(50_000, rel=0.01)
    assert told.overall.median == pytest.approx(OFF_M, abs=2e-3)
    assert told.rows[-1].to_m > 280
    assert sum(row.n for row in told.rows) == told.overall.n
    assert pool.notes == ("Ranges are from the middle of a.ply.",)


def test_the_panel_offers_them_and_tells(server: GuardedServer, tree):
    view = View(server, NoFrames())
    view.stage.put(StillOctree("a.ply", tree))
    view.stage.put(StillOctree("b <i>.ply", built(ground(1, OFF_M))))
    panel = ComparePanel(view, Companions())
    view.moment = view.made(0)
    view.stage.show(view.moment)
    panel._show(view.moment)
    assert panel._name.options == panel._against.options == ("a.ply", "b <i>.ply")
    panel._against.value = "b <i>.ply"
    panel._wanted.value = True
    panel._ask()
    assert panel._frame.idle(20)
    assert "from the middle of b &lt;i&gt;.ply" in panel._told.content
    assert "<i>" not in panel._told.content
    view.stop()


def test_far_from_the_map_there_is_nothing_to_compare(map_: PointCloud, tree):
    moment = replace(seen(map_, UTM_M), T_map_forward=np.eye(4))
    found, left_out = large.compared_stills(moment, {}, {"m.ply": tree}, ("m.ply",))
    assert len(found["m.ply"]) == 0
    assert not left_out
    assert AROUND_M < 400
