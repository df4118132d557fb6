"""Flags that nothing of what was opened takes."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from pseudolidar.pipelines.view import View

from pseudolidar.cli import main
from pseudolidar.formats.points.ply import write_ply
from pseudolidar.obstacles.corridor import Corridor
from pseudolidar.obstacles.labels import Labels
from pseudolidar.sources.cloud_files import CloudFiles
from pseudolidar.sources.selection import FrameSelection
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.sgbm import Sgbm
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.effect import (
    OF_DEPTHS,
    OF_EVERY_PAIR,
    OF_FRAMES,
    OF_OBJECTS,
    OF_PAIRS,
    without_effect,
)
from pseudolidar.viewer.opening import Opened

EVERY = View(
    matcher=Sgbm(),
    clean=None,
    rig_unit="cm",
    frames=FrameSelection.parse("0:1"),
    detector=Labels(),
    corridor=Corridor.parse("2x2x30"),
)
FLAGS = ("--matcher", "--clean", "--frames", "--rig-unit", "--detector", "--corridor")


def test_a_source_of_pairs_takes_all_and_files_none(tmp_path: Path):
    pairs = EVERY.reel_of(Synthetic("street", frames=1, width_px=128, height_px=64))
    write_ply(tmp_path / "1.ply", PointCloud(np.eye(3, dtype=np.float32), "map"))
    clouds = View().reel_of(CloudFiles(str(tmp_path)))
    assert without_effect(EVERY, Opened()) == FLAGS
    assert without_effect(EVERY, Opened((pairs,))) == ()
    assert without_effect(EVERY, Opened((pairs, clouds))) == ()
    assert without_effect(EVERY, Opened((clouds,))) == tuple(f for f in FLAGS if f != "--frames")
    # Objects are of the first one.
    assert without_effect(EVERY, Opened((clouds, pairs))) == ("--detector", "--corridor")
    # Pairs of a run have the run's settings, but may be cleaned otherwise.
    of_run = tuple(f for f in FLAGS if f not in ("--clean", "--detector", "--corridor"))
    assert without_effect(EVERY, Opened((replace(pairs, origin=None),))) == of_run
    assert without_effect(View(), Opened()) == ()


def test_every_setting_of_what_is_shown_is_looked_at():
    looked_at = {*OF_FRAMES, *OF_DEPTHS, *OF_PAIRS, *OF_EVERY_PAIR, *OF_OBJECTS}
    served = {"paths", "port", "host", "named", "share", "browser", "export"}
    assert looked_at == {field.name for field in fields(View)} - served


def test_they_are_named_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    write_ply(tmp_path / "a.ply", PointCloud(np.eye(3, dtype=np.float32), "map"))
    flags = ("--frames", "0:2", "--corridor", "2x2x30", "--export", str(tmp_path / "a.png"))
    assert main(["view", str(tmp_path / "a.ply"), *flags]) == 0
    (said,) = capsys.readouterr().err.splitlines()
    assert said.endswith("without effect on what was opened: --frames, --corridor")
