"""How soon and how fast a sequence of 1,000 clouds of 120,000 points is shown, and what it holds.

    python -m tests.benchmarks.viewer_rate [--seconds 20] [--source PATH] [--browser]

Folders as `convert` writes them (npz, pcd), and one of Velodyne scans (bin), are made, then served
by `pseudolidar view` in a process of its own, and read by one client that takes all. Told are
seconds and processor time from the start of the process to the first cloud at the client, beside
what an interpreter takes that only imports viser and numpy; frames a second that arrive at the
speed they were taken at (10 Hz), and as fast as it goes (10x), with the processor time of one;
memory (PSS) at 10 Hz, and after a whole turn. With --source another source is played, such as
pairs, which are matched first; with --browser a Chromium looks on, and it is told how often that
draws.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np

from pseudolidar.formats.points.npz import write_npz
from pseudolidar.formats.points.pcd import write_pcd
from pseudolidar.formats.points.velodyne_bin import write_velodyne_bin
from pseudolidar.structures.cloud import PointCloud
from tests.viewer.conftest import started_browser
from tests.viewer.served import Served, served
from tests.viewer.visitor import Visitor, cookie_of

FRAMES, POINTS, DIFFERENT = 1000, 120_000, 8
WRITERS: dict[str, Callable[[Path, PointCloud], None]] = {
    "npz": write_npz,
    "pcd": write_pcd,
    "bin": write_velodyne_bin,
}
SETTLE_S, PATIENCE_S = 5.0, 600.0
IMPORTS = "import numpy, viser"
# How many pictures a page draws in so many ms.
DRAWN = """wait_ms => new Promise(told => {
    let count = 0;
    const end = performance.now() + wait_ms;
    const draw = now => now < end ? (count++, requestAnimationFrame(draw)) : told(count);
    requestAnimationFrame(draw);
})"""


def cloud(seed: int) -> PointCloud:
    """A street: ground and two walls, in the order of pixels."""
    rng = np.random.default_rng(seed)
    far_m = rng.uniform(4, 60, POINTS)
    side = rng.integers(-1, 2, POINTS)
    y = np.where(side == 0, rng.uniform(-8, 8, POINTS), 8.0 * side)
    z = np.where(side == 0, -1.7, rng.uniform(-1.7, 4, POINTS)) + rng.normal(0, 0.02, POINTS)
    uv = np.stack([700 - 700 * y / far_m, 180 - 700 * z / far_m], axis=1)
    order = np.lexsort((uv[:, 0], uv[:, 1].astype(int)))
    return PointCloud(
        np.stack([far_m, y, z], axis=1).astype(np.float32)[order],
        "velodyne",
        rgb=rng.integers(0, 255, (POINTS, 3)).astype(np.uint8),
        sigma_m=(1e-3 * far_m**2).astype(np.float32)[order],
        intensity=rng.uniform(0, 1, POINTS).astype(np.float32),
    )


def write_sequence(folder: Path, kind: str) -> Path:
    """So many files, of which so many differ."""
    folder.mkdir(parents=True)
    for number in range(FRAMES):
        file = folder / f"{number:06d}.{kind}"
        if number < DIFFERENT:
            WRITERS[kind](file, cloud(number))
        else:
            os.link(folder / f"{number % DIFFERENT:06d}.{kind}", file)
    return folder


class Watch:
    """A client that takes all there is, and knows how many frames that were.

    Args:
        server: that it looks at.
    """

    def __init__(self, server: Served) -> None:
        self.server = server
        self.visitor = Visitor(server.url, cookie_of(server.url))
        self.visitor.look((-8.0, 0.0, 5.0))

    @property
    def frames(self) -> int:
        """That arrived: points of the cloud that has the most."""
        return max(self.visitor.drawn.values(), default=0)

    def read_until(self, done: Callable[[], bool]) -> None:
        """Read as fast as it comes."""
        end_s = time.monotonic() + PATIENCE_S
        while not done():
            assert time.monotonic() < end_s, "\n".join(self.server.said)
            with suppress(TimeoutError):
                self.visitor.read(0.5)

    def rate(self, seconds: float) -> tuple[float, float]:
        """Frames a second that arrive, and processor time of the server for one, s."""
        begun_s, before, cpu_s = time.monotonic(), self.frames, self.server.cpu_s
        self.read_until(lambda: time.monotonic() > begun_s + seconds)
        count = self.frames - before
        return count / (time.monotonic() - begun_s), (self.server.cpu_s - cpu_s) / max(count, 1)


def measured(source: str, seconds: float) -> str:
    """A line of the table."""
    imports_s, imports_cpu_s = imported()
    with served([source]) as server:
        watch = Watch(server)
        watch.read_until(lambda: watch.frames > 0)
        first_s, first_cpu_s = time.monotonic() - server.begun_s, server.cpu_s
        watch.visitor.press("Play")
        watch.rate(SETTLE_S)
        normal_hz, normal_cpu_s = watch.rate(seconds)
        held_mb = server.held_mb
        watch.visitor.turn("Speed", "10x")
        fastest_hz, fastest_cpu_s = watch.rate(seconds)
        watch.read_until(lambda: watch.frames >= FRAMES + 1)
        return (
            f"first {first_s:5.2f} s ({first_cpu_s:4.2f} s of a core; imports {imports_s:4.2f}"
            f" and {imports_cpu_s:4.2f})  1x {normal_hz:5.1f}/s ({1e3 * normal_cpu_s:3.0f} ms each)"
            f"  10x {fastest_hz:5.1f}/s ({1e3 * fastest_cpu_s:3.0f} ms each)"
            f"  {held_mb:4.0f} MB, after all frames {server.held_mb:4.0f} MB"
        )


def imported() -> tuple[float, float]:
    """Seconds, and seconds of a core, of an interpreter that imports what is not ours."""
    begun_s, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", IMPORTS], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.monotonic() - begun_s, cpu_s


def seen_by_browser(source: str, seconds: float) -> str:
    """How often a browser gets a cloud, and how often it draws, while it plays at 10 Hz."""
    with served([source]) as server, started_browser() as browser:
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        clouds = list[int]()
        page.on("websocket", lambda socket: socket.on("framereceived", partial(_note, clouds)))
        page.goto(server.url, timeout=1e3 * PATIENCE_S)
        page.get_by_text(re.compile(r"[1-9]\d* / \d+")).wait_for(timeout=1e3 * PATIENCE_S)
        page.keyboard.press("k")
        page.wait_for_timeout(1e3 * SETTLE_S)
        before, begun_s, cpu_s = len(clouds), time.monotonic(), server.cpu_s
        drawn = page.evaluate(DRAWN, 1e3 * seconds)
        took_s = time.monotonic() - begun_s
        each_ms = 1e3 * (server.cpu_s - cpu_s) / max(len(clouds) - before, 1)
        return (
            f"browser  {(len(clouds) - before) / took_s:5.1f} clouds/s, {drawn / took_s:5.1f} "
            f"pictures/s; server {each_ms:3.0f} ms each"
        )


def _note(clouds: list[int], payload: str | bytes) -> None:
    if len(payload) > POINTS:
        clouds.append(len(payload))


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--source", default="")
    parser.add_argument("--browser", action="store_true")
    given = parser.parse_args()
    told = seen_by_browser if given.browser else measured
    if given.source:
        print(f"{given.source}: {told(given.source, given.seconds)}")
        return
    with tempfile.TemporaryDirectory() as folder:
        for kind in WRITERS:
            place = write_sequence(Path(folder) / kind, kind)
            print(f"{kind}  {told(str(place), given.seconds)}", flush=True)


if __name__ == "__main__":
    main()
