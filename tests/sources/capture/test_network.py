"""Cameras behind a network address: a real server in a process of its own, which is killed."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pseudolidar.errors import CameraLost, CameraStalled, CameraUnavailable
from pseudolidar.formats.video.pixels import to_pixels
from pseudolidar.sources.capture.cameras import Cameras, CameraSettings
from tests.cameras import eyes, number_of, write_eyes
from tests.sources.capture.test_cameras import drained
from tests.sources.capture.test_pair_buffer import adds_up

LEFT, RIGHT = eyes(12)
# Sends the first half of a file, and no end: as a camera does that goes on.
SERVER = """
import http.server, pathlib, sys, threading
folder, port = pathlib.Path(sys.argv[1]), int(sys.argv[2])
class Camera(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        data = (folder / self.path[1:]).read_bytes()
        self.send_response(200)
        self.end_headers()
        self.wfile.write(data[: len(data) // 2])
        self.wfile.flush()
        threading.Event().wait()
server = http.server.ThreadingHTTPServer(("127.0.0.1", port), Camera)
print(server.server_port, flush=True)
server.serve_forever()
"""


@pytest.fixture(scope="module")
def videos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("videos")
    write_eyes(folder, LEFT, RIGHT)
    return folder


@contextlib.contextmanager
def server(folder: Path, port: int = 0) -> Iterator[int]:
    """Its port; killed at the end."""
    process = subprocess.Popen(
        [sys.executable, "-c", SERVER, str(folder), str(port)], stdout=subprocess.PIPE, text=True
    )
    try:
        yield int(process.stdout.readline())
    finally:
        process.kill()
        process.communicate()


def cameras(port: int, patience_s: float) -> Cameras:
    settings = CameraSettings(patience_s=patience_s, clock="stream", kept=100)
    left, right = (f"http://127.0.0.1:{port}/{eye}.mkv" for eye in ("left", "right"))
    return Cameras(left, right, settings=settings)


def wait_for(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    deadline_s = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.02)


def test_a_server_that_dies_and_comes_back(videos: Path) -> None:
    with contextlib.ExitStack() as opened:
        with server(videos) as port:
            capture = opened.enter_context(cameras(port, 60.0).open())  # `begin` would forget
            pair = capture.take()
            left, right = (to_pixels(shot.picture, rotated=False) for shot in pair.shots)
            assert number_of(left.pixels, LEFT) == number_of(right.pixels, RIGHT)
        wait_for(lambda: all(eye.fault for eye in capture.counts.eyes))
        before = [eye.arrived for eye in capture.counts.eyes]

        def both_are_back() -> bool:
            return all(
                eye.reopened == 1 and eye.arrived > count and not eye.fault
                for eye, count in zip(capture.counts.eyes, before, strict=True)
            )

        with server(videos, port):
            wait_for(both_are_back)


def test_a_server_that_is_gone_ends_the_capture_and_what_came_is_whole(videos: Path) -> None:
    with contextlib.ExitStack() as opened:
        with server(videos) as port:
            capture = opened.enter_context(cameras(port, 3.0).open())
            capture.seen()
            wait_for(lambda: capture.counts.formed > 2)
        found, error = drained(capture)
    assert isinstance(error, CameraLost | CameraUnavailable | CameraStalled)
    assert error.exit_code == 5
    assert f"127.0.0.1:{port}" in str(error)
    assert len(found) > 2
    assert adds_up(capture.counts)
