"""The guard before a page that has everything: each control, each page of our own, one by one."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from pseudolidar.pipelines.view import View, means_of

from pseudolidar.obstacles.corridor import Corridor
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.boxes.region import Region
from pseudolidar.viewer.checks import LARGEST, TEXT_LENGTH
from pseudolidar.viewer.drawn_region import FARTHEST_M, DrawnRegion
from pseudolidar.viewer.inbound import Control
from pseudolidar.viewer.octree.build import built
from pseudolidar.viewer.on_page import OnPage
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.stills import StillCloud, StillOctree, StillPath
from tests.viewer.clients import CAMERA, cookie, get, looking, wait_until

# Kinds of controls that there are, each of which was thought about here.
KINDS = {
    "GuiButtonProps", "GuiButtonGroupProps", "GuiCheckboxProps", "GuiDropdownProps",
    "GuiMultiSliderProps", "GuiNumberProps", "GuiSliderProps", "GuiTextProps",
    "GuiVector2Props", "GuiVector3Props",
}  # fmt: skip
# Controls whose numbers have no bounds: ends of scales may be anything.
UNBOUNDED = {"Blue, red", "Blue, red, m"}
# What is no value of any control.
WRONG: list[Any] = [
    None, b"", b"x", [], {}, [[]], {"value": 1}, float("nan"), float("inf"), -float("inf"), 1e300,
    10**400, "x" * (TEXT_LENGTH + 1), ["x"], [None], [float("nan")] * 2, [float("nan")] * 3,
    [1] * 9,
]  # fmt: skip


@pytest.fixture(scope="module")
def app() -> Iterator[App]:
    """Pairs with truth, scans and labels, a map, a large map, a path, a corridor."""
    job = View(corridor=Corridor.parse("2x2x30"))
    reel = job.reel_of(Synthetic("street", frames=2, width_px=256))
    xyz = np.random.default_rng(1).uniform((0, -9, 0), (9, 9, 2), (60_000, 3))
    stills = (
        StillCloud("a.ply", PointCloud(xyz[:500], "map")),
        StillOctree("large.ply", built(PointCloud(xyz, "map"))),
        StillPath("path.tum", xyz[:9]),
    )
    opened = Opened((reel,), stills)
    with App.made(Address(port=0), opened, means_of(job, opened)) as made:
        made.view.show(made.view.made(0))
        yield made


@pytest.fixture(scope="module")
def on_page(app: App) -> OnPage:
    found = OnPage()
    found.viser = app.view.server.viser
    return found


def handles(app: App) -> dict[str, Any]:
    """All controls; bars of progress are none, though viser has them among these."""
    every = dict(app.view.gui._gui_input_handle_from_uuid)
    bars = {uuid for uuid, one in every.items() if type(one).__name__ == "GuiProgressBarHandle"}
    assert bars
    return {uuid: one for uuid, one in every.items() if uuid not in bars}


def shown(app: App, on_page: OnPage) -> dict[str, tuple[Any, Control]]:
    """Controls as if all of them were shown and could be turned."""
    found = {}
    for uuid, handle in handles(app).items():
        control = on_page.control(uuid)
        if control is None:
            seen = SimpleNamespace(
                disabled=False, visible=True, value=handle.value,
                _impl=SimpleNamespace(props=handle._impl.props, parent_container_id="root"),
            )  # fmt: skip
            gui = SimpleNamespace(
                _gui_input_handle_from_uuid={uuid: seen}, _container_handle_from_uuid={}
            )
            other = OnPage()
            other.viser = SimpleNamespace(gui=gui)  # type: ignore[assignment]
            control = other.control(uuid)
        assert control is not None
        found[uuid] = handle, control
    return found


def test_every_tab_and_every_kind_of_control_is_there(app: App):
    labels = {getattr(handle._impl.props, "label", "") for handle in handles(app).values()}
    assert {"Frame", "Detector", "penalty large", "Against", "Words at", "Millions drawn"} <= labels
    assert {type(handle._impl.props).__name__ for handle in handles(app).values()} == KINDS


def test_no_control_takes_what_it_could_not_send(app: App, on_page: OnPage):
    for handle, control in shown(app, on_page).values():
        label = getattr(handle._impl.props, "label", "")
        assert control.takes(handle.value), label
        for value in (*WRONG, *beside(control)):
            assert not control.takes(value), (label, value)


def beside(control: Control) -> list[Any]:
    """Values of the right kind that a control does not have."""
    value = control.value
    if isinstance(value, bool):
        return [0, 1, "true", 0.0]
    if isinstance(value, str):
        assert all(control.takes(option) for option in control.options or ())
        if control.options is None:
            return [3, True]
        return [f"{control.options[0]} ", control.options[0].upper() + "x", "\0", 0]
    if isinstance(value, int | float):
        low, high = ends(control.least, -LARGEST), ends(control.most, LARGEST)
        assert control.takes(low)
        assert control.takes(high)
        return [low - 1, high + 1, str(value), True, [value]]
    found: list[Any] = [value[:-1], (*value, value[-1]), "x" * len(value)]
    for place in range(len(value)):
        low = ends(control.least, -LARGEST, place)
        high = ends(control.most, LARGEST, place)
        for wrong in (low - 1e-3 * LARGEST, high + 1e-3 * LARGEST, "1", True, None, float("nan")):
            found.append((*value[:place], wrong, *value[place + 1 :]))
    if control.rising:
        assert isinstance(control.least, int | float)
        assert isinstance(control.most, int | float)
        found.append((control.most, control.least))
    return found


def ends(bound: Any, none: float, place: int = 0) -> float:
    if bound is None:
        return none
    return float(bound[place] if isinstance(bound, tuple) else bound)


def test_every_number_has_bounds(app: App, on_page: OnPage):
    loose = {
        handle._impl.props.label
        for handle, control in shown(app, on_page).values()
        if not isinstance(control.value, bool | str)
        and (control.least is None or control.most is None)
    }
    assert loose == UNBOUNDED


def test_what_is_not_seen_cannot_be_turned(app: App, on_page: OnPage):
    seen = [uuid for uuid in app.view.gui._gui_input_handle_from_uuid if on_page.control(uuid)]
    assert set(seen) < set(handles(app))
    for uuid, handle in handles(app).items():
        if not handle.visible or handle.disabled:
            assert uuid not in seen
    assert 40 < len(seen) < len(handles(app))
    by_range = app.tune._by_range  # a folder
    with by_range:
        inner = app.view.gui.add_checkbox("inner", initial_value=False)
    by_range.visible = False
    assert on_page.control(inner._impl.uuid) is None
    by_range.visible = True
    assert on_page.control(inner._impl.uuid) is not None
    inner.remove()
    assert on_page.control(inner._impl.uuid) is None


def test_handles_of_boxes_go_no_farther_than_they_may(app: App, on_page: OnPage):
    assert on_page.handle("/map/rig") is None
    assert on_page.handle("/map/handles") is None  # no box, no handles
    region = Region(np.eye(4), np.ones(3))
    moved = list[np.ndarray]()
    drawn = DrawnRegion(app.view.server.viser.scene, moved.append)
    drawn.show(region, handles=True)
    handle = on_page.handle("/map/handles")
    assert handle is not None
    assert handle.takes((1.0, 2.0, -3.0))
    for place in range(3):
        assert not handle.takes(tuple(np.eye(3)[place] * 1.001 * FARTHEST_M))
    turned = {"wxyz": [1.0, 0.0, 0.0, 0.0], "owner": ""}
    with looking(app.view.server) as client:
        client.send(msgspec.msgpack.encode(CAMERA))
        for place in ([2 * FARTHEST_M, 0.0, 0.0], [1.0, 2.0, 3.0]):
            message = {"type": "TransformControlsUpdateMessage", "name": "/map/handles"}
            client.send(msgspec.msgpack.encode(message | turned | {"position": place}))
        wait_until(lambda: bool(moved))
    assert [tuple(T[:3, 3]) for T in moved] == [(1.0, 2.0, 3.0)]
    drawn.show(region, handles=False)
    assert on_page.handle("/map/handles") is None


HOSTILE = (
    "", "name=", "name=a.ply", "name=../../etc/passwd&kind=ply", "name=a.ply&kind=../../x",
    "name=%ff%fe&kind=%00", "x=1e999&y=-1e999", "x=nan&y=nan&mark=1", "x=&y=",
    "left=9&top=9&right=1&bottom=1", "left=nan&top=0&right=1&bottom=1", "key=%3Cb%3E",
    "kind=nothing", "a=" + "x" * 3000, "&".join(f"a{n}=1" for n in range(40)), "kind[]=left",
    "kind=left&kind=nothing", "%", "=", "&&&",
)  # fmt: skip


def test_pages_answer_whatever_they_are_asked(app: App):
    server = app.view.server
    pages = sorted(server.pages)
    assert {"/picture", "/picture/view", "/obstacles/state", "/export/large"} <= set(pages)
    for page in pages:
        assert get(server, page).status == 403
        assert get(server, page, **cookie(server), **{"Sec-Fetch-Site": "cross-site"}).status == 403
        for path in (f"{page}/", f"{page}/../../x", page.upper(), f"/{page}"):
            assert get(server, path, **cookie(server)).status == 404
        for query in HOSTILE if page != "/export/scene" else HOSTILE[:1]:
            answer = get(server, f"{page}?{query}", **cookie(server))
            assert answer.status in (200, 400, 404), (page, query)
            assert answer.getheader("X-Content-Type-Options") == "nosniff"
            answer.read()
