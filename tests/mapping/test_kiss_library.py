"""KISS-ICP's parts, given poses that are rigid only nearly."""

import subprocess
import sys

import numpy as np
import pytest

from pseudolidar.geometry.twists import exp_twist, rigid
from pseudolidar.mapping.kiss_library import load_kiss, point_to_point
from pseudolidar.structures.pose import rotation_error

BENT = exp_twist(np.array([0.1, 0.2, 0.3, 0.1, -0.2, 0.3])) + 1e-8 * np.eye(4, k=1)


def test_the_library_itself_kills_the_process():
    # Should it no longer, the poses need not be made rigid on their way in.
    program = (
        "import numpy as np; from kiss_icp.config import KISSConfig; "
        "from kiss_icp.threshold import get_threshold_estimator as made; config = KISSConfig(); "
        "config.adaptive_threshold.fixed_threshold = None; "
        "made(config).update_model_deviation(np.eye(4) + 1e-8 * np.eye(4, k=1))"
    )
    died = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    assert died.returncode < 0


def test_poses_bent_by_rounding_are_taken():
    kiss = load_kiss(voxel_m=0.4, farthest_m=40.0, threshold_m=0.15)
    points = np.random.default_rng(0).random((500, 3))
    voxels, threshold = kiss.voxel_map(), kiss.threshold()
    voxels.update(points, BENT)
    threshold.update_model_deviation(BENT)
    found = point_to_point().align(points, voxels, BENT, 0.05)
    assert rotation_error(found[:3, :3]) < 1e-12
    assert np.abs(found - BENT).max() < 0.05


@pytest.mark.parametrize("bent", [0.0, 1e-12, 1e-8, 1e-4])
def test_the_nearest_motion_is_rigid_and_near(bent: float):
    T = exp_twist(np.array([1.0, 2.0, 3.0, 0.4, 0.5, -0.6]))
    T[:3, :3] += bent * np.random.default_rng(1).normal(size=(3, 3))
    assert rotation_error(rigid(T)[:3, :3]) < 1e-14
    assert np.abs(rigid(T) - T).max() <= 3 * bent + 1e-15
    assert np.linalg.det(rigid(T)[:3, :3]) == pytest.approx(1)
