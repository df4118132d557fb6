"""Pictures that browsers are asked for, of browsers that send none, or another one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from websockets.sync.client import ClientConnection

from pseudolidar.errors import CloudEmpty
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.inbound import MOST_PICTURE_PX
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.panels.export import ExportPanel
from tests.viewer.clients import looking, wait_until
from tests.viewer.test_filming import Frames
from tests.viewer.test_inbound import CAMERA

# More than viser has threads for what browsers press, and than may come at once.
PRESSES = 40


@pytest.fixture
def app() -> Iterator[App]:
    with App.made(Address(port=0), Opened()) as made:
        yield made


def uuid_of(app: App, label: str) -> str:
    handles = app.view.gui._gui_input_handle_from_uuid
    (found,) = [u for u, one in handles.items() if getattr(one._impl.props, "label", "") == label]
    return found


def send(client: ClientConnection, uuid: str, *, value: bool) -> None:
    message = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}}
    client.send(msgspec.msgpack.encode(message))


def test_who_asks_for_many_pictures_holds_up_nobody(app: App):
    picture, axes = uuid_of(app, "This view as PNG"), uuid_of(app, "Axes")
    with looking(app.view.server) as one, looking(app.view.server) as other:
        for client in (one, other):
            client.send(msgspec.msgpack.encode(CAMERA))
        wait_until(lambda: len(app.view.server.viser.get_clients()) == 2)
        for _ in range(PRESSES):
            send(one, picture, value=True)
        wait_until(lambda: bool(app.export._asked))
        send(other, axes, value=False)
        wait_until(lambda: not app.view.stage._rig.show_axes)
        assert len(app.export._asked) == 1
    wait_until(lambda: not app.export._asked)  # both are gone: the next picture may be asked for


def browser(height: int, width: int, pixels: np.ndarray) -> SimpleNamespace:
    """What asks for its picture, and what it sends."""
    sent = list[bytes]()
    asked = list[tuple[int, int]]()

    def get_render(height: int, width: int, **_: object) -> np.ndarray:
        asked.append((height, width))
        return pixels

    return SimpleNamespace(
        client_id=0,
        camera=SimpleNamespace(image_height=height, image_width=width),
        get_render=get_render,
        send_file_download=lambda _name, data, **_: sent.append(data),
        asked=asked,
        sent=sent,
    )


@pytest.mark.parametrize(
    ("shape", "dtype", "sent"),
    [
        ((4, 6, 4), np.uint8, 1),
        ((4, 6, 3), np.uint8, 0),
        ((4, 6), np.uint8, 0),
        ((6, 4, 4), np.uint8, 0),
        ((4, 6, 4), np.uint16, 0),
    ],
)
def test_a_picture_of_another_kind_is_none(
    app: App, shape: tuple[int, ...], dtype: type, sent: int
):
    panel: ExportPanel = app.export
    client = browser(4, 6, np.zeros(shape, dtype))
    panel._send_picture(SimpleNamespace(client=client))
    assert len(client.sent) == sent
    assert ("sends no picture" in panel._told.content) == (not sent)
    assert not panel._asked


def test_of_larger_pages_a_smaller_picture_is_asked_for(app: App):
    for height, width in ((4320, 7680), (65_535, 65_535), (0, 0)):
        client = browser(height, width, np.zeros((1, 1, 4), np.uint8))
        app.export._send_picture(SimpleNamespace(client=client))
        ((asked_height, asked_width),) = client.asked
        assert asked_height * asked_width <= MOST_PICTURE_PX
        assert asked_height * width == pytest.approx(asked_width * height, rel=1e-3)


def test_a_film_is_of_frames_as_they_are_shown_and_ends_with_the_page():
    with App.made(Address(port=0), Opened((Frames(),))) as app:
        app.view.finishing["any"] = lambda moment: replace(moment, clouds={}, fault="none wanted")
        with pytest.raises(CloudEmpty, match="none wanted"):
            list(app.export._film_of_shown().shots)
    assert not app.export._maker.ask()
