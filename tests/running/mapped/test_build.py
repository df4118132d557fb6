"""What a map is made of, frame by frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import OutputError
from pseudolidar.running.installation.part_trials import trial_frame
from pseudolidar.running.mapped.build import MapBuilder, MapSettings
from pseudolidar.structures.box import Detection
from pseudolidar.structures.disparity import DisparityMap


def test_things_that_may_move_are_not_in_the_map(tmp_path: Path):
    frame = trial_frame()
    height, width = frame.left.shape[:2]
    wall = DisparityMap(
        np.full((height, width), 20.0, np.float32), np.full((height, width), 0.1, np.float32)
    )
    box = Detection("person", (0.0, 0.0, width / 2, height - 1.0))
    (tmp_path / ".work").mkdir()
    builder = MapBuilder(tmp_path, frame.rig, MapSettings())
    points = [builder.add(frame, wall, np.eye(4), [box]) for _ in range(4)]
    (tile,) = [cloud for _, cloud in builder.clouds()]
    # y is to the left, where the box is.
    assert len(points[-1]) > 1000
    assert tile.xyz[:, 1].max() < 0.1
    assert tile.xyz[:, 1].min() < -0.5


def test_a_full_disk_is_told_with_its_folder(tmp_path: Path):
    frame = trial_frame()
    shape = frame.left.shape[:2]
    wall = DisparityMap(np.full(shape, 20.0, np.float32))
    (tmp_path / ".work").mkdir()
    builder = MapBuilder(tmp_path, frame.rig, MapSettings())
    # A device that is always full: what is written to it fails as on a full disk.
    builder._free._file = open("/dev/full", "wb", buffering=0)  # noqa: PTH123, SIM115
    with pytest.raises(OutputError, match="No space left") as full:
        builder.add(frame, wall, np.eye(4))
    assert full.value.path == str(tmp_path / ".work")
    builder._free.close()
