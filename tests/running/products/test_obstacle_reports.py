"""Clouds with object numbers, and tables and pictures of obstacles on a page."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pseudolidar.evaluation.obstacles import JudgedObject
from pseudolidar.evaluation.page import render_page
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.points.npz import read_npz
from pseudolidar.formats.points.pcd import read_pcd
from pseudolidar.formats.points.ply import read_ply
from pseudolidar.running.products.compared_outputs import COLUMN_KINDS
from pseudolidar.running.products.found import Found
from pseudolidar.running.products.found_clouds import cloud_files
from pseudolidar.running.reports.obstacle_objects import (
    OBJECT_HEADER,
    object_rows,
    objects_section,
    objects_text,
    obstacles_section,
)
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


def test_a_page_shows_tables_and_pictures(tmp_path, frame, seen) -> None:  # noqa: F811
    committed(tmp_path, frame, seen)
    obstacles = {frame.id: (car(), light())}
    sections = [
        obstacles_section(tmp_path, obstacles, {frame.id: 0.5}),
        objects_section(JUDGED),
    ]
    page = render_page("Obstacles", "", sections).decode()
    for words in ("Car 7", "20.0 +- 0.3 m", "8.3 m/s", "traffic light", "4.0 x 1.8 x 1.5 m"):
        assert words in page
    assert page.count("data:image/jpeg") == 1
    assert "+0.05" in page
    empty = obstacles_section(tmp_path, {}, {})
    assert (list(empty.table), list(empty.pictures)) == ([], [])
