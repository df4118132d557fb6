"""Large clouds as files: all of their points, and those that a browser has before it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pseudolidar.formats.points.cloud_file import read_cloud
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.drawn_octrees import Looker
from pseudolidar.viewer.octree.build import built
from pseudolidar.viewer.octree.pieces import PIECE_POINTS, in_pieces, near
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.panels import large_export
from pseudolidar.viewer.stills import StillOctree
from tests.viewer.clients import cookie, get

COUNT = 230_000
UTM_M = np.array([4.5e5, 5.4e6, 110.0])
NAME = "town <b>.ply"


def town() -> PointCloud:
    rng = np.random.default_rng(5)
    return PointCloud(
        rng.uniform((-90, -90, 0), (90, 90, 1), (COUNT, 3)).astype(np.float32),
        "map",
        rgb=rng.integers(0, 255, (COUNT, 3), dtype=np.uint8),
        sigma_m=rng.uniform(0, 1, COUNT).astype(np.float32),
        extra={"time": np.arange(COUNT, dtype=np.float32)},
    )


def shifted(cloud: PointCloud, by_m: np.ndarray) -> PointCloud:
    return replace(cloud, xyz=cloud.xyz.astype(np.float64) + by_m)


@pytest.fixture(scope="module")
def app() -> Iterator[App]:
    stills = (
        StillOctree(NAME, built(town())),
        StillOctree("utm.ply", built(shifted(town(), UTM_M))),
    )
    with App.made(Address(port=0), Opened((), stills)) as made:
        made.large_export._show(made.view.made(0))
        yield made


def fetched(app: App, query: str, path: Path) -> PointCloud:
    answer = get(app.view.server, f"/export/large?{query}", **cookie(app.view.server))
    body = answer.read()
    assert int(answer.getheader("Content-Length") or 0) == len(body)
    path.write_bytes(body)
    return read_cloud(path)


@pytest.mark.parametrize("kind", ["ply", "pcd"])
def test_all_points_of_a_cloud_are_in_its_file(app: App, tmp_path: Path, kind: str):
    found = fetched(app, f"name=town+%3Cb%3E.ply&kind={kind}", tmp_path / f"a.{kind}")
    cloud = town()
    assert found.frame == "map"
    assert found.xyz.dtype == np.float32
    order = np.argsort(found.extra["time"])
    assert np.array_equal(found.extra["time"][order], cloud.extra["time"])
    assert np.abs(found.xyz[order] - cloud.xyz).max() < 1e-4
    assert np.array_equal(found.rgb[order], cloud.rgb)
    assert np.array_equal(found.sigma_m[order], cloud.sigma_m)


def test_far_from_the_origin_places_keep_their_digits(app: App, tmp_path: Path):
    found = fetched(app, "name=utm.ply&kind=ply", tmp_path / "utm.ply")
    assert found.xyz.dtype == np.float64
    cloud = shifted(town(), UTM_M)
    order = np.argsort(found.extra["time"])
    assert np.abs(found.xyz[order] - cloud.xyz).max() < 1e-3


@pytest.mark.parametrize(
    "query", ["", "name=utm.ply", "name=utm.ply&kind=las", "name=../x&kind=ply", "kind=ply"]
)
def test_what_there_is_not_is_not_found(app: App, query: str):
    server = app.view.server
    assert get(server, f"/export/large?{query}", **cookie(server)).status == 404


def test_the_page_has_links_and_their_names_are_text(app: App):
    content = app.large_export._links.content
    assert f"all {COUNT:,} points" in content
    assert "<b>" not in content
    assert content.count("<a ") == 4


def browser(app: App) -> SimpleNamespace:
    """One that looks down on a corner of the town, and draws nothing fine."""
    sent: dict[str, bytes] = {}
    camera = SimpleNamespace(
        wxyz=(0.0, 1.0, 0.0, 0.0), position=(-60.0, -60.0, 40.0), fov=1.0,
        image_width=640, image_height=480,
    )  # fmt: skip
    client = SimpleNamespace(
        client_id=7,
        camera=camera,
        send_file_download=lambda name, data, **_: sent.__setitem__(name, data),
        sent=sent,
    )
    app.octrees._browsers.lookers[7] = Looker(client)  # type: ignore
    return client


def test_what_a_browser_sees_is_sent_to_it(
    app: App, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(app.octrees, "has_room", lambda _client: True)
    client = browser(app)
    app.large_export._send(client, "ply")
    assert set(client.sent) == {"town_b__seen.ply", "utm_seen.ply"}
    path = tmp_path / "seen.ply"
    path.write_bytes(client.sent["town_b__seen.ply"])
    seen = read_cloud(path)
    placed = seen.xyz - app.view.stage.placement.origin_m
    half_m = 40 * np.tan(0.5) * np.array([640 / 480, 1.0])
    assert (np.abs(placed[:, :2] + 60) <= half_m + 1).all()
    assert 0 < len(seen) < COUNT
    assert f"{len(seen):,} points" in app.large_export._told.content

    monkeypatch.setattr(large_export, "MOST_SEEN", 100)
    app.large_export._send(client, "pcd")
    assert b"POINTS 100\n" in client.sent["town_b__seen.pcd"]
    assert "100 of" in app.large_export._told.content


def test_who_has_not_taken_the_last_one_is_sent_no_more(app: App, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(app.octrees, "has_room", lambda _client: False)
    client = browser(app)
    app.large_export._send(client, "ply")
    app.large_export._send(None, "ply")
    assert not client.sent
    assert "not taken" in app.large_export._told.content


def test_pieces_hold_every_point_once_and_are_small():
    tree = built(town())
    pieces = list(in_pieces(tree))
    assert sum(map(len, pieces)) == COUNT
    assert max(map(len, pieces)) < 3 * PIECE_POINTS
    assert len(list(in_pieces(tree, np.array([0])))) == 1


def test_points_near_a_place_are_whole_where_they_fit():
    cloud, tree = town(), built(town())
    place = np.array([30.0, -20.0, 0.5])
    inside = np.linalg.norm(cloud.xyz - place, axis=1) < 15
    found = near(tree, place, 15.0, most=COUNT)
    got = np.linalg.norm(found.cloud.xyz - place, axis=1) < 15
    assert got.sum() == inside.sum()
    assert found.there == len(found.cloud) < COUNT
    fewer = near(tree, None, 0.0, most=100_000)
    assert len(fewer.cloud) <= 100_000
    assert fewer.there == COUNT
