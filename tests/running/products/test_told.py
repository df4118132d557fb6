"""Frames told in their order: tracks that are not seen for a while, runs that go on."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import LabelError, SequenceTime
from pseudolidar.evaluation.obstacle_drawing import AboveView, draw_from_above, draw_in_photo
from pseudolidar.formats.labels import read_tracking_labels
from pseudolidar.formats.mcap.items import Obstacles
from pseudolidar.formats.mcap.obstacle_edges import edge_points
from pseudolidar.formats.mcap.obstacle_scene import annotations_message, obstacles_message
from pseudolidar.formats.obstacle_json import obstacle_fields, read_obstacles
from pseudolidar.formats.rigs.kitti_calibration import FRAME_CAM0
from pseudolidar.formats.ros.ros2_obstacles import obstacle_detections_message
from pseudolidar.obstacles.tracker import Tracker
from pseudolidar.running.journal.record import OutputFile
from pseudolidar.running.products.found import found_name
from pseudolidar.running.products.found_clouds import write_tracking
from pseudolidar.running.products.obstacle_tables import encode_csv, encode_jsonl
from pseudolidar.running.products.product import Product
from pseudolidar.running.products.told import Telling
from pseudolidar.structures.pose import Pose
from tests.formats.made_obstacles import car, upright

IDS = tuple(f"{number:06d}" for number in range(8))
HIDDEN = IDS[4:6]
WIDE, HIGH, STEP_S, CLOSING_M_S = 1242, 375, 0.1, 8.0
K = [[721.5, 0.0, 609.5], [0.0, 721.5, 172.8], [0.0, 0.0, 1.0]]


def product(name: str, *, x_m: float = -2.5) -> Product:
    """A frame with a car that comes nearer, and without it where it is hidden."""
    number = IDS.index(name)
    z_m = 22.0 - CLOSING_M_S * STEP_S * number
    box = replace(car().box, pose=upright(x_m, 0.9, z_m, 0.3))
    one = replace(car(track=False), box=box, distance_m=z_m - 2.0)
    time_s = 1.0 + STEP_S * number
    fields = [] if name in HIDDEN else [obstacle_fields(one, frame=name, time_s=time_s, number=1)]
    data = {
        "time_ns": round(time_s * 1e9),
        "T_map_camera": None,
        "camera": {"K": K, "size_px": [WIDE, HIGH]},
        "obstacles": fields,
    }
    return Product((OutputFile.of(found_name(name), json.dumps(data).encode()),))


def told_all(folder, *, earlier=(), **where):
    """Everything told; frames of `earlier` are committed, the others come."""
    for name in earlier:
        (file,) = product(name, **where).files
        (folder / file.name).parent.mkdir(exist_ok=True)
        (folder / file.name).write_bytes(file.data)
    telling = Telling(folder, IDS, earlier, Tracker())
    for name in IDS:
        if name not in earlier:
            telling(name, product(name, **where))
    return telling.finish(earlier)


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    return told_all(tmp_path_factory.mktemp("told"))


def test_what_is_not_seen_is_told_where_it_should_be(told) -> None:
    assert [len(frame.obstacles) for frame in told.values()] == [1] * len(IDS)
    assert {one.track.track_id for frame in told.values() for one in frame.obstacles} == {1}
    for name, frame in told.items():
        (one,) = frame.obstacles
        (fields,) = frame.fields
        assert one.coasts == (name in HIDDEN) == (fields["track_state"] == "coasting")
        assert (fields["measured_by"] == "track") == one.coasts == (fields["points"] == 0)
        number = IDS.index(name)
        nearest_m = one.box.corners_m()[:, 2].min()
        if not one.coasts:
            continue
        assert abs(nearest_m - one.distance_m) < 1e-9
        true_m = 22.0 - CLOSING_M_S * STEP_S * number
        error_m = one.box.pose.translation_m[2] - true_m
        assert abs(error_m) < 3 * one.sigma_distance_m
        assert one.track.unseen_s == pytest.approx(STEP_S * (number - 3))
        assert (one.confidence, one.detection.score) == (0.0, 0.875)
        u = K[0][0] * one.box.corners_m()[:, 0] / one.box.corners_m()[:, 2] + K[0][2]
        assert one.detection.box_px[0] == pytest.approx(u.min())
        assert one.detection.box_px[2] == pytest.approx(u.max())
    first, second = (told[name].obstacles[0].sigma_distance_m for name in HIDDEN)
    assert second > first > 0  # the longer it is not seen, the less sure


@pytest.mark.parametrize("earlier", [IDS[:1], IDS[:5], IDS[3:6], IDS[6:], IDS])
def test_a_run_that_goes_on_tells_the_same(told, tmp_path, earlier) -> None:
    again = told_all(tmp_path, earlier=earlier)
    assert list(again) == list(told)
    assert [f.fields for f in again.values()] == [f.fields for f in told.values()]


def test_files_that_somebody_changed_are_named(tmp_path) -> None:
    told_all(tmp_path, earlier=IDS[:2])
    path = tmp_path / found_name(IDS[0])
    path.write_bytes(path.read_bytes()[:-20])
    telling = Telling(tmp_path, IDS, IDS[:2], Tracker())
    with pytest.raises(LabelError, match=IDS[0]):
        telling(IDS[2], product(IDS[2]))
    late = Telling(tmp_path, IDS, (), Tracker())
    late(IDS[2], product(IDS[2]))
    with pytest.raises(SequenceTime):
        late(IDS[3], Product((replace(product(IDS[1]).files[0], name=found_name(IDS[3])),)))


def test_what_left_the_picture_is_not_told(tmp_path) -> None:
    beside = told_all(tmp_path, x_m=-60.0)
    assert [len(beside[name].obstacles) for name in HIDDEN] == [0, 0]
    assert len(beside[IDS[-1]].obstacles) == 1


def test_every_output_says_that_it_coasts(told, tmp_path) -> None:
    fields = [one for frame in told.values() for one in frame.fields]
    (tmp_path / "obstacles.jsonl").write_bytes(encode_jsonl(fields))
    found = read_obstacles(tmp_path / "obstacles.jsonl")
    assert [found[name][0].coasts for name in IDS] == [name in HIDDEN for name in IDS]
    lines = encode_csv(fields).decode().splitlines()
    states = [dict(zip(lines[0].split(","), row.split(","), strict=True)) for row in lines[1:]]
    assert [row["track_state"] for row in states if row["frame"] in HIDDEN] == ["coasting"] * 2
    assert [row["unseen_s"] for row in states if row["frame"] in HIDDEN] == ["0.1", "0.2"]
    write_tracking(tmp_path, told)
    identity = Pose.identity("camera_left", FRAME_CAM0)
    tracked = read_tracking_labels(tmp_path / "tracking.txt", T_left_cam0=identity)
    assert [tracked[i][0].occlusion for i in range(8)] == [None] * 4 + [3] * 2 + [None] * 2


def test_recordings_and_film_show_it_paler(told) -> None:
    from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
    from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

    seen, hidden = (told[name].obstacles for name in (IDS[3], IDS[4]))
    scenes = [SceneUpdate(), SceneUpdate()]
    notes = [ImageAnnotations(), ImageAnnotations()]
    drawn, above = [], []
    for scene, note, ones in zip(scenes, notes, (seen, hidden), strict=True):
        content = Obstacles(ones, "camera_left")
        scene.ParseFromString(b"".join(obstacles_message(content, 1)))
        note.ParseFromString(b"".join(annotations_message(content, 1)))
        photo, view = np.zeros((HIGH, WIDE, 3), np.uint8), np.zeros((400, 400, 3), np.uint8)
        same = [replace(ones[0], track=replace(ones[0].track, velocity_m_s=np.zeros(3)))]
        draw_in_photo(photo, same, np.array(K))
        draw_from_above(view, same, AboveView(400, 60.0))
        box = [round(value) for value in ones[0].detection.box_px]
        drawn.append((photo[box[3], box[0] : box[2]].max(axis=1) > 0).mean())
        above.append(view)
    colours = [scene.entities[0].cubes[0].color.a for scene in scenes]
    assert colours[1] == pytest.approx(0.35 * colours[0])
    facts = {pair.key: pair.value for pair in scenes[1].entities[0].metadata}
    assert (facts["track_state"], facts["unseen_s"]) == ("coasting", "0.100")
    assert scenes[1].entities[0].texts[0].text.endswith("unseen 0.1 s")
    assert notes[1].points[0].outline_color.a < notes[0].points[0].outline_color.a
    edges = [edge_points(ones, "camera_left").columns for ones in (seen, hidden)]
    assert (edges[0]["coasting"] == 0).all()
    assert (edges[1]["coasting"] == 1).all()
    assert edges[1]["alpha"].max() < edges[0]["alpha"].min()
    boxes = [obstacle_detections_message(Obstacles(o, "camera_left"), 1) for o in (seen, hidden)]
    assert len(b"".join(boxes[1])) < len(b"".join(boxes[0]))  # of what is seen alone
    assert drawn[0] == 1  # a line
    assert 0.3 < drawn[1] < 0.9  # dashes, over those of an edge in space
    assert np.count_nonzero(above[1]) < np.count_nonzero(above[0])
