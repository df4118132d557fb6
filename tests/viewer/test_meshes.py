"""Meshes as paths, without a browser."""

from __future__ import annotations

import logging
import struct
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page

from pseudolidar.cli import main
from pseudolidar.errors import LimitError, MeshIndex, PointFileCorrupt, PseudolidarError
from pseudolidar.formats.meshes.glb import linear_light
from pseudolidar.formats.meshes.glb_reader import decode_glb
from pseudolidar.formats.meshes.mesh_file import ENCODERS
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.formats.points.ply import write_ply
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.mesh import Mesh
from pseudolidar.viewer import drawn_meshes, meshes
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.colouring import Colouring
from pseudolidar.viewer.filming.film import Film
from pseudolidar.viewer.meshes import read_still_mesh, surface_colours
from pseudolidar.viewer.opening import Opened, Opening
from pseudolidar.viewer.panels.help import listed
from pseudolidar.viewer.reel import NoFrames
from pseudolidar.viewer.stills import StillCloud, StillMesh
from pseudolidar.viewer.tone import INPUT, OUTPUT, A, B, C, D, E, light_shown_as
from tests.viewer.seen import pixels_of, screenshot

UTM = np.array([450_000.0, 5_400_000.0, 100.0])


def roof(origin: np.ndarray = UTM, frame: str = "map") -> Mesh:
    """Two slopes of 4 m x 2 m, red and green."""
    at = [(0, -2, 0), (4, -2, 0), (4, 0, 1), (0, 0, 1), (4, 2, 0), (0, 2, 0)]
    rgb = np.uint8([(200, 30, 30), (200, 30, 30), *[(120, 120, 30)] * 2, *[(30, 200, 30)] * 2])
    faces = np.int32([[0, 1, 2], [0, 2, 3], [3, 2, 4], [3, 4, 5]])
    return Mesh(np.array(at, np.float64) + origin, faces, frame, rgb)


def waves(count: int, *, step_m: float, high_m: float) -> Mesh:
    """A square of so many vertices a side."""
    y, x = step_m * np.mgrid[0:count, 0:count].astype(np.float64)
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    faces = [np.stack([corner, corner + 1, corner + count + 1], axis=1)]
    faces += [np.stack([corner, corner + count + 1, corner + count], axis=1)]
    places = np.stack([x, y, high_m * np.sin(4 * x)], axis=-1).reshape(-1, 3) + UTM
    return Mesh(places, np.concatenate(faces).astype(np.int32), "map")


def opened(*paths: Path) -> Opened:
    return Opening(lambda _source: NoFrames()).all_of([str(path) for path in paths])


@pytest.mark.parametrize("kind", ENCODERS)
def test_every_format_of_ours_is_a_mesh(tmp_path: Path, kind: str):
    (tmp_path / f"mesh.{kind}").write_bytes(ENCODERS[kind](roof()))  # type: ignore[index]
    (still,) = opened(tmp_path / f"mesh.{kind}").stills
    assert isinstance(still, StillMesh)
    assert still.amount == "4 triangles"
    assert np.abs(still.mesh.vertices - roof().vertices).max() < 1e-3
    assert listed(Opened(stills=(still,))) == f"- mesh\\.{kind}: 4 triangles"


def test_a_ply_without_faces_stays_a_cloud(tmp_path: Path):
    write_ply(tmp_path / "a.ply", PointCloud(np.zeros((3, 3), np.float32), "map"))
    (tmp_path / "b.ply").write_bytes(ENCODERS["ply"](roof().only(np.zeros(4, bool))))
    assert all(
        isinstance(s, StillCloud) for s in opened(tmp_path / "a.ply", tmp_path / "b.ply").stills
    )


def test_a_runs_folder_shows_its_mesh_beside_the_map(tmp_path: Path):
    (tmp_path / "run.json").write_text("{}")
    write_ply(tmp_path / "map.ply", PointCloud(UTM[None], "map"))
    for kind, encode in ENCODERS.items():
        (tmp_path / f"mesh.{kind}").write_bytes(encode(roof()))
    assert [still.name for still in opened(tmp_path).stills] == ["map.ply", "mesh.ply"]


def test_a_mesh_of_a_camera_is_turned(tmp_path: Path):
    (tmp_path / "m.ply").write_bytes(ENCODERS["ply"](roof(np.zeros(3), "camera_left")))
    still = read_still_mesh("m", tmp_path / "m.ply")
    assert np.allclose(still.mesh.vertices[2], (1, -4, 0))  # x right, y down, z forward


def with_vertex(data: bytes, value: float) -> bytes:
    """A PLY whose last x is another."""
    at = data.rindex(struct.pack("<d", float(roof().vertices[5, 0])))
    return data[:at] + struct.pack("<d", value) + data[at + 8 :]


def test_bad_meshes_are_refused_with_file_place_and_what_to_do(tmp_path: Path):
    path, whole = tmp_path / "m.ply", ENCODERS["ply"](roof())
    face = struct.pack("<B3i", 3, 3, 4, 5)
    empty = Mesh(roof().vertices, np.int32([[0, 0, 1]]), "map")
    cases: tuple[tuple[bytes, type[PseudolidarError], str], ...] = (
        (with_vertex(whole, float("nan")), PointFileCorrupt, "vertex 5"),
        (with_vertex(whole, float("inf")), PointFileCorrupt, "vertex 5"),
        (whole.replace(face, struct.pack("<B3i", 3, 3, 4, 6)), MeshIndex, "face 3"),
        (whole.replace(face, struct.pack("<B3i", 3, 3, 4, -1)), MeshIndex, "face 3"),
        (ENCODERS["ply"](empty), PointFileCorrupt, ""),
    )
    for data, kind, place in cases:
        path.write_bytes(data)
        with pytest.raises(kind) as caught:
            opened(path)
        assert caught.value.path == str(path)
        assert place in caught.value.where
        assert caught.value.fix


def test_vertices_that_are_nowhere_take_their_triangles_with_them(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    (tmp_path / "m.ply").write_bytes(with_vertex(ENCODERS["ply"](roof()), 1e300))
    with caplog.at_level(logging.WARNING):
        assert len(read_still_mesh("m", tmp_path / "m.ply").mesh) == 3
    assert "1 triangles left out" in caplog.text


def test_large_meshes_are_merged_and_larger_ones_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    grid = waves(20, step_m=1.0, high_m=0.0)
    (tmp_path / "m.ply").write_bytes(ENCODERS["ply"](grid))
    monkeypatch.setattr(meshes, "MOST_TRIANGLES", 100)
    with caplog.at_level(logging.WARNING):
        few = read_still_mesh("m", tmp_path / "m.ply").mesh
    assert len(few) <= 100
    assert "722 triangles" in caplog.text
    assert np.abs(few.vertices[:, 2] - 100).max() < 1e-6
    assert few.areas_m2.sum() == pytest.approx(19 * 19, rel=0.02)
    monkeypatch.setattr(meshes, "MOST_READ", 700)
    with pytest.raises(LimitError, match="722 triangles"):
        opened(tmp_path / "m.ply")


def test_merging_far_from_0_loses_no_digits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "m.ply").write_bytes(ENCODERS["ply"](waves(60, step_m=0.05, high_m=0.2)))
    monkeypatch.setattr(meshes, "MOST_TRIANGLES", 800)
    few = read_still_mesh("m", tmp_path / "m.ply").mesh.vertices - UTM
    # 0 about the first vertex; 42 mm where they are merged as far from 0 as the file has them.
    assert np.abs(few[:, 2] - 0.2 * np.sin(4 * few[:, 0])).max() < 1e-3


def test_light_passes_the_tone_curve_as_the_colour_it_stands_for():
    rng = np.random.default_rng(0)
    ends = np.array([(0, 0, 0), (255, 255, 255), (255, 0, 0), (0, 0, 255)])
    rgb = np.concatenate([ends, rng.integers(0, 256, (200, 3))]).astype(np.uint8)
    x = light_shown_as(rgb) / 0.6 @ INPUT.T
    shown = (x * (x + A) - B) / (x * (C * x + D) + E) @ OUTPUT.T
    assert np.abs(shown - linear_light(rgb)).max() < 1e-5


def test_slopes_that_face_the_light_are_brighter_and_photos_are_as_they_are():
    mesh = roof()
    still = StillMesh("m", mesh)
    assert np.array_equal(surface_colours(still, Colouring("photo")), mesh.rgb)
    plain = surface_colours(still, Colouring("plain")).astype(int)
    assert plain[5].sum() > plain[0].sum() + 30  # light comes from the left
    assert still.shade is still.shade  # of a million triangles it takes seconds


@pytest.fixture
def app(tmp_path: Path) -> Iterator[App]:
    (tmp_path / "mesh.ply").write_bytes(ENCODERS["ply"](roof()))
    with App.made(Address(port=0), opened(tmp_path / "mesh.ply")) as made:
        yield made


def look(app: App, **changes: object) -> None:
    app.scene._folders["mesh.ply"].set(**changes)
    app.meshes.redraw()
    assert app.meshes.idle(10)


def test_what_is_sent_is_small_numbers_and_is_changed_in_place(app: App):
    surface = app.meshes._surfaces["mesh.ply"]
    sent = decode_glb(surface.glb_data)
    turned = sent.vertices[:, [0, 1, 2]] - sent.vertices[0]
    assert np.allclose(turned, roof().vertices - roof().vertices[0], atol=1e-6)
    assert np.abs(sent.vertices).max() < 10
    before = surface.glb_data
    look(app, colouring=Colouring("height"))
    assert app.meshes._surfaces["mesh.ply"] is surface
    assert surface.glb_data != before
    controls = app.scene._folders["mesh.ply"]
    controls.show()
    assert controls._bar.visible
    assert controls._ends.value == (100.0, 101.0)
    look(app, edges=True)
    assert not surface.visible
    assert app.meshes._edges["mesh.ply"].visible
    look(app, visible=False)
    assert not app.meshes._edges["mesh.ply"].visible
    look(app, visible=True, edges=False)
    assert surface.visible


def test_other_colours_hold_up_no_frame(app: App, monkeypatch: pytest.MonkeyPatch):
    threads = []

    def colours(still: StillMesh, colouring: Colouring) -> np.ndarray:
        threads.append(threading.current_thread())
        return surface_colours(still, colouring)

    monkeypatch.setattr(drawn_meshes, "surface_colours", colours)
    look(app, colouring=Colouring("range"))
    look(app)  # as with every frame: nothing is coloured anew
    (thread,) = threads
    assert thread is not threading.current_thread()
    app.view.stop()
    assert not thread.is_alive()


def test_a_click_on_a_triangle_tells_the_place_between_its_vertices(app: App):
    origin = app.view.stage.placement.origin_m
    target = np.add(UTM, (1.7, -0.6, 0.7))  # on the slope, at no vertex
    eye = target - origin + (-2, 0.3, 6)
    app.points.click(eye, target - origin - eye)
    assert "450001.70, 5399999.40, 100.70 m" in app.points._text.content
    look(app, visible=False)
    app.points.click(eye, target - origin - eye)
    assert app.points._text.content == "nothing there"


def test_it_is_seen_in_its_own_colours_and_clicked(tmp_path: Path, page: Page):
    (tmp_path / "mesh.ply").write_bytes(ENCODERS["ply"](roof()))
    with App.served(Address(port=0), opened(tmp_path / "mesh.ply")) as served:
        page.goto(served.url)
        page.get_by_text("Wireframe").wait_for(timeout=60_000)
        for _ in range(100):
            seen = pixels_of(screenshot(page, "mesh"))[:, :, ::-1].reshape(-1, 3).astype(int)
            # A red eave, through the tone curve and back.
            if red := np.sum(np.abs(seen - (200, 30, 30)).max(axis=1) < 12):
                break
            page.wait_for_timeout(100)
        assert red > 20
        page.mouse.click(480, 400)
        page.get_by_text("mesh.ply").nth(1).wait_for(timeout=60_000)
    assert "range" in served.points._text.content


def test_it_stands_in_films_and_exported_pages(tmp_path: Path):
    (tmp_path / "mesh.glb").write_bytes(ENCODERS["glb"](roof()))
    for name in ("scene.html", "scene.png"):
        assert main(["view", str(tmp_path / "mesh.glb"), "--export", str(tmp_path / name)]) == 0
    picture = read_image(tmp_path / "scene.png").pixels.reshape(-1, 3).astype(int)
    red, green = (picture[:, a] > picture[:, b] + 60 for a, b in ((0, 1), (1, 0)))
    assert red.sum() > 20_000
    assert green.sum() > 20_000
    film = Film.of(opened(tmp_path / "mesh.glb"), size_px=(64, 36))
    assert film.count == 350
