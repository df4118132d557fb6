"""Obstacles in recordings: boxes, annotations and edges, as other readers see them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory as Ros2Decoder

from pseudolidar.formats.mcap.content import McapContent
from pseudolidar.formats.mcap.frame import pack_frame
from pseudolidar.formats.mcap.log import McapLog
from pseudolidar.formats.mcap.messages import frame_messages
from pseudolidar.formats.mcap.prolog import describe_recording
from pseudolidar.sources.recognise import recognise
from tests.formats.made_obstacles import car, light
from tests.formats.mcap.test_messages import (
    full_cloud,
    full_frame,
    points_of,
    turned_by,
    written,
)
from tests.rerun_program import Rerun

FOUND = (car(), light())


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    path = tmp_path_factory.mktemp("mcap") / "a.mcap"
    return path, written(path, full_frame(), cloud=full_cloud(100), obstacles=FOUND)


def test_boxes_tell_distance_speed_and_identity(recording) -> None:
    scene = recording[1]["/obstacles"]
    assert len(scene.deletions) == 1  # of what the frame before had
    tracked, still = scene.entities
    assert (tracked.id, still.id) == ("track/7", "frame/2")
    assert tracked.texts[0].text == "Car 7\n20.0 +- 0.3 m\n8.3 m/s"
    assert still.texts[0].text == "traffic light\n40.8 +- 1.2 m"
    (cube,) = tracked.cubes
    assert (cube.size.x, cube.size.y, cube.size.z) == (4.0, 1.8, 1.5)
    forward = turned_by(cube.pose.orientation, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(forward, car().box.pose.matrix[:3, 0], atol=1e-12)
    (arrow,) = tracked.arrows
    velocity = car().track.velocity_m_s
    along = turned_by(arrow.pose.orientation, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(along, velocity / np.linalg.norm(velocity), atol=1e-12)
    assert arrow.shaft_length + arrow.head_length == pytest.approx(np.linalg.norm(velocity))
    assert not still.arrows
    assert {pair.key: pair.value for pair in tracked.metadata}["contact_s"] == "2.400"


def test_annotations_are_on_the_left_image_and_the_near_one_is_on_top(recording) -> None:
    notes = recording[1]["/camera/left/annotations"]
    far, near = notes.points
    assert [(p.x, p.y) for p in near.points] == [
        (520.25, 170.0),
        (640.5, 170.0),
        (640.5, 260.0),
        (520.25, 260.0),
    ]
    assert near.type == 2  # a closed line
    assert far.points[0].x == 770.0
    assert notes.texts[1].text.startswith("Car 7")
    assert near.outline_color.r > far.outline_color.r


def test_edges_are_points_of_each_box(recording) -> None:
    points = points_of(recording[1]["/obstacles/edges"])
    assert set(points["object"]) == {7, 2}
    mine = points[points["object"] == 7]
    xyz = np.stack([mine[axis] for axis in "xyz"], axis=1)
    corners = car().box.corners_m()
    gaps = np.linalg.norm(xyz[:, None] - corners[None], axis=2)
    assert gaps.min(axis=0).max() < 1e-5  # all corners are among them
    local = car().box.pose.inverse().apply(xyz.astype(float)) / [2.0, 0.9, 0.75]
    assert (np.isclose(np.abs(local), 1, atol=1e-5).sum(axis=1) >= 2).all()
    assert set(mine["distance_m"]) == {20.0}


def test_nothing_found_is_a_message_and_nothing_asked_is_none(tmp_path) -> None:
    found = written(tmp_path / "none.mcap", full_frame(), obstacles=())
    assert not found["/obstacles"].entities
    assert len(found["/obstacles"].deletions) == 1
    assert len(found["/obstacles/edges"].data) == 0
    assert "/obstacles" not in written(tmp_path / "a.mcap", full_frame())


def test_our_own_reader_takes_the_clouds_and_not_the_edges(recording, tmp_path) -> None:
    frames = recognise(str(recording[0])).open()
    assert frames.ids == ("000042",)
    assert len(frames.load(0).cloud) == 100
    alone = tmp_path / "alone.mcap"
    written(alone, full_frame(), obstacles=FOUND)
    assert len(recognise(str(alone)).open().load(0).cloud) == 70  # those of the scan


def test_ros_2_reads_markers_and_detections(tmp_path) -> None:
    content = McapContent(profile="ros2")
    prolog = describe_recording(
        version="0", settings="", calibration="", matcher="", source="", content=content
    )
    frame = full_frame()
    with McapLog(tmp_path / "a.mcap", prolog) as log:
        messages = frame_messages(frame, obstacles=FOUND, content=content)
        log.append(pack_frame(messages, index=0))
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[Ros2Decoder()])
        found = {c.topic: m for _, c, _, m in reader.iter_decoded_messages()}
    deletion, cube, text, arrow, *_ = found["/obstacles"].markers
    assert (deletion.action, cube.type, text.type, arrow.type) == (3, 1, 9, 0)
    assert (cube.id, cube.scale.x, text.text) == (7, 4.0, "Car 7\n20.0 +- 0.3 m\n8.3 m/s")
    assert arrow.points[1].z - arrow.points[0].z == -8.25
    first, second = found["/obstacles/boxes"].detections
    assert (first.id, second.id) == ("7", "2")
    covariance = np.reshape(first.results[0].pose.covariance, (6, 6))[:3, :3]
    R, sigma = car().box.pose.matrix[:3, :3], car().box.sigma_m[:3]
    np.testing.assert_allclose(covariance, R @ np.diag(sigma**2) @ R.T, atol=1e-15)
    assert found["/obstacles/edges"].width > 0


def test_rerun_shows_the_edges_as_points(recording, tmp_path_factory) -> None:
    rerun = Rerun(tmp_path_factory.mktemp("home"))
    path = recording[0]
    rerun("mcap", "check", "--full", path)
    converted = path.with_suffix(".rrd")
    rerun("mcap", "convert", path, "-o", converted)
    printed = rerun("rrd", "print", converted)
    edges = [line for line in printed.splitlines() if " - /obstacles/edges - data" in line]
    assert any("Points3D:positions" in line and "Points3D:colors" in line for line in edges)
