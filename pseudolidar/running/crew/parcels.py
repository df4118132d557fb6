"""Results handed from one process to another: small things by pickle, bytes by shared memory.

Files of a frame are some 10 MB. Through a pipe they would be copied four times in pieces of 64 kB;
here the sender copies them once in and the receiver once out.
"""

from __future__ import annotations

import io
import mmap
import os
import pickle
import tempfile
from typing import Any

# Bytes from this size on go through the shared memory; below, pickle is as fast.
_LARGE_BYTES = 1 << 16
_ROUND_BYTES = 1 << 20


class SharedArea:
    """Memory shared by descriptor with one other process; it grows, and vanishes with both.

    Args:
        descriptor: of a file that `new_area` made.
    """

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self._map: mmap.mmap | None = None
        self._size = 0

    def mapped(self, size: int, *, grow: bool = False) -> mmap.mmap:
        """The memory, at least `size` bytes of it; the sender may let it grow."""
        if self._map is None or size > self._size:
            if grow:
                size += -size % _ROUND_BYTES
                os.ftruncate(self.descriptor, size)
            self.unmap()
            self._size = os.fstat(self.descriptor).st_size
            self._map = mmap.mmap(self.descriptor, self._size)
        return self._map

    def unmap(self) -> None:
        """Let go of the memory, not of the descriptor."""
        if self._map is not None:
            self._map.close()
            self._map, self._size = None, 0

    def close(self) -> None:
        """Let go of both."""
        self.unmap()
        os.close(self.descriptor)


def new_area() -> SharedArea:
    """An empty area; in memory on Linux, elsewhere in a file without a name."""
    if hasattr(os, "memfd_create"):
        return SharedArea(os.memfd_create("pseudolidar-results"))
    with tempfile.TemporaryFile() as file:
        return SharedArea(os.dup(file.fileno()))


def packed(value: object, area: SharedArea) -> bytes:
    """A message that stands for `value`; its large bytes lie in `area` until the next one."""
    stream = io.BytesIO()
    packer = _Packer(stream)
    packer.dump(value)
    if packer.size:
        memory = area.mapped(packer.size, grow=True)
        for start, data in packer.large:
            memory[start : start + data.nbytes] = data
    return stream.getvalue()


def unpacked(message: bytes, area: SharedArea) -> Any:
    """The value of a message, copied out of `area`."""
    return _Unpacker(io.BytesIO(message), area).load()


class _Packer(pickle.Pickler):
    def __init__(self, stream: io.BytesIO) -> None:
        super().__init__(stream, pickle.HIGHEST_PROTOCOL)
        self.large: list[tuple[int, memoryview]] = []
        self.size = 0

    def persistent_id(self, obj: Any) -> tuple[int, int] | None:
        """Place of large bytes; views of memory go that way whatever their size."""
        if not isinstance(obj, bytes | memoryview):
            return None
        if isinstance(obj, bytes) and len(obj) < _LARGE_BYTES:
            return None
        data = memoryview(obj).cast("B")
        start, self.size = self.size, self.size + data.nbytes
        self.large.append((start, data))
        return start, data.nbytes


class _Unpacker(pickle.Unpickler):
    def __init__(self, stream: io.BytesIO, area: SharedArea) -> None:
        super().__init__(stream)
        self._area = area

    def persistent_load(self, pid: Any) -> bytes:
        """Large bytes of a place."""
        start, size = pid
        return self._area.mapped(start + size)[start : start + size] if size else b""
