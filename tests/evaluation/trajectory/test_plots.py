"""From above is from above, also where a road climbs more than it turns."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.evaluation.trajectory.judge import judge_trajectory
from pseudolidar.evaluation.trajectory.pairing import PairedPoses
from pseudolidar.evaluation.trajectory.plots import MOST_DRAWN, above_plot, plane_of, thinned
from tests.evaluation.trajectory.paths import drifting, winding


@pytest.mark.parametrize(
    ("spread", "vertical", "plane"),
    [
        ((50, 40, 3), None, (0, 1, 2)),
        ((50, 3, 40), None, (0, 2, 1)),
        ((1, 3, 60), 1, (0, 2, 1)),
        ((60, 1, 3), 2, (0, 1, 2)),
        ((60, 0, 0), None, (0, 1, 2)),
    ],
)
def test_the_plane(spread, vertical, plane):
    path = np.tile(np.eye(4), (2, 1, 1))
    path[1, :3, 3] = spread
    assert plane_of(path, vertical) == plane


def test_both_paths_are_drawn_in_one_world():
    truth = winding(40)
    errors = judge_trajectory(PairedPoses.of_frames(drifting(truth), truth))
    axes = above_plot(errors, 2).axes[0]
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), truth[:, :2, 3])
    pieces = np.array(axes.collections[0].get_segments())
    np.testing.assert_allclose(pieces[:, 1], errors.aligned[1:, :2, 3])
    off_m = np.linalg.norm(pieces[:, 1] - truth[1:, :2, 3], axis=1)
    assert (off_m <= errors.ape_m[1:] + 1e-12).all()


def test_long_paths_are_thinned_from_end_to_end():
    kept = thinned(3 * MOST_DRAWN)
    assert (len(kept), kept[0], kept[-1]) == (MOST_DRAWN, 0, 3 * MOST_DRAWN - 1)
