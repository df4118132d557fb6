"""Clouds with object numbers; labelled objects as a table; the page of a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pseudolidar.evaluation.obstacles import JudgedObject
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.points.npz import read_npz
from pseudolidar.formats.points.pcd import read_pcd
from pseudolidar.formats.points.ply import read_ply
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.running.products.compared_outputs import COLUMN_KINDS
from pseudolidar.running.products.found import Found
from pseudolidar.running.products.found_clouds import cloud_files
from pseudolidar.running.products.told import ToldFrame
from pseudolidar.running.reports.obstacle_objects import (
    OBJECT_HEADER,
    object_rows,
    objects_text,
)
from pseudolidar.running.reports.obstacles_page import write_obstacles_page
from pseudolidar.running.results import RunResult
from pseudolidar.sources.source import SourceSummary
from tests.formats.made_obstacles import car, light
from tests.running.products.test_obstacle_film import committed, frame, seen  # noqa: F401

JUDGED = (
    JudgedObject("000013", "Car", 9.7, 11.9, 9.75, 0.2, 10.4),
    JudgedObject("000013", "Cyclist", 30.0, 31.0),
)


def test_points_of_obstacles_have_their_number(tmp_path, frame, seen) -> None:  # noqa: F811
    far, near = (np.array(pixels, np.int64) for pixels in ([5, 6, 7], [7, 8]))
    found = Found(frame, seen, (replace(car(), pixels=near), replace(light(), pixels=far)))
    for file in cloud_files(found, COLUMN_KINDS):
        write_atomic(tmp_path / file.name.replace("/", f"{len(file.data)}/"), file.data)
    (path,) = tmp_path.rglob("*.npz")
    numbers = read_npz(path).extra["object"]
    assert numbers[4:10].tolist() == [0, 2, 2, 1, 1, 0]  # of two the nearer has it
    assert np.count_nonzero(numbers) == 4
    for path in (*tmp_path.rglob("*.pcd"), *tmp_path.rglob("*.ply")):
        cloud = read_pcd(path) if path.suffix == ".pcd" else read_ply(path)
        assert cloud.extra["object"].tolist() == numbers.tolist()


def test_each_object_is_beside_its_label_and_the_usual_script() -> None:
    found, missed = object_rows(JUDGED)
    assert found == ("000013", "Car", "11.90", "9.70", "9.75", "0.20", "+0.05", "10.40", "-1.50")
    assert missed[4:] == ("-",) * 5
    head, *rows = [line.split() for line in objects_text(JUDGED).splitlines() if line.strip()]
    assert head[0] == OBJECT_HEADER[0]
    assert any("+0.05" in row for row in rows)


def told(*frames: tuple[str, tuple], judged=()) -> dict[str, ToldFrame]:
    return {
        name: ToldFrame(10**9 * (1 + number), [], tuple(found), judged if number == 0 else ())
        for number, (name, found) in enumerate(frames)
    }


def result(*ids: str, skipped: str = "") -> RunResult:
    records = [FrameRecord(name, number, (), {}) for number, name in enumerate(ids)]
    if skipped:
        why = {"code": "LowTexture", "got": "a white wall", "fix": "Look elsewhere."}
        records.append(FrameRecord(skipped, len(ids), (), {}, why))
    network = {"file": "n.onnx", "sha256": "ab" * 32, "licence": "<b>MIT</b>"}
    return RunResult(
        SourceSummary("folder", "here", "a drive"),
        len(records),
        tuple(records),
        len(ids),
        figures_of_run={"networks": {"detector": network}},
    )


def test_a_page_tells_what_was_found_and_what_was_not(tmp_path, frame, seen) -> None:  # noqa: F811
    committed(tmp_path, frame, seen)
    gone = replace(car(), track=replace(car().track, state="coasting", unseen_s=0.4))
    frames = told((frame.id, (car(), light())), ("later", (gone, light())), judged=JUDGED)
    path = write_obstacles_page(
        tmp_path,
        result(frame.id, "later", skipped="white"),
        frames,
        rig=None,
        settings={"detector": "onnx (path n.onnx)"},
    )
    page = path.read_text()
    assert "3 obstacles in 2 frames; the nearest, Car 7, at 20.0 +- 0.3 m" in page
    for words in ("8.3 m/s", "traffic light", "4.0 x 1.8 x 1.5 m", "unseen 0.4 s", "by its size"):
        assert words in page
    for words in ("a white wall", "Look elsewhere.", "ab" * 32, "&lt;b&gt;MIT"):
        assert words in page
    assert "1 of 2 labelled objects found" in page
    assert page.count("data:image/jpeg") == 1  # of the frame that has a picture
    assert page.count("data:image/svg+xml") == 3
    assert 'src="http' not in page


def test_a_page_of_nothing_is_a_page(tmp_path) -> None:
    frames = told(("a", ()), ("b", ()))
    page = write_obstacles_page(tmp_path, result("a", "b"), frames, rig=None, settings={})
    assert "Nothing was found in 2 frames." in page.read_text()
    assert "<svg" not in page.read_text()
