from __future__ import annotations

import lzf as liblzf  # the C library, by way of pypcd4
import numpy as np
import pytest

from pseudolidar.errors import PointFileCorrupt, StructureError
from pseudolidar.formats.points.lzf import LARGEST_BLOCK, compress, decompress

RNG = np.random.default_rng(9)
SIZES = (1, 2, 3, 4, 31, 32, 33, 64, 65, 263, 264, 265, 266, 528, 8191, 8192, 8195, 30_000)
KINDS = {
    "random": lambda n: RNG.integers(0, 256, n, dtype=np.uint8),
    "zeros": lambda n: np.zeros(n, np.uint8),
    "bits": lambda n: RNG.integers(0, 2, n, dtype=np.uint8),
    "ramp": lambda n: np.arange(n, dtype=np.uint32).astype(np.uint8),
    "floats": lambda n: RNG.normal(size=n).cumsum().astype(np.float32).view(np.uint8)[:n],
    "far": lambda n: np.resize(RNG.integers(0, 256, 8192, dtype=np.uint8), n),
}


def as_array(data: bytes) -> np.ndarray:
    return np.frombuffer(data, np.uint8)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", SIZES)
def test_liblzf_reads_ours_and_we_read_liblzf(kind, size):
    data = KINDS[kind](size)
    ours = compress(data)
    assert len(ours) <= size + size // 32 + 1
    assert liblzf.decompress(ours, size) == data.tobytes()
    np.testing.assert_array_equal(decompress(as_array(ours), size), data)
    theirs = liblzf.compress(data.tobytes())
    if theirs is not None:  # it gives up where nothing is gained
        np.testing.assert_array_equal(decompress(as_array(theirs), size), data)


def test_it_compresses_as_well_as_liblzf():
    data = KINDS["ramp"](30_000)
    assert len(compress(data)) < 30_000 / 40
    columns = np.tile(np.arange(1242, dtype=np.float32), 20).view(np.uint8)
    assert len(compress(columns)) <= 1.02 * len(liblzf.compress(columns.tobytes()))


def test_nothing():
    assert compress(np.zeros(0, np.uint8)) == b""
    assert len(decompress(np.zeros(0, np.uint8), 0)) == 0


def plain_decompress(stream: bytes) -> bytes:
    """The definition, byte by byte; raises IndexError where the stream is illegal."""
    out, at = bytearray(), 0
    while at < len(stream):
        control, at = stream[at], at + 1
        if control < 32:
            if at + control + 1 > len(stream):
                raise IndexError
            out += stream[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == 7:
            length, at = length + stream[at], at + 1
        source, at = len(out) - ((control & 31) << 8 | stream[at]) - 1, at + 1
        if source < 0:
            raise IndexError
        for i in range(length + 2):
            out.append(out[source + i])
    return bytes(out)


def test_garbage_is_refused_or_read_as_defined():
    read = refused = 0
    for _ in range(2000):
        stream = RNG.integers(0, RNG.choice([40, 256]), RNG.integers(1, 30), dtype=np.uint8)
        try:
            want = plain_decompress(stream.tobytes())
        except IndexError:
            refused += 1
            with pytest.raises(PointFileCorrupt):
                decompress(stream, min(3000, 88 * len(stream)))
            continue
        read += 1
        np.testing.assert_array_equal(decompress(stream, len(want)), as_array(want))
        for size in (len(want) - 1, len(want) + 1):
            with pytest.raises(PointFileCorrupt):
                decompress(stream, size)
    assert min(read, refused) > 20


def test_cut_stream_is_refused():
    data = KINDS["bits"](500)
    stream = compress(data)
    for size in range(len(stream)):
        with pytest.raises(PointFileCorrupt):
            decompress(as_array(stream[:size]), 500)


def test_expansion_is_bounded():
    with pytest.raises(PointFileCorrupt, match="claim to expand"):
        decompress(np.zeros(10, np.uint8), 10**12)


def test_too_much_for_pcd():
    huge = np.broadcast_to(np.zeros(1, np.uint8), LARGEST_BLOCK)
    with pytest.raises(StructureError):
        compress(huge)
