"""Visual odometry on KITTI, against its poses."""

import numpy as np
import pytest

from pseudolidar.mapping.visual_odometry import VisualOdometry
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.source import pairs_of
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.clean import Clean, Cleaner
from tests.mapping.worlds import Drive, drift

pytestmark = pytest.mark.real


def driven(path, frames):
    source = pairs_of(recognise(str(path)).open())
    match, clean = Census().load(), Cleaner.load(Clean())
    pairs = [source.load(i) for i in range(frames)]
    chain = VisualOdometry().start(pairs[0].rig)
    states = [chain.register(pair, clean(pair, match(pair)).disparity) for pair in pairs]
    assert [state.status for state in states] == ["first", *["ok"] * (frames - 1)]
    (path,) = chain.trajectories()
    truth = Drive.of(pairs).T_odom
    told = np.stack([state.T_odom_camera.matrix for state in states])
    return chain, drift(told, truth), drift(path.T_world_body, truth)


def test_a_drive_of_ten_frames(real_data):
    chain, told, settled = driven(real_data / "kitti_raw", 10)
    # 0.51 and 0.34 % measured; OXTS itself tells 8 m to about 0.2 %
    assert told.end_rel < 0.007
    assert settled.end_rel < 0.005
    # with OXTS held fixed the offset of this rig is -0.73 px
    assert abs(chain.offset.offset_px + 0.73) < 2 * chain.offset.sigma_px


@pytest.mark.slow
def test_sequence_06(real_data):
    chain, told, settled = driven(real_data / "kitti_odometry", 51)
    # 0.83 and 0.59 % measured
    for each in (told, settled):
        assert each.end_rel < 0.0095
        assert each.t_rel < 0.007
        assert each.r_deg_per_m < 0.012
    # with GPS and IMU held fixed -0.24 px
    assert abs(chain.offset.offset_px + 0.24) < 2 * chain.offset.sigma_px
