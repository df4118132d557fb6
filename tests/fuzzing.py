"""Mutated files, read in a process with bounded memory and time.

    python -m tests.fuzzing pcd 10000
    python -m tests.fuzzing ply 1 --first 8123     # that very input again
    python -m tests.fuzzing rig-yaml 2000          # readers of `tests/fuzz_targets.py`

Every reader must answer with a `PseudolidarError`, or with something that the file can hold.
"""

from __future__ import annotations

import argparse
import atexit
import ctypes
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.formats.labels import read_labels
from pseudolidar.formats.points.npz import LARGEST_EXPANSION, decode_npz, encode_npz
from pseudolidar.formats.points.pcd import decode_pcd, encode_pcd, salvage_pcd
from pseudolidar.formats.points.ply import decode_ply, encode_ply, salvage_ply
from pseudolidar.formats.points.velodyne_bin import read_velodyne_bin
from pseudolidar.formats.trajectory import read_kitti_poses
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

# One input may take as long, and the process may grow by as much.
LONGEST_S, MEMORY_MB = 5.0, 400
# A point needs three bytes in binary files; LZF expands by 88 at most, archives of others by 100.
BYTES_PER_POINT = 3
FAILURES_SHOWN = 10
CAMERA_0 = Pose("camera_left", "camera_0", np.eye(4))

TOKENS = (
    b"0", b"1", b"-1", b"2", b"4", b"8", b"255", b"65536", b"2147483648", b"4294967295",
    b"9223372036854775807", b"1000000000000", b"99999999999999999999999", b"1e9", b"nan", b"inf",
    b"-0", b"0x10", b"", b"_", b"x", b"y", b"z", b"rgb", b"rgba", b"F", b"U", b"I", b"f",
    b"ascii", b"binary", b"binary_compressed", b"binary_big_endian", b"binary_little_endian",
    b"list", b"uchar", b"char", b"int", b"uint", b"float", b"double", b"int64", b"short",
    b"vertex", b"face", b"vertex_indices", b"element", b"property", b"comment", b"end_header",
    b"FIELDS", b"SIZE", b"TYPE", b"COUNT", b"WIDTH", b"HEIGHT", b"POINTS", b"DATA", b"VIEWPOINT",
    b"pseudolidar shape", b"\xff\xfe", b"\x00", b"\n", b"\r\n", b" ",
)  # fmt: skip
_DECIMAL = re.compile(rb"-?[0-9]+\.?[0-9]*(?:[eE][-+]?[0-9]+)?")
LONGEST_TEXT = 20_000
VALUES = (
    b"0", b"-1", b"1e308", b"-1e308", b"1e-308", b"1e400", b"nan", b"-inf", b"null", b"[]", b"{}",
    b"0.5", b"1e6", b"-0.12", b"1000000000000", b"1,5", b"&a", b"*a", b"!!float 1", b"\t1", b'"1"',
)  # fmt: skip
LENGTHS = (0, 1, 2, 3, 127, 128, 255, 256, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1)


def mutated(corpus: Sequence[bytes], seed: int) -> bytes:
    """One of the corpus with one to four changes; the same for the same seed."""
    rng = np.random.default_rng(seed)
    data = bytearray(corpus[int(rng.integers(len(corpus)))])
    for _ in range(int(rng.integers(1, 5))):
        change = CHANGES[int(rng.integers(len(CHANGES)))]
        data = change(data, corpus, rng) if data else bytearray(corpus[0])
    return bytes(data)


def _place(data: bytearray, rng: np.random.Generator) -> int:
    """Half of all places are in the header."""
    end = len(data) if rng.random() < 0.5 else min(len(data), 500)
    return int(rng.integers(0, max(1, end)))


def _flip(data: bytearray, corpus: Sequence[bytes], rng: np.random.Generator) -> bytearray:
    data[_place(data, rng)] ^= 1 << int(rng.integers(8))
    return data


def _bytes(data: bytearray, corpus: Sequence[bytes], rng: np.random.Generator) -> bytearray:
    at, count = _place(data, rng), int(rng.integers(1, 9))
    data[at : at + count] = rng.integers(0, 256, count, np.uint8).tobytes()
    return data


def _cut(data: bytearray, corpus: Sequence[bytes], rng: np.random.Generator) -> bytearray:
    return data[: _place(data, rng)]


def _remove(data: bytearray, corpus: Sequence[bytes], rng: np.random.Generator) -> bytearray:
    at = _place(data, rng)
    del data[at : at + int(rng.integers(1, 60))]
    return data


def _repeat(data: bytearray, corpus: Sequence[bytes], rng: np.random.Generator) -> bytearray:
    at = _place(data, rng)
    data[at:at] = data[at : at + int(rng.integers(1, 60))] * int(rng.integers(1, 5))
    return data


def _splice(data: bytearray, corpus: Sequence[bytes], rng: np.random.Generator) -> bytearray:
    other = corpus[int(rng.integers(len(corpus)))]
    return data[: _place(data, rng)] + other[_place(bytearray(other), rng) :]


def _token(data: bytearray, corpus: Sequence[bytes], rng: np.random.Generator) -> bytearray:
    """Another word in place of one of the header."""
    head = bytes(data[:500])
    words = [i for i in range(len(head)) if head[i] > 32 and (i == 0 or head[i - 1] <= 32)]
    if not words:
        return data
    at = words[int(rng.integers(len(words)))]
    end = at
    while end < len(data) and data[end] > 32 and end - at < 40:
        end += 1
    data[at:end] = TOKENS[int(rng.integers(len(TOKENS)))]
    return data


def _line(data: bytearray, corpus: Sequence[bytes], rng: np.random.Generator) -> bytearray:
    """A line of the header removed, doubled, or exchanged for one of another file."""
    lines = bytes(data).split(b"\n")
    at = int(rng.integers(min(len(lines), 25)))
    others = corpus[int(rng.integers(len(corpus)))].split(b"\n")
    new = [[], [lines[at]] * 2, [others[int(rng.integers(min(len(others), 25)))]]]
    lines[at : at + 1] = new[int(rng.integers(3))]
    return bytearray(b"\n".join(lines))


def _number(data: bytearray, corpus: Sequence[bytes], rng: np.random.Generator) -> bytearray:
    digits = [i for i, c in enumerate(data[:500]) if 48 <= c <= 57]
    if digits:
        at = digits[int(rng.integers(len(digits)))]
        data[at : at + 1] = str(rng.integers(0, 10 ** int(rng.integers(1, 18)))).encode()
    return data


def _length(data: bytearray, corpus: Sequence[bytes], rng: np.random.Generator) -> bytearray:
    """A length that lies, of any width and order."""
    at, width = _place(data, rng), int(rng.choice([1, 2, 4, 8]))
    value = LENGTHS[int(rng.integers(len(LENGTHS)))] % 2 ** (8 * width)
    data[at : at + width] = value.to_bytes(width, "little" if rng.random() < 0.8 else "big")
    return data


def _swap(data: bytearray, corpus: Sequence[bytes], rng: np.random.Generator) -> bytearray:
    """Two lines exchanged, or the ends of all lines."""
    lines = bytes(data).split(b"\n")
    if rng.random() < 0.2:
        return bytearray((b"\r\n" if rng.random() < 0.5 else b"\r").join(lines))
    i, j = (int(rng.integers(len(lines))) for _ in range(2))
    lines[i], lines[j] = lines[j], lines[i]
    return bytearray(b"\n".join(lines))


def _value(data: bytearray, corpus: Sequence[bytes], rng: np.random.Generator) -> bytearray:
    """Another number, or none, in place of one that stands anywhere in a text."""
    found = list(_DECIMAL.finditer(data[:LONGEST_TEXT]))
    if found:
        at = found[int(rng.integers(len(found)))]
        data[at.start() : at.end()] = VALUES[int(rng.integers(len(VALUES)))]
    return data


CHANGES = (
    _flip, _bytes, _cut, _remove, _repeat, _splice, _token, _line, _number, _length, _swap, _value,
)  # fmt: skip


# --- what is fuzzed ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Target:
    """A reader.

    Args:
        corpus: whole files.
        read: must raise a `PseudolidarError`, or return.
    """

    corpus: Callable[[], list[bytes]]
    read: Callable[[bytes], Any]


def _clouds() -> list[PointCloud]:
    rng = np.random.default_rng(4)
    clouds = []
    for count, shape in ((7, None), (12, (3, 4)), (0, None)):
        xyz = rng.uniform(-40, 40, (count, 3)).astype(np.float32)
        extra = {"ring": np.arange(count, dtype=np.uint8), "t": np.arange(count, dtype=np.int64)}
        rgb = rng.integers(0, 256, (count, 3), np.uint8)
        intensity = rng.random(count, np.float32)
        clouds.append(
            PointCloud(xyz, "velodyne", 5, rgb, intensity, extra=extra, shape=shape)
            if count != 7
            else PointCloud(xyz, "unknown")
        )
    return clouds


def _pcd_corpus() -> list[bytes]:
    kinds = ("binary", "binary_compressed", "ascii")
    ours = [encode_pcd(cloud, encoding=kind) for cloud in _clouds() for kind in kinds]
    odd = (
        b"VERSION .7\nFIELDS _ h x y z rgba\nSIZE 4 2 8 8 8 4\nTYPE F U F F F U\n"
        b"COUNT 2 3 1 1 1 1\nWIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\nDATA binary\n"
    )
    return [*ours, odd + bytes(3 * 42)]


def _ply_corpus() -> list[bytes]:
    kinds = ("binary_little_endian", "ascii")
    ours = [encode_ply(cloud, encoding=kind) for cloud in _clouds() for kind in kinds]
    listed = b"element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    faces = b"\x03" + np.array([0, 1, 2], "<i4").tobytes()
    quad = b"\x04" + np.array([0, 1, 2, 3], "<i4").tobytes()
    mesh = ours[2].replace(b"end_header\n", listed)
    text = ours[3].replace(b"end_header\n", listed)
    axes = b"".join(b"property double %c\n" % axis for axis in b"xyz")
    big = b"ply\r\nformat binary_big_endian 1.0\r\nelement vertex 3\r\n"
    big += b"property list ushort short w\r\n" + axes + b"property uint16 ring\nend_header\n"
    rows = b"".join(n.to_bytes(2, "big") + bytes(2 * n + 26) for n in (0, 2, 1))
    return [
        *ours,
        mesh + faces * 2,
        mesh + faces + quad,
        text + b"3 0 1 2\n4 0 1 2 3\n",
        big + rows,
    ]


def _bin_corpus() -> list[bytes]:
    rng = np.random.default_rng(5)
    return [rng.uniform(-40, 40, 4 * n).astype("<f4").tobytes() for n in (0, 1, 60)]


def _labels_corpus() -> list[bytes]:
    car = b"Car 0.00 0 -1.58 587.01 173.33 614.12 200.12 1.65 1.67 3.64 -0.65 1.71 46.70 -1.59"
    ignored = b"DontCare -1 -1 -10 503.89 169.71 590.61 190.13 -1 -1 -1 -1000 -1000 -1000 -10"
    return [car + b"\n" + ignored + b"\n", car + b" 0.9\r\n", b""]


def _poses_corpus() -> list[bytes]:
    return [b"1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0.5 0 1 0 0 0 0 1 1e-3\n"]


def _of_size(cloud: PointCloud, most: float) -> None:
    assert len(cloud) <= most, f"{len(cloud)} points"


def _read_pcd(data: bytes) -> None:
    most = (88 if b"compressed" in data else 1) * len(data) / BYTES_PER_POINT
    _answered(lambda: _of_size(salvage_pcd(data).cloud, most))
    _of_size(decode_pcd(data), most)


def _read_ply(data: bytes) -> None:
    most = len(data) / BYTES_PER_POINT
    _answered(lambda: _of_size(salvage_ply(data).cloud, most))
    _of_size(decode_ply(data), most)


def _answered(read: Callable[[], None]) -> None:
    try:
        read()
    except PseudolidarError as error:
        assert str(error) and error.got  # noqa: PT017, PT018 - it must say something


def _from_file(read: Callable[[Path], Any], name: str = "input") -> Callable[[bytes], Any]:
    """A reader of bytes, by a file of that name, removed at the end of the process."""
    folder = Path("/dev/shm") if Path("/dev/shm").is_dir() else None
    place = tempfile.mkdtemp(dir=folder)
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    path = Path(place) / name

    def of(data: bytes) -> None:
        path.write_bytes(data)
        read(path)

    return of


def _read_recording(path: Path) -> None:
    from pseudolidar.sources.recording.recording import Recording

    source = Recording(str(path)).open()
    for index in range(len(source.ids)):
        _answered(lambda index=index: source.load(index))


def _mcap_corpus() -> list[bytes]:
    """A recording of two small frames, of each profile."""
    from pseudolidar.cli import main

    found = []
    for profile in ("foxglove", "ros2"):
        with tempfile.TemporaryDirectory() as folder:
            line = ["convert", "synthetic:room", folder, "--frames", "0:2", "--to", "mcap"]
            size = ["--source.width-px", "96", "--source.height-px", "64"]
            said = os.dup(1)
            os.dup2(2, 1)  # the figures alone go to the standard output
            try:
                assert main([*line, *size, "--mcap-profile", profile]) == 0
            finally:
                os.dup2(said, 1)
            (path,) = Path(folder).glob("*.mcap")
            found.append(path.read_bytes())
    return found


TARGETS = {
    "pcd": Target(_pcd_corpus, _read_pcd),
    "ply": Target(_ply_corpus, _read_ply),
    "npz": Target(
        lambda: [encode_npz(cloud) for cloud in _clouds()],
        lambda data: _of_size(decode_npz(data), LARGEST_EXPANSION * len(data)),
    ),
    "bin": Target(_bin_corpus, _from_file(read_velodyne_bin)),
    "labels": Target(
        _labels_corpus,
        _from_file(lambda path: read_labels(path, T_left_cam0=CAMERA_0)),
    ),
    "poses": Target(_poses_corpus, _from_file(read_kitti_poses)),
    "mcap": Target(_mcap_corpus, _from_file(_read_recording)),
}


def _other(name: str) -> Target:
    """One of `fuzz_targets`, whose libraries nobody else needs to load."""
    from tests.fuzz_targets import READERS

    reader = READERS[name]
    return Target(reader.corpus, _from_file(reader.read, reader.file))


# Readers with faults, to prove that faults are found.
FAULTY = {
    "broken": Target(_bin_corpus, lambda data: 1 / (len(data) % 7)),
    "crashing": Target(_bin_corpus, lambda data: len(data) % 7 or ctypes.string_at(0)),
}


# --- the process ------------------------------------------------------------------------------


def fuzz(name: str, count: int, *, first: int = 0) -> dict[str, Any]:
    """Read `count` inputs in a process of its own; what came out, plain JSON values.

    A process that died tells of what, and at which input.
    """
    with tempfile.NamedTemporaryFile() as progress:
        line = [sys.executable, "-m", "tests.fuzzing", name, str(count), "--first", str(first)]
        root = Path(__file__).resolve().parent.parent
        ended = subprocess.run(
            [*line, "--progress", progress.name],
            capture_output=True,
            text=True,
            cwd=root,
            env=os.environ | {"PYTHONPATH": str(root)},
            check=False,
        )
        if ended.stdout:
            found: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
            return found
        at = Path(progress.name).read_text()
        return {"died": ended.returncode, "at": at, "said": ended.stderr[-2000:]}


def _too_long(number: int, frame: Any) -> None:
    raise TimeoutError(f"more than {LONGEST_S:g} s")


def _run(name: str, count: int, first: int, progress: Path | None) -> dict[str, Any]:
    known = TARGETS | FAULTY
    target = known[name] if name in known else _other(name)
    corpus = target.corpus()
    if name not in FAULTY:
        for whole in corpus:  # and with it everything is loaded
            target.read(whole)
    _limit_memory()
    signal.signal(signal.SIGALRM, _too_long)
    refused, failures, slowest_s = 0, [], 0.0
    noted = os.open(progress, os.O_WRONLY) if progress else None
    warnings.simplefilter("error")
    begin_s = time.monotonic()
    for number in range(first, first + count):
        if noted is not None:
            os.pwrite(noted, str(number).encode(), 0)
        data = mutated(corpus, number)
        input_s = time.monotonic()
        signal.setitimer(signal.ITIMER_REAL, LONGEST_S)
        try:
            target.read(data)
        except PseudolidarError:
            refused += 1
        except BaseException:  # whatever it is, it is no answer to a user
            failures.append({"input": number, "trace": traceback.format_exc()[-1500:]})
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
        slowest_s = max(slowest_s, time.monotonic() - input_s)
    return {
        "inputs": count,
        "refused": refused,
        "failed": len(failures),
        "failures": failures[:FAILURES_SHOWN],
        "slowest_s": round(slowest_s, 3),
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1000,
        "seconds": round(time.monotonic() - begin_s, 1),
    }


def _limit_memory() -> None:
    status = Path("/proc/self/status")
    if not status.exists():
        return
    held = next(line for line in status.read_text().splitlines() if line.startswith("VmData"))
    limit = int(held.split()[1]) * 1024 + MEMORY_MB * 1_000_000
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("target", help="one of TARGETS, or READERS of fuzz_targets")
    parser.add_argument("count", type=int)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--progress", type=Path)
    given = parser.parse_args()
    found = _run(given.target, given.count, given.first, given.progress)
    sys.stdout.write(json.dumps(found) + "\n")
    sys.exit(bool(found["failed"]))
