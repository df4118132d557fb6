"""The viewer's figures of a frame of KITTI: those that `compare` tells of it."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pseudolidar.pipelines.view import View

from pseudolidar.cli import main
from pseudolidar.formats.points.npz import read_npz
from pseudolidar.sources.recognise import recognise
from pseudolidar.viewer.comparing.pool import Pool
from pseudolidar.viewer.judged import judged
from pseudolidar.viewer.moment import STEREO, VELODYNE

TOLD = {"median": "median_rel", "p90": "p90_rel", "bias": "bias_rel", "covered": "density"}


@pytest.mark.real
def test_the_panel_tells_what_compare_tells(real_data, tmp_path, capsys):
    drive = real_data / "kitti_raw"
    command = ["compare", drive, tmp_path / "out", "--frames", "3", "--to", "npz", "--json"]
    assert main([str(each) for each in command]) == 0
    figures = json.loads(capsys.readouterr().out)
    moment = View().reel_of(recognise(str(drive))).load(3)
    pool = Pool(STEREO, VELODYNE)
    pool.add(moment, {})
    (shown,) = pool.told()
    for row, told in zip((shown.overall, *shown.rows), (figures, *figures["bins"]), strict=True):
        assert row.n == told["n"]
        for name, field in TOLD.items():
            assert getattr(row, name) == pytest.approx(told[field], rel=1e-9), name
    # the same errors at the same points, and more between the beams
    (file,) = (tmp_path / "out" / "npz").iterdir()
    written = read_npz(file).extra["error_m"]
    drawn = judged(moment).clouds[STEREO].extra["error_m"]
    known = np.isfinite(written)
    assert known.sum() > 10_000
    assert np.array_equal(drawn[known], written[known])
    assert np.isfinite(drawn).sum() > 8 * known.sum()
