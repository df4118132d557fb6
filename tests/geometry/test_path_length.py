"""Ways along paths."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.path_length import length_m, travelled_m


def test_a_way_is_as_long_as_its_steps():
    corner = np.array([[5, 5, 5], [5, 8, 9], [5, 8, 9], [6, 8, 9]], float)
    assert travelled_m(corner).tolist() == [0, 5, 5, 6]
    assert length_m(corner) == 6
    assert [length_m(corner[:count]) for count in (0, 1)] == [0, 0]
