"""Paths: that of a sequence, driven and to come; the true one beside that of a run."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pseudolidar.pipelines.convert import Convert
from pseudolidar.pipelines.view import View as Job
from pseudolidar.pipelines.view import reel_by, truth_of_run

from pseudolidar.formats.tum import write_tum_trajectory
from pseudolidar.running.settings_json import to_json
from pseudolidar.sources.known_poses import pose_of
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.viewer import drawn_path
from pseudolidar.viewer.drawn_path import COMING_COLOUR, DrawnPath
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.objects.lines import coloured
from pseudolidar.viewer.opening import Opening
from pseudolidar.viewer.panels.paths import WAY, PathsPanel
from pseudolidar.viewer.reel import NoFrames
from pseudolidar.viewer.server import GuardedServer
from pseudolidar.viewer.stills import PATH_COLOUR, TRUTH_COLOUR, StillPath
from pseudolidar.viewer.view import View

SOURCE = Synthetic("street", frames=5, width_px=128, height_px=64)
DRIVE = Path("/work/shared/data/kitti_raw/2011_09_26/2011_09_26_drive_0002_sync")
ODOMETRY = Path("/work/shared/data/kitti_odometry")
FAR = np.array([4.5e5, 5.4e6, 100.0])


def moved(places: np.ndarray) -> np.ndarray:
    """(N, 4, 4) poses at places."""
    T = np.tile(np.eye(4), (len(places), 1, 1))
    T[:, :3, 3] = places
    return T


def moment(index: int, T: np.ndarray | None) -> Moment:
    return Moment(f"id{index}", index, T_map_forward=T)


@pytest.fixture
def view(server: GuardedServer) -> View:
    return View(server, NoFrames())


def driven(path: DrawnPath) -> list[bool]:
    """Which parts of the line are drawn as driven."""
    green, coming = (coloured([one], 1)[0] for one in (PATH_COLOUR, COMING_COLOUR))
    assert all((part == green).all() or (part == coming).all() for part in path._line.colors)
    return [bool((part == green).all()) for part in path._line.colors]


def test_the_way_of_all_frames_is_drawn_as_soon_as_one_is_seen(view: View):
    """Of the clouds' frame, wherever it is on the body; relative to the first place; NaN is out."""
    poses = moved(FAR + np.arange(5.0)[:, None] * (1, 0, 0))
    poses[3] = np.nan
    path = DrawnPath(view, lambda: poses)
    path.wait()
    T_base_forward = np.eye(4)
    T_base_forward[:3, 3] = (0.5, 0, 1.7)
    for index in (1, 4, 0):
        view.show(moment(index, poses[index] @ T_base_forward))
        line = path._line
        assert np.diff(line.points[:, :, 0], axis=0) == pytest.approx(
            np.array([[1.0, 1.0], [1.0, 2.0]])
        )
        assert line.points[0, 0] == pytest.approx([-1.0, 0, 0])  # frame 1 was seen first
        passed = {1: [True, False, False], 4: [True] * 3, 0: [False] * 3}
        assert driven(path) == passed[index]
    view.show(moment(3, None))  # which nobody knows the place of: the way stays
    assert driven(path) == [True, True, False]


def test_what_does_not_change_is_not_sent(view: View, monkeypatch: pytest.MonkeyPatch):
    path = DrawnPath(view, lambda: moved(np.arange(9.0).reshape(3, 3)))
    path.wait()
    view.show(moment(0, np.eye(4)))
    sent: list[str] = []
    monkeypatch.setattr(
        type(path._line), "__setattr__", lambda _line, name, _value: sent.append(name)
    )
    view.show(moment(0, np.eye(4)))
    assert sent == []
    view.show(moment(1, np.eye(4)))
    assert sent == ["colors"]


def test_a_way_that_nobody_tells_grows(view: View):
    path = DrawnPath(view)
    path.wait()
    for index in (0, 2, 1):
        assert path.there == (index == 1)  # one place is no line
        view.show(moment(index, moved(np.array([[index, 0.0, 0.0]]))[0]))
    assert path._line.points[:, 0, 0].tolist() == [0, 1]
    assert driven(path) == [True, False]  # back at 1; 2 was seen before


def test_a_long_way_is_thinned_once(view: View, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(drawn_path, "MOST_PLACES", 30)
    path = DrawnPath(view, lambda: moved(np.arange(300.0).reshape(100, 3)))
    path.wait()
    for index in (0, 50, 51):
        view.show(moment(index, np.eye(4)))
        assert len(path._line.points) == 24
    assert 11 <= sum(driven(path)) <= 13


def test_a_pose_that_cannot_be_read_ends_nothing(view: View, caplog: pytest.LogCaptureFixture):
    """Nor does one that is shown before the others are known."""

    def damaged() -> np.ndarray:
        raise drawn_path.PseudolidarError("odd", want="even")

    path = DrawnPath(view, damaged)
    path.wait()
    assert "cannot be told" in caplog.text
    view.show(moment(0, np.eye(4)))
    assert not path.there


@pytest.mark.parametrize(
    "source", [SOURCE, pytest.param(DRIVE, marks=pytest.mark.real),
               pytest.param(ODOMETRY, marks=pytest.mark.real)]
)  # fmt: skip
def test_poses_are_those_of_the_loaded_frames(source: Synthetic | Path):
    if isinstance(source, Path) and not source.is_dir():
        pytest.skip("no KITTI data")
    settings = recognise(str(source)) if isinstance(source, Path) else source
    chosen = select(settings.open(), FrameSelection.parse("1::3"), None)
    pose_at = pose_of(chosen)
    assert pose_at is not None
    for index in (0, len(chosen.ids) - 1):
        told, loaded = pose_at(index), chosen.load(index).pose
        assert told is not None
        assert loaded is not None
        assert np.array_equal(told.matrix, loaded.matrix)


def test_the_way_of_a_source_is_where_its_clouds_are():
    reel = reel_by(Job().conversion(SOURCE))
    poses = reel.poses()
    assert poses is not None
    first, last = reel.load(0).T_map_forward, reel.load(4).T_map_forward
    assert first is not None
    assert last is not None
    assert drawn_path.places_of(poses, 0, first)[4] == pytest.approx(last[:3, 3])


def test_a_run_with_a_path_has_the_true_one_beside_it(tmp_path: Path):
    """Both are one at the first frame; there the map of the run begins."""
    source = SOURCE.open()
    times, true = source.timestamps_ns, source.trajectory.T_world_body
    found = np.linalg.inv(true[1]) @ true[1:4]
    found[2, 1, 3] += 0.5
    job = Convert(replace(SOURCE, frames=5), tmp_path)
    (tmp_path / "run.json").write_text(json.dumps({"settings": to_json(job)}))
    write_tum_trajectory(tmp_path / "trajectory.tum", times[1:4], found)
    opened = Opening(lambda _source: NoFrames(), truth_of_run=truth_of_run).all_of([str(tmp_path)])
    path, truth = opened.stills
    assert isinstance(path, StillPath)
    assert isinstance(truth, StillPath)
    assert (truth.name, truth.colour) == ("ground truth", TRUTH_COLOUR)
    assert truth.places_m[1:4] - path.places_m == pytest.approx(
        np.array([[0, 0, 0], [0, 0, 0], [0, -0.5, 0]]), abs=1e-6
    )
    (tmp_path / "run.json").write_text('{"settings": {"source": {"path": "gone"}}}')
    opened = Opening(lambda _source: NoFrames(), truth_of_run=truth_of_run).all_of([str(tmp_path)])
    assert [still.name for still in opened.stills] == ["trajectory.tum"]


def test_paths_are_switched_by_their_names(view: View):
    view.stage.put(StillPath("<i>", moved(np.eye(3))[:, :3, 3], TRUTH_COLOUR))
    path = DrawnPath(view)
    path.wait()
    panel = PathsPanel(view, path)
    for index in range(2):
        view.show(moment(index, moved(np.array([[index, 0.0, 0.0]]))[0]))
    assert panel._known == {"<i>", WAY}
    still, way = view.stage.paths["<i>"], path._line
    handles = {one.label: one for one in view.gui._gui_input_handle_from_uuid.values()}
    for name, line in (("<i>", still), (WAY, way)):
        handles[name].value = False
        assert not line.visible
    view.show(moment(0, np.eye(4)))
    assert not way.visible
