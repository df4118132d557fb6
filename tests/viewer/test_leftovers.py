"""Connections leave nothing behind, though Python itself looks for it only now and then."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Iterator

import numpy as np
import pytest

from pseudolidar.viewer import leftovers
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.server import GuardedServer, serve
from tests.viewer.clients import cookie, get, look, wait_until

POINTS = 100_000


@pytest.fixture
def tidy(monkeypatch: pytest.MonkeyPatch) -> Iterator[GuardedServer]:
    """A server that frees soon, where Python does not."""
    monkeypatch.setattr(leftovers, "WAIT_S", 0.1)
    gc.disable()
    started = serve(Address(port=0), label="tidy")
    yield started
    started.stop()
    gc.enable()


def test_who_left_in_the_middle_of_a_cloud_holds_it_no_longer(tidy: GuardedServer):
    zeros = np.zeros((POINTS, 3), np.float32)
    handle = tidy.viser.scene.add_point_cloud("/cloud", zeros, zeros.astype(np.uint8))
    deaf = look(tidy)
    live = tidy.viser._websock_server._live_connections
    wait_until(lambda: len(live) == 1)
    gone = weakref.ref(next(iter(live.values())))
    for turn in range(20):
        handle.points = np.full((POINTS, 3), turn, np.float32)
    deaf.socket.close()
    wait_until(lambda: gone() is None)


def test_one_search_does_for_all_who_left_meanwhile(
    tidy: GuardedServer, monkeypatch: pytest.MonkeyPatch
):
    searched = list[None]()
    monkeypatch.setattr(leftovers, "WAIT_S", 1.0)
    monkeypatch.setattr(gc, "collect", lambda: searched.append(None))
    for _ in range(5):
        assert get(tidy, "/", **cookie(tidy)).status == 200
    wait_until(lambda: bool(searched))
    assert len(searched) < 5
