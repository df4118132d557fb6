"""Sequences beside the first one: which frames belong together, where their clouds are."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from pseudolidar.pipelines.view import View as ViewJob

from pseudolidar.formats.points.pcd import write_pcd
from pseudolidar.sources.recognise import recognise
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.comparing.arrangement import (
    ASIDE,
    FIRST,
    IN_TURN,
    ONLY,
    Arrangement,
    groups_of,
    modes,
)
from pseudolidar.viewer.comparing.companions import Companion, Companions, beside, label_of
from pseudolidar.viewer.comparing.joined import joined
from pseudolidar.viewer.comparing.turns import Turns
from pseudolidar.viewer.moment import STEREO, VELODYNE, Moment
from pseudolidar.viewer.reel import NoFrames
from pseudolidar.viewer.server import GuardedServer
from pseudolidar.viewer.view import View

POINTS = np.float32([[1, 2, 3], [4, 5, 6]])


def cloud(frame: str = "velodyne") -> PointCloud:
    return PointCloud(POINTS, frame)


def folder(place: Path, *names: str) -> Path:
    place.mkdir(parents=True)
    for name in names:
        write_pcd(place / f"{name}.pcd", cloud())
    return place


@dataclass(frozen=True)
class Given:
    """A reel of frames that are there."""

    moments: tuple[Moment, ...]
    name: str = "given"

    @property
    def ids(self) -> list[str]:
        return [one.id for one in self.moments]

    @property
    def times_s(self) -> list[float]:
        return [0.0] * len(self.moments)

    def load(self, index: int) -> Moment:
        return self.moments[index]


def companion(*moments: Moment, label: str = "run") -> Companion:
    reel = Given(moments)
    return Companion.of(label, reel, reel)


def test_frames_of_one_name_belong_together(tmp_path: Path):
    first, other = (
        ViewJob().reel_of(recognise(str(folder(tmp_path / name, *ids))))
        for name, ids in (("a", ("1", "2", "3")), ("b", ("3", "1")))
    )
    assert Companion.of("b", other, first).partners == {0: 0, 2: 1}
    # Nothing in common: by place, as long as both last.
    odd = ViewJob().reel_of(recognise(str(folder(tmp_path / "c", "x", "y"))))
    found = Companion.of("c", odd, first)
    assert (found.partners, found.how) == ({0: 0, 1: 1}, "2 frames by their place")


def test_a_run_is_called_by_its_folder(tmp_path: Path):
    run = folder(tmp_path / "drive/pcd", "1").parent
    (run / "run.json").write_text("{}")
    reel = ViewJob().reel_of(recognise(str(run / "pcd")))
    assert label_of(reel, ()) == "drive"
    assert label_of(reel, ("drive", "drive (2)")) == "drive (3)"
    assert label_of(NoFrames("a/b <i>" + 100 * "x"), ()).startswith("a_b _i_xx")
    assert len(label_of(NoFrames(100 * "x"), ())) == 40
    assert label_of(NoFrames("///"), ()) == "other"


def test_clouds_have_the_name_of_their_sequence_and_the_scan_is_there_once():
    first = Moment("a", 0, clouds={STEREO: cloud(), VELODYNE: cloud()})
    shown = beside(first, first, companion(first))
    assert list(shown.clouds) == ["stereo", "velodyne", "run: stereo"]


def test_another_frame_is_placed_by_both_poses():
    near, far = np.eye(4), np.eye(4)
    far[:3, 3] = (10, 0, 0)
    first = Moment("a", 0, clouds={STEREO: cloud()}, T_map_forward=near)
    other = Moment("b", 0, clouds={STEREO: cloud("base_link")}, T_map_forward=far)
    placed = beside(first, other, companion(other)).clouds["run: stereo"]
    assert placed.frame == "velodyne"
    assert np.allclose(placed.xyz, POINTS + np.float32([10, 0, 0]))
    # In one frame they are the rig's, wherever each thinks that it is.
    same = Moment("b", 0, clouds={STEREO: cloud()}, T_map_forward=far)
    assert np.array_equal(beside(first, same, companion(same)).clouds["run: stereo"].xyz, POINTS)


def test_what_cannot_be_read_is_told_and_the_rest_is_shown():
    first = Moment("a", 0, clouds={STEREO: cloud()})
    shown = beside(first, Moment("a", 0, fault="cut off"), companion(first))
    assert shown.fault == "run: cut off"
    assert list(shown.clouds) == [STEREO]
    together = Companions()
    together.add(companion(first))
    together.add(companion(first, label="second"))
    assert list(together(first).clouds) == ["stereo", "run: stereo", "second: stereo"]
    together.add(companion(Moment("a", 0), label="run"))  # in place of the one of that name
    assert list(together(first).clouds) == ["stereo", "second: stereo"]
    assert list(together(Moment("z", 7)).clouds) == []  # no partner


def test_groups_are_shown_in_turn_or_side_by_side():
    clouds = ("stereo", "velodyne", "run: stereo")
    groups = groups_of(clouds, [companion(label="run")], ("stereo", "velodyne"))
    assert groups == {FIRST: ("stereo",), "run": ("run: stereo",)}
    assert Arrangement().hidden(groups) == frozenset()
    assert Arrangement(IN_TURN).hidden(groups) == {"run: stereo"}
    assert Arrangement(IN_TURN, turn=3).hidden(groups) == {"stereo"}
    assert Arrangement(f"{ONLY}run").hidden(groups) == {"stereo"}
    assert Arrangement(f"{ONLY}gone").hidden(groups) == frozenset()
    assert Arrangement(ASIDE, apart_m=5).shifts(groups) == {"run: stereo": (0, -5, 0)}
    assert Arrangement(IN_TURN).shifts(groups) == {}
    assert modes(groups)[-1] == "only run"
    # Without others: the two that are compared.
    assert groups_of(clouds, [], ("stereo", "velodyne")) == {
        "stereo": ("stereo",),
        "velodyne": ("velodyne",),
    }
    assert Arrangement(IN_TURN).hidden({}) == frozenset()


def test_a_scene_with_two_sequences(server: GuardedServer):
    first, other = (Given((Moment("a", 0, clouds={STEREO: cloud()}),), n) for n in ("one", "two"))
    view = View(server, first)
    joined(view, (first, other))
    view.stage.show(view.made(0))
    assert list(view.stage.shown) == ["stereo", "two: stereo"]
    assert view.stage.look("two: stereo").colouring.by == "plain"
    view.stage.arrange(frozenset({"stereo"}), {"two: stereo": (0.0, -7.0, 0.0)})
    ((name, (_, T)),) = view.stage.pickable().items()
    assert name == "two: stereo"
    assert np.allclose(T[:3, 3], (0, -7, 0))
    handle = view.stage._clouds["two: stereo"]
    assert np.allclose(handle.position, (0, -7, 0))
    assert not view.stage._clouds["stereo"].visible
    view.stage.show(view.made(0))  # the next frame stays arranged
    assert not view.stage._clouds["stereo"].visible
    view.stage.arrange(frozenset(), {})
    assert view.stage._clouds["stereo"].visible
    assert np.allclose(handle.position, 0)
    view.ready.close()


@pytest.mark.parametrize("wanted", [True, False])
def test_turns_go_on_only_while_they_are_wanted(wanted: bool):
    told = threading.Event()
    turns = Turns(told.set, pace_s=0.01)
    turns.run(wanted=wanted)
    assert told.wait(5 if wanted else 0.05) == wanted
    turns.close()
