"""Objects in exported films, pictures and scenes: where they are, and in every frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zstandard
from pseudolidar.pipelines.view import View, exported, reel_by

from pseudolidar.errors import PseudolidarError
from pseudolidar.evaluation.cloud_views import Eye, perspective
from pseudolidar.evaluation.pictures import NOTHING
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.obstacles.labels import Labels
from pseudolidar.obstacles.template import Template
from pseudolidar.sources.changed import ChangedSource
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.viewer.exporting import waits_s
from pseudolidar.viewer.filming.film import Film
from pseudolidar.viewer.filming.outlined import FilmedObjects, Outlines, projected
from pseudolidar.viewer.filming.shot import Shot
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.objects.scene import (
    FREE_COLOUR,
    THING_COLOUR,
    ObjectScene,
    Parts,
    ShownCorridor,
)
from pseudolidar.viewer.objects.shown import TRUTH_COLOUR, ShownObject, ShownTruth
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.reel import SourceReel
from tests.formats.made_obstacles import car, light
from tests.viewer.objects.test_shown import T_forward_camera
from tests.viewer.test_filming import FAR, SMALL, Frames

EYE = Eye((-4.0, 1.0, 3.0), (20.0, 2.0, 1.0), 640, 360)
NOWHERE = PointCloud(np.zeros((0, 3), np.float32), "film", rgb=np.zeros((0, 3), np.uint8))
CAR = ShownObject.of(1, car(), T_forward_camera())
LIGHT = ShownObject.of(2, light(), T_forward_camera())
EVERYTHING = Parts()
CORRIDOR = ShownCorridor(CAR.corners_m + 3, np.array([9.0, 0, 0]), "Corridor: 4.00 ± 0.10 m")


def drawn(scene: ObjectScene, parts: Parts = EVERYTHING) -> np.ndarray:
    return Shot(NOWHERE, EYE, 0.05, Outlines.of(scene, parts, np.eye(4))).drawn()


def places(picture: np.ndarray) -> np.ndarray:
    """(N, 2) pixels in which anything is drawn, x and y."""
    return np.argwhere((picture != NOTHING).any(axis=2))[:, ::-1]


def test_a_box_is_drawn_where_its_corners_are_seen():
    picture = drawn(ObjectScene((CAR,)), Parts(labels=0))
    corners = PointCloud(CAR.corners_m.astype(np.float32), "film")
    seen = places(perspective(corners, EYE, point_m=0.001))
    assert len(seen) == 8
    there = places(picture)
    for corner in seen:
        assert np.abs(there - corner).max(axis=1).min() <= 1
    # Edges end at corners: only the arrow reaches beyond them, and it comes nearer.
    assert there[:, 1].min() >= seen[:, 1].min() - 2
    purest = picture[tuple(there.T[::-1])].astype(int) - CAR.colour
    assert np.abs(purest).sum(axis=1).min() == 0


def test_what_is_behind_the_eye_is_cut():
    eye = Eye((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 200, 100)
    through, behind = [[-2.0, 0, 0], [2.0, 1, 0]], [[-2.0, 0, 0], [-1.0, 1, 0]]
    ((begin, end),) = projected(np.array([through, behind]), eye)
    assert end == pytest.approx([99.5 - eye.focal_px / 2, 49.5])  # 1 m to the left at 2 m
    assert np.isfinite(begin).all()
    assert begin[0] < end[0]  # at the plane of the eye it is farther aside


def test_parts_that_are_not_wanted_are_not_drawn():
    scene = ObjectScene((CAR, LIGHT), corridor=CORRIDOR)
    whole = Outlines.of(scene, Parts(), np.eye(4))
    assert [words.lines[0] for words in whole.words] == [CAR.name, LIGHT.name]
    assert whole.words[0].lines == ("Car 7", "20.0 +- 0.3 m", "8.3 m/s")
    assert whole.caption == "Corridor: 4.00 +- 0.10 m"
    assert {one.colour for one in whole.lines} == {CAR.colour, LIGHT.colour, THING_COLOUR}
    assert len(Outlines.of(scene, Parts(labels=1), np.eye(4)).words) == 1
    without = Outlines.of(scene, Parts(boxes=False), np.eye(4))
    assert {one.colour for one in without.lines} == {THING_COLOUR}
    assert not without.words
    labelled = ObjectScene(truths=(ShownTruth(CAR.corners_m, "Car"),))
    assert Outlines.of(labelled, Parts(), np.eye(4)).words[0].lines == ("Car",)
    assert not Outlines.of(labelled, Parts(truth=False), np.eye(4)).lines
    assert (drawn(ObjectScene()) == NOTHING).all()


def test_words_are_of_labels_only_where_nothing_was_found():
    scene = ObjectScene((CAR, LIGHT), (ShownTruth(CAR.corners_m, "Car"),))
    assert [(one.text, one.colour) for one in scene.words(Parts())] == [
        (CAR.label, CAR.colour),
        (LIGHT.label, LIGHT.colour),
    ]
    assert not scene.words(Parts(boxes=False))  # found, but not drawn
    (label,) = replace(scene, objects=()).words(Parts(boxes=False))
    assert (label.text, label.colour) == ("Car", TRUTH_COLOUR)
    assert not replace(scene, objects=()).words(Parts(truth=False))


def test_a_corridor_tells_by_its_colour_whether_it_is_free():
    free = replace(CORRIDOR, nearest_m=None)
    assert (free.colour, CORRIDOR.colour) == (FREE_COLOUR, THING_COLOUR)
    assert len(free.lines()) == 12
    cross = CORRIDOR.lines()[12:]
    assert cross.mean(axis=1) == pytest.approx(np.broadcast_to(CORRIDOR.nearest_m, (3, 3)))


def test_words_stand_in_the_picture_and_those_of_what_is_not_seen_nowhere():
    words_only = places(drawn(ObjectScene((CAR,)))).shape[0]
    assert words_only > places(drawn(ObjectScene((CAR,)), Parts(labels=0))).shape[0] + 500
    away = Outlines.of(ObjectScene((CAR,)), Parts(), np.diag([-1.0, 1, 1, 1]))  # behind the eye
    assert (Shot(NOWHERE, EYE, 0.05, away).drawn() == NOTHING).all()


@dataclass
class Seen:
    """Scenes of frames, and which frames were asked for."""

    indices: list[int] = field(default_factory=list)

    def __call__(self, moment: Moment) -> ObjectScene:
        self.indices.append(moment.index)
        points = np.ones((5, 3), np.float32)
        return ObjectScene((CAR,), xyz=points, colours=np.full((5, 3), 9, np.uint8))


def test_each_frame_of_a_film_has_its_own_objects_where_it_is_in_the_map():
    seen = Seen()
    objects = FilmedObjects(seen, Parts(points=True))
    shots = list(Film.of(Opened((Frames(),)), size_px=SMALL, objects=objects).shots)
    assert seen.indices == [0, 1, 2]  # once each, in order: who is who depends on it
    first, last = (np.asarray(shots[at].outlines.lines[0].ends_m) for at in (0, -1))
    assert last - first == pytest.approx(np.broadcast_to([2.0, 0, 0], first.shape))
    assert np.abs(first).max() < 40 < np.abs(FAR).max()  # relative to the first pose
    points = [(shot.cloud.rgb == 9).all(axis=1) for shot in shots if shot.cloud.rgb is not None]
    assert [int(one.sum()) for one in points] == [5] * len(shots)


@pytest.fixture(scope="module")
def street() -> SourceReel:
    """Two small frames with labels."""
    source = Synthetic("street", frames=2, width_px=320, height_px=96)
    reel: SourceReel = reel_by(View().conversion(source))
    return reel


def messages(path: Path) -> list[tuple[float, dict]]:
    """What viser's player is told, with the times."""
    inner = zstandard.ZstdDecompressor().decompressobj().decompress(path.read_bytes()[8:])
    size = int.from_bytes(inner[:8], "little")
    return msgspec.msgpack.decode(inner[8 : 8 + size])["messages"]


def words_of(path: Path) -> dict[str, list[str]]:
    """Texts of labels in the order in which they are told, by their nodes."""
    told: dict[str, list[str]] = {}
    for _, message in messages(path):
        text = message.get("props", message.get("updates", {})).get("text")
        if text:
            told.setdefault(message["name"], []).append(text)
    return told


def test_a_scene_in_one_file_has_the_objects_that_a_run_found(street: SourceReel, tmp_path: Path):
    found = {street.ids[0]: (car(),), street.ids[1]: (light(),)}
    exported(View(), Opened((street,), objects=found), tmp_path / "a.viser")
    assert words_of(tmp_path / "a.viser") == {
        "/map/rig/objects/label_0": ["Car 7\n20.0 ± 0.3 m\n8.3 m/s", "traffic light\n40.8 ± 1.2 m"]
    }


def test_a_scene_and_a_picture_have_the_objects_that_are_looked_for(
    street: SourceReel, tmp_path: Path
):
    job, opened = View(detector=Labels()), Opened((street,))
    exported(job, opened, tmp_path / "a.viser")
    told = words_of(tmp_path / "a.viser")["/map/rig/objects/label_0"]
    assert len(told) == 2
    assert [text.split("\n")[0] for text in told] == ["Car 1", "Car 1"]  # followed
    assert told[0] != told[1]  # it comes nearer
    exported(job, opened, tmp_path / "a.png")
    exported(View(), Opened((street,)), tmp_path / "bare.png")
    with_boxes, bare = (read_image(tmp_path / name).pixels for name in ("a.png", "bare.png"))
    assert (with_boxes != bare).any(axis=2).mean() > 0.002


@pytest.mark.parametrize("name", ["a.png", "a.viser"])
def test_what_hinders_objects_is_said_and_no_reason_to_write_nothing(
    street: SourceReel, tmp_path: Path, caplog: pytest.LogCaptureFixture, name: str
):
    bare = replace(street, source=ChangedSource(street.source, "", without_labels))
    exported(View(detector=Labels()), Opened((bare,)), tmp_path / name)
    assert (tmp_path / name).is_file()
    (said,) = [one.message for one in caplog.records if one.levelname == "WARNING"]
    assert said.startswith(
        "no objects in 1 frames" if name == "a.png" else "no objects in 2 frames"
    )
    assert "labels" in said


def without_labels(frame: StereoFrame) -> StereoFrame:
    return replace(frame, labels=None)


@pytest.mark.parametrize("name", ["a.png", "a.viser"])
def test_a_detector_that_cannot_be_loaded_is_told_before_anything_is_written(
    street: SourceReel, tmp_path: Path, name: str
):
    job = View(detector=Template(tmp_path / "gone.png"))
    with pytest.raises(PseudolidarError, match=r"gone\.png"):
        exported(job, Opened((street,)), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_frames_of_a_scene_last_as_on_the_page_and_the_last_one_is_seen():
    assert waits_s([0.0]) == [0.0]  # one frame moves nothing, and does not begin again
    assert waits_s([0.0, 0.1, 0.4]) == pytest.approx([0.1, 0.3, 0.3])
    assert waits_s([0.0, 1e6, 1e6]) == [1.0, 0.0, 0.0]
