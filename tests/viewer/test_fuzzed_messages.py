"""Ten thousand messages of no browser: what passes is right, and nothing breaks."""

from __future__ import annotations

import asyncio
import gc
import logging
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from viser._messages import Message
from websockets.exceptions import ConnectionClosed, ConnectionClosedOK, InvalidStatus

from pseudolidar.viewer.checks import PNG_START
from pseudolidar.viewer.inbound import Control
from pseudolidar.viewer.listener import MOST_FAULTS, Listener
from pseudolidar.viewer.server import GuardedServer
from tests.viewer.clients import CAMERA, cookie, get, look, looking, wait_until

COUNT, SENT = 10_000, 1000
# A server listens to no more than eight wrong ones.
AT_ONCE = 12
POSE = {"wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.0, 0.0, 1.0]}
RAY = {"ray_origin": [0.0, 0.0, 0.0], "ray_direction": [1.0, 0.0, 0.0], "modifier": None}
VALID: list[dict[str, Any]] = [
    CAMERA,
    {"type": "ScenePointerMessage", "event_type": "click", "screen_pos": [[0.5, 0.5]]} | RAY,
    {"type": "TransformControlsUpdateMessage", "name": "/a", "owner": ""} | POSE,
    {"type": "CommandTriggerMessage", "uuid": "c"},
    {
        "type": "GetRenderResponseMessage",
        "payload": PNG_START + bytes((0, 0, 3, 32, 0, 0, 2, 88)),  # 800 x 600
        "render_uuid": "r",
    },
]
CONTROLS: dict[str, tuple[Any, Control]] = {
    "slider": (3, Control(5, 0, 10)),
    "vector": ([0.5, 0.5], Control((0.0, 1.0), (0.0, 0.0), (1.0, 2.0))),
    "colour": ([1, 2, 3], Control((0, 0, 0), 0, 255)),
    "choice": ("b", Control("a", options=("a", "b"))),
    "text": ("b", Control("a")),
    "check": (False, Control(True)),
}
PIECES: list[Any] = [
    None, True, -1, 2**63, 1e300, float("nan"), float("inf"), "", "a" * 9999, "\x00", b"", [], {},
    [[[[]]]], {1: 2}, {"value": {"value": []}}, "/../../etc", "<script>", [1, 2, 3, 4], -0.0,
]  # fmt: skip
BOMBS = [
    b"\x91" * 60_000,
    b"\xdd\xff\xff\xff\xff",
    b"\xdf\xff\xff\xff\xff",
    b"\xc6\xff\xff\xff\xff",
    b"\xdc\xff\xff" + b"\x90" * 65_535,
    b"\xde\xff\xff" + b"\x00\xc0" * 30_000,
    b"\xc9\x00\xff\xff\xff\x01" + b"x" * 60_000,
]


def mangled(rng: np.random.Generator, updates: list[dict[str, Any]]) -> bytes:
    """A message that was right once, in its fields or in its bytes; or noise; or a bomb."""
    messages = VALID + updates
    message = dict(messages[rng.integers(len(messages))])
    way = rng.integers(40)
    if way < 4:
        return rng.bytes(int(rng.integers(200)))
    if way == 4:
        return BOMBS[rng.integers(len(BOMBS))]
    if way < 24:
        key = list(message)[rng.integers(len(message))]
        if key == "updates" and rng.random() < 0.5:
            message[key] = {"value": PIECES[rng.integers(len(PIECES))]}
        else:
            message[key] = PIECES[rng.integers(len(PIECES))]
        return msgspec.msgpack.encode(message)
    data = bytearray(msgspec.msgpack.encode(message))
    for _ in range(rng.integers(1, 4)):
        data[rng.integers(len(data))] = rng.integers(256)
    cut = int(rng.integers(len(data))) if rng.random() < 0.2 else len(data)
    return bytes(data[:cut])


def updates_of(uuids: dict[str, str]) -> list[dict[str, Any]]:
    return [
        {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": CONTROLS[name][0]}}
        for name, uuid in uuids.items()
    ]


class Said:
    """A connection that has said it all already, and is closed where it is told so."""

    def __init__(self, messages: Iterator[bytes]) -> None:
        self._messages, self.is_open = messages, True
        self.transport = SimpleNamespace(abort=lambda: None)

    async def recv(self) -> bytes:
        if not self.is_open:
            raise ConnectionClosedOK(None, None)
        try:
            return next(self._messages)
        except StopIteration:
            raise EOFError from None

    async def close(self, *_why: object) -> None:
        self.is_open = False

    async def wait_closed(self) -> None:
        """At once: nothing here waits."""


def test_ten_thousand_messages(caplog: pytest.LogCaptureFixture):
    rng = np.random.default_rng(8)
    updates = updates_of({name: name for name in CONTROLS})
    controls = {name: control for name, (_, control) in CONTROLS.items()}
    place = Control((0.0, 0.0, 0.0))
    touchable = SimpleNamespace(control=controls.get, handle={"/a": place}.get)
    messages = (mangled(rng, updates) for _ in range(COUNT))
    passed, sent_away = list[bytes](), 0

    async def listen() -> None:
        nonlocal sent_away
        while True:
            said = Said(messages)
            listener = Listener(said, touchable, lambda: 1)  # type: ignore[arg-type]
            with suppress(ConnectionClosed):
                while True:
                    passed.append(await listener.recv())
            sent_away += 1

    # In a thread: a browser of other tests has its loop in this one.
    with caplog.at_level(logging.CRITICAL), ThreadPoolExecutor(1) as thread:
        ended = thread.submit(asyncio.run, listen())
    assert isinstance(ended.exception(), EOFError)
    assert sent_away > COUNT / 2 / (MOST_FAULTS + 2)
    # What a byte or two changed may still be right: another number, another text.
    assert 100 < len(passed) < COUNT / 4
    for raw in passed:
        message = Message.deserialize(raw)  # of viser: raises where it is no message of its own
        kinds = {"uuid": getattr(message, "uuid", "")}
        if type(message).__name__ == "GuiUpdateMessage":
            value = message.updates["value"]  # type: ignore[attr-defined]
            assert controls[kinds["uuid"]].takes(value)


def test_a_server_that_hears_a_thousand_of_them(
    server: GuardedServer, caplog: pytest.LogCaptureFixture
):
    gui, rng = server.viser.gui, np.random.default_rng(9)
    controls = {
        "slider": gui.add_slider("s", min=0, max=10, step=1, initial_value=5),
        "vector": gui.add_vector2("v", (0.0, 1.0), min=(0.0, 0.0), max=(1.0, 2.0)),
        "colour": gui.add_rgb("c", (0, 0, 0)),
        "choice": gui.add_dropdown("d", ("a", "b"), initial_value="a"),
        "text": gui.add_text("t", "a"),
        "check": gui.add_checkbox("b", initial_value=True),
    }
    server.viser.scene.on_click()(lambda event: None)
    updates = updates_of({name: handle._impl.uuid for name, handle in controls.items()})
    with caplog.at_level(logging.ERROR):
        for _ in range(SENT // AT_ONCE):
            with looking(server) as client, suppress(ConnectionClosed):
                client.send(msgspec.msgpack.encode(VALID[0]))
                for _ in range(AT_ONCE):
                    client.send(mangled(rng, updates))
        wait_until(lambda: not server.viser._websock_server._live_connections)
        gc.collect()  # tasks that failed tell so when they are gone
    assert get(server, "/", **cookie(server)).status == 200
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR]
    for name, (_, control) in CONTROLS.items():
        assert control.takes(controls[name].value)
    assert type(controls["vector"].value) is tuple
    with pytest.raises(InvalidStatus):
        look(server, Cookie="")
