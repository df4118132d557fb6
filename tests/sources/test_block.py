"""The block of houses: a closed street whose second round looks like the first."""

import numpy as np

from pseudolidar.sources.worlds.block import ROUND_M, Block, BlockRoad


def test_the_road_is_closed_and_even():
    s = np.linspace(0.0, ROUND_M, 1025)
    centre = BlockRoad().at(s, np.zeros_like(s))
    steps = np.linalg.norm(np.diff(centre, axis=0), axis=1)
    assert np.allclose(centre[0], centre[-1], atol=1e-9)
    assert np.allclose(steps, ROUND_M / 1024, rtol=1e-4)


def test_places_beside_it_lie_to_the_left():
    road = BlockRoad()
    for s in (3.0, 40.0, 100.0, 250.0):
        (middle, heading), (left, _) = road.place(s, 0.0), road.place(s, 2.0)
        assert np.allclose(left - middle, 2.0 * np.array([-np.sin(heading), np.cos(heading), 0.0]))


def test_the_second_round_comes_back():
    block = Block()
    first, second = (block.T_world_base(t) for t in (1.0, 1.0 + ROUND_M / block.speed_m_s))
    assert 0.05 < np.linalg.norm((first - second)[:3, 3]) < 1.0
    assert block.surroundings(block.region(1.0)) is not None
