"""How often a browser is heard."""

import pytest

from pseudolidar.viewer.pace import Pace


def test_a_burst_passes_and_the_rest_waits_its_time():
    pace = Pace(10.0, 3)
    assert [pace.wait_s(5.0) for _ in range(5)] == pytest.approx([0, 0, 0, 0.1, 0.2])
    assert pace.wait_s(6.0) == 0  # a second later all of it is forgotten


def test_what_may_not_pass_costs_nothing():
    pace = Pace(10.0, 3)
    assert [pace.allows(5.0) for _ in range(5)] == [True, True, True, False, False]
    assert pace.allows(5.11)
    assert not pace.allows(5.11)
