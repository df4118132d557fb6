"""What the scans of a sequential JPEG must hold: groups of blocks and their Huffman tables.

Source: ITU-T T.81, annexes A.2 and B.2.
"""

from __future__ import annotations

from dataclasses import dataclass, field

BLOCK_PX = 8
PROGRESSIVE = 0xC2
LONGEST_CODE = 16

Table = tuple[bytes, bytes]


@dataclass
class JpegState:
    """What the segments walked so far have defined.

    Args:
        sequential: whether blocks are coded whole, one after the other.
        width_px: width.
        height_px: height.
        sampling: horizontal and vertical sampling factors by component id.
        tables: counts and symbols of the Huffman tables, by class (0 DC, 1 AC) and number.
        restart: groups of blocks between restart marks, 0 without marks.
        scans: scans walked.
    """

    sequential: bool = False
    width_px: int = 0
    height_px: int = 0
    sampling: dict[int, tuple[int, int]] = field(default_factory=dict)
    tables: dict[tuple[int, int], Table] = field(default_factory=dict)
    restart: int = 0
    scans: int = 0

    def define_frame(self, marker: int, body: bytes) -> None:
        """Take in a frame segment.

        Raises:
            ValueError: it is not legal.
        """
        parts = [body[i : i + 3] for i in range(6, len(body), 3)]
        if len(body) < 9 or len(parts) != body[5] or len(parts[-1]) != 3:
            raise ValueError("a frame segment of the wrong length")
        self.sequential = marker != PROGRESSIVE
        self.height_px = int.from_bytes(body[1:3], "big")
        self.width_px = int.from_bytes(body[3:5], "big")
        self.sampling = {part[0]: (part[1] >> 4, part[1] & 15) for part in parts}
        if not all(1 <= h <= 4 and 1 <= v <= 4 for h, v in self.sampling.values()):
            raise ValueError("illegal sampling factors")

    def define_tables(self, body: bytes) -> None:
        """Take in a segment of Huffman tables.

        Raises:
            ValueError: it is not legal.
        """
        at = 0
        while at < len(body):
            kind, counts = body[at], body[at + 1 : at + 1 + LONGEST_CODE]
            at += 1 + LONGEST_CODE + sum(counts)
            symbols = body[at - sum(counts) : at]
            used = sum(count << (LONGEST_CODE - 1 - i) for i, count in enumerate(counts))
            if at > len(body) or used > 1 << LONGEST_CODE:
                raise ValueError("illegal Huffman tables")
            self.tables[kind >> 4, kind & 15] = counts, symbols


@dataclass(frozen=True)
class JpegScan:
    """What the entropy-coded data of a scan must hold.

    Args:
        mcus: groups of blocks.
        restart: groups between restart marks, 0 without marks.
        blocks: which of `tables` the DC and AC codes of each block of a group use.
        tables: Huffman tables.
    """

    mcus: int
    restart: int
    blocks: tuple[tuple[int, int], ...]
    tables: tuple[Table, ...]


def scan_of(state: JpegState, body: bytes) -> JpegScan | None:
    """The scan that a scan segment begins; None where it cannot be walked.

    That is a progressive one, or one that relies on tables which are not in the file (frames of
    motion JPEG).

    Raises:
        ValueError: the segment is not legal.
    """
    parts = [(body[i], body[i + 1]) for i in range(1, len(body) - 3, 2)]
    if len(body) < 6 or len(parts) != body[0] or any(c not in state.sampling for c, _ in parts):
        raise ValueError("an illegal scan segment")
    if not state.sequential:
        return None
    wanted = [((0, number >> 4), (1, number & 15)) for _, number in parts]
    keys = sorted({key for pair in wanted for key in pair})
    if any(key not in state.tables for key in keys):
        return None
    places = [(keys.index(dc), keys.index(ac)) for dc, ac in wanted]
    if len(parts) == 1:
        mcus, repeats = _blocks_alone(state, parts[0][0]), [1]
    else:
        mcus = _groups(state)
        repeats = [state.sampling[c][0] * state.sampling[c][1] for c, _ in parts]
    blocks = tuple(place for place, n in zip(places, repeats, strict=True) for _ in range(n))
    return JpegScan(mcus, state.restart, blocks, tuple(state.tables[key] for key in keys))


def _groups(state: JpegState) -> int:
    """Groups of blocks of an interleaved scan."""
    h, v = _largest(state)
    return _ceil(state.width_px, BLOCK_PX * h) * _ceil(state.height_px, BLOCK_PX * v)


def _blocks_alone(state: JpegState, component: int) -> int:
    """Blocks of a scan of one component, which is not padded to whole groups."""
    (h, v), (largest_h, largest_v) = state.sampling[component], _largest(state)
    width = _ceil(state.width_px * h, largest_h)
    height = _ceil(state.height_px * v, largest_v)
    return _ceil(width, BLOCK_PX) * _ceil(height, BLOCK_PX)


def _largest(state: JpegState) -> tuple[int, int]:
    factors = state.sampling.values()
    return max(h for h, _ in factors), max(v for _, v in factors)


def _ceil(a: int, b: int) -> int:
    return -(-a // b)
