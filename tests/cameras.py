"""What stands in for cameras in tests: numbered pictures in real videos, and who writes them."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from tests.videos import pictures, write_video

WIDTH, HEIGHT, DISPARITY_PX = 128, 64, 9
RIG = {
    "schema": 1,
    "width_px": WIDTH,
    "height_px": HEIGHT,
    "baseline_m": 0.5,
    "left": {"fx": 100.0, "fy": 100.0, "cx": 63.5, "cy": 31.5},
    "right": {"fx": 100.0, "fy": 100.0, "cx": 63.5, "cy": 31.5},
}
MJPEG = {"codec": "mjpeg", "pix_fmt": "yuvj420p", "color_range": 2}
# Writes videos to as many pipes, a picture each in turn, as the program of a camera would: paths of
# videos and pipes by turns, then how many pictures; each further one waits for a line on standard
# input, all the rest for its end.
WRITER = """
import sys
import av
*places, count = sys.argv[1:]
tracks = []
for source, target in zip(places[::2], places[1::2]):
    track = av.open(source).streams.video[0]
    pipe = open(target, "wb", buffering=0)
    new = av.open(pipe, "w", format="matroska", container_options={"cluster_time_limit": "1"})
    copy = new.add_stream_from_template(track)
    tracks.append(([p for p in track.container.demux(track) if p.size], copy, new))
for number in range(len(tracks[0][0])):
    if number == int(count):
        print("written", flush=True)
    if number >= int(count) >= 0:
        sys.stdin.readline()
    for packets, copy, new in tracks:
        packets[number].stream = copy
        new.mux(packets[number])
for _, _, new in tracks:
    new.close()
"""


def eyes(count: int, seed: int = 3) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Pictures of both eyes: all differ everywhere, the right one is shifted."""
    wide = pictures(count, WIDTH + DISPARITY_PX, HEIGHT, seed=seed)
    left = [np.ascontiguousarray(picture[:, :-DISPARITY_PX]) for picture in wide]
    return left, [np.ascontiguousarray(picture[:, DISPARITY_PX:]) for picture in wide]


def write_rig(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rig.json").write_text(json.dumps(RIG))
    return folder / "rig.json"


def number_of(picture: np.ndarray, all_of_them: Sequence[np.ndarray]) -> int:
    """Which of the pictures it is, to the last pixel; a torn one is none of them."""
    found = [n for n, known in enumerate(all_of_them) if np.array_equal(picture, known)]
    assert len(found) == 1, "a picture that no camera has taken"
    return found[0]


def write_eyes(
    folder: Path,
    left: Sequence[np.ndarray],
    right: Sequence[np.ndarray],
    *,
    rate: int = 50,
    right_ticks: Sequence[int] | None = None,
    **how,
) -> tuple[Path, Path]:
    """Two lossless videos; `right_ticks` ms of the right one's pictures."""
    one = write_video(folder / "left.mkv", left, rate=rate, **how)
    other = write_video(
        folder / "right.mkv",
        right,
        rate=rate,
        ticks=right_ticks,
        time_base=None if right_ticks is None else Fraction(1, 1000),
        **how,
    )
    return one, other


def writer(*videos_and_pipes: Path | str, count: int = -1) -> subprocess.Popen[str]:
    """A process that writes videos to pipes; after `count` pictures each waits for a line."""
    return subprocess.Popen(
        [sys.executable, "-c", WRITER, *map(str, videos_and_pipes), str(count)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def send_until(feed: subprocess.Popen[str], enough: Callable[[], bool]) -> None:
    """Let a writer send picture by picture until there is enough, or nobody reads any more."""
    with contextlib.suppress(BrokenPipeError):
        while not enough():
            feed.stdin.write("\n")
            feed.stdin.flush()
            time.sleep(0.02)


def damaged(source: Path, target: Path, numbers: Sequence[int], keep: float) -> Path:
    """A copy in which the packets `numbers` have only their first part."""
    with av.open(str(source)) as old, av.open(str(target), "w") as new:
        track = old.streams.video[0]
        copy = new.add_stream_from_template(track)
        for number, packet in enumerate(p for p in old.demux(track) if p.size):
            sent = packet
            if number in numbers:
                sent = av.Packet(bytes(packet)[: int(packet.size * keep)])
                sent.pts, sent.dts, sent.time_base = packet.pts, packet.dts, packet.time_base
                sent.is_keyframe = packet.is_keyframe
            sent.stream = copy
            new.mux(sent)
    return target
