"""Somebody at a page: a client that reads what viser's page reads, and turns its controls."""

from __future__ import annotations

import http.client
import logging
import socket
import struct
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

import msgspec
import viser
import zstandard
from websockets.sync.client import ClientConnection, connect

from tests.viewer.clients import CAMERA

# The page asks for what it shows by this name of its protocol.
SPOKEN = f"viser-v{viser.__version__}"
PATIENCE_S = 30.0


def messages_of(raw: bytes) -> list[dict[str, Any]]:
    """What viser sends: MessagePack packed by zstd, and arrays behind it, which are left out."""
    whole, packed = struct.unpack("<QQ", raw[:16])
    inner = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + packed], max_output_size=whole)
    decoded = msgspec.msgpack.decode(inner, strict=False)
    return list(decoded["messages"])


def cookie_of(url: str) -> str:
    """What the printed address is exchanged for."""
    parts = urlsplit(url)
    asking = http.client.HTTPConnection(parts.netloc, timeout=PATIENCE_S)
    asking.request("GET", f"/?{parts.query}")
    answer = asking.getresponse()
    assert answer.status == 200
    answer.read()
    asking.close()
    given = answer.getheader("Set-Cookie")
    assert given is not None
    return given.partition(";")[0]


def _quiet() -> logging.Logger:
    """Says nothing of a network that is gone."""
    logger = logging.getLogger(f"{__name__}.connections")
    logger.setLevel(logging.CRITICAL + 1)
    return logger


@dataclass
class Visitor:
    """A websocket and what is known by it.

    Args:
        url: that was printed.
        cookie: that it was exchanged for.
    """

    url: str
    cookie: str
    controls: dict[str, dict[str, Any]] = field(default_factory=dict)
    # How many times the points of a cloud came, by the name of its node.
    drawn: dict[str, int] = field(default_factory=dict)
    read_bytes: int = 0

    def __post_init__(self) -> None:
        self.place = urlsplit(self.url).netloc
        self.socket = self._connected()

    def _connected(self) -> ClientConnection:
        headers = {"Cookie": self.cookie, "Origin": f"http://{self.place}"}
        return connect(
            f"ws://{self.place}",
            additional_headers=headers,
            subprotocols=[SPOKEN],  # type: ignore[list-item]
            compression=None,
            max_size=None,
            max_queue=1,
            ping_interval=None,  # who stalls does not answer itself either
            close_timeout=1,
            logger=_quiet(),
        )

    def read(self, timeout_s: float | None = None) -> list[dict[str, Any]]:
        """The next messages, and note what they tell."""
        raw = self.socket.recv(timeout=timeout_s)
        assert isinstance(raw, bytes)
        self.read_bytes += len(raw)
        found = messages_of(raw)
        for message in found:
            self._note(message)
        return found

    def _note(self, message: dict[str, Any]) -> None:
        kind, uuid = message["type"], message.get("uuid", "")
        if kind == "GuiUpdateMessage" and uuid in self.controls:
            self.controls[uuid].update(message["updates"])
        elif kind == "GuiRemoveMessage":
            self.controls.pop(uuid, None)
        elif kind.startswith("Gui") and isinstance(message.get("props"), dict):
            self.controls[uuid] = {**message["props"], "value": message.get("value"), "kind": kind}
        elif kind == "PointCloudMessage" or (
            kind == "SceneNodeUpdateMessage" and "points" in message["updates"]
        ):
            name = message["name"]
            self.drawn[name] = self.drawn.get(name, 0) + 1

    def those(self, label: str) -> list[tuple[str, dict[str, Any]]]:
        """Controls of that label that may be turned, each with its identity."""
        found = list(self.controls.items())
        return [
            (uuid, one)
            for uuid, one in found
            if one.get("label") == label and one.get("visible", True) and not one.get("disabled")
        ]

    def send(self, message: dict[str, Any]) -> None:
        """Say something."""
        self.socket.send(msgspec.msgpack.encode(message))

    def turn(self, label: str, value: Any) -> int:
        """Set every control of that label; how many there are."""
        turned = self.those(label)
        for uuid, control in turned:
            if value in control.get("options", (value,)):
                control["value"] = value
                self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})
        return len(turned)

    def press(self, option: str) -> None:
        """Press that button of a group."""
        for uuid, control in list(self.controls.items()):
            if control["kind"] == "GuiButtonGroupMessage" and option in control["options"]:
                self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": option}})

    def look(self, position: tuple[float, float, float]) -> None:
        """Look from there."""
        self.send(CAMERA | {"position": list(position)})

    def click(self, direction: tuple[float, float, float]) -> None:
        """Click at what is seen from the middle of the scene."""
        self.send(
            {
                "type": "ScenePointerMessage",
                "event_type": "click",
                "ray_origin": [0.0, 0.0, 1.0],
                "ray_direction": list(direction),
                "screen_pos": [[0.5, 0.5]],
                "modifier": None,
            }
        )

    def fetch(self, target: str) -> bytes:
        """A page of our own; empty where it is refused."""
        asking = http.client.HTTPConnection(self.place, timeout=PATIENCE_S)
        asking.request("GET", target, headers={"Cookie": self.cookie})
        answer = asking.getresponse()
        body = answer.read()
        asking.close()
        return body if answer.status == 200 else b""

    def leave(self, *, rudely: bool = False) -> None:
        """Go away: with words, or as a browser whose network is gone."""
        if not rudely:
            self.socket.close()
            return
        with suppress(OSError):
            self.socket.socket.shutdown(socket.SHUT_RDWR)
        self.socket.socket.close()

    def come_back(self) -> None:
        """Connect again, knowing nothing."""
        self.controls.clear()
        self.socket = self._connected()
