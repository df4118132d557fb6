"""How much memory there is, and whether freed arrays serve the next frame or are given back."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import resource
import sys
from pathlib import Path

from pseudolidar.errors import MemoryLimit

# Parameters of glibc's mallopt (malloc.h): where mmap begins, how much free memory at the top of a
# heap is kept, and how many heaps there are for threads.
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
_LARGEST_MMAP_THRESHOLD = 32 << 20  # what glibc accepts on 64 bits
_KEPT_BYTES = 512 << 20
# What a process that stays gives back: blocks from so many bytes on.
_GIVEN_BACK_BYTES, _FEW_HEAPS = 1 << 18, 2
# Points that become a file are held as they came, joined, and as its bytes: so often at once.
_COPIES_HELD = 3


def keep_freed_memory() -> None:
    """Tell glibc to reuse blocks of up to 32 MiB, and to keep 512 MiB of free memory.

    Arrays of a frame are some MB each. By default their pages are returned and faulted in again for
    every frame: 8000 faults, 15 ms of 180 (KITTI, 2 cores, 2026-11-23). Other C libraries are left
    alone.
    """
    _tell_glibc({_M_MMAP_THRESHOLD: _LARGEST_MMAP_THRESHOLD, _M_TRIM_THRESHOLD: _KEPT_BYTES})


def give_back_freed_memory() -> None:
    """Tell glibc to give blocks of 256 KiB and more back when they are freed; before threads start.

    For a process that stays for hours and makes now this, now that, in many threads: by default
    arrays of a frame lie among small objects that stay, in a heap for each thread, and what is
    between them is lost. What the viewer holds grew by a third in four minutes, without one object
    more (`tests/benchmarks/viewer_soak.py`, 2026-11-27). After `keep_freed_memory` it holds again.
    """
    _tell_glibc(
        {
            _M_MMAP_THRESHOLD: _GIVEN_BACK_BYTES,
            _M_TRIM_THRESHOLD: _GIVEN_BACK_BYTES,
            _M_ARENA_MAX: _FEW_HEAPS,
        }
    )


def leave_loaded_out_of_searches() -> None:
    """Never look through what is loaded by now again when objects that hold each other are sought.

    For a process that stays, once it is whole. What is loaded are 200,000 objects that will stay.
    """
    gc.collect()
    gc.freeze()


def _tell_glibc(parameters: dict[int, int]) -> None:
    if sys.platform != "linux":
        return
    with contextlib.suppress(AttributeError):  # musl has no mallopt
        libc = ctypes.CDLL(None)
        for parameter, value in parameters.items():
            libc.mallopt(parameter, value)


def check_memory(expected_bytes: int, *, held: int) -> None:
    """Raise before points that are gathered for one file fill the memory.

    Args:
        expected_bytes: of all of them.
        held: of those that are in memory already.

    Raises:
        MemoryLimit: they will not fit, the file made of them included.
    """
    free = available_bytes()
    need = _COPIES_HELD * expected_bytes - held
    if free is not None and need > free:
        raise MemoryLimit(
            f"points of about {expected_bytes / 1e9:.1f} GB, and {need / 1e9:.1f} GB more to join "
            "and write them",
            want=f"at most {free / 1e9:.1f} GB, the free memory",
            fix="Pass --voxel 0.1 (or more), --crop, or fewer --frames.",
        )


def available_bytes() -> int | None:
    """Memory that this process may still take without swapping; None where nothing tells.

    The least of what the system has, what its control group (a container) has left, and what the
    process is limited to.
    """
    known = [_of_system(), _of_group(), _of_process()]
    return min((free for free in known if free is not None), default=None)


def _of_system() -> int | None:
    with contextlib.suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        return 1024 * int(
            next(line for line in lines if line.startswith("MemAvailable")).split()[1]
        )
    return None


def _of_group() -> int | None:
    with contextlib.suppress(OSError, ValueError, StopIteration):
        groups = Path("/proc/self/cgroup").read_text().splitlines()
        own = next(line for line in groups if line.startswith("0::")).removeprefix("0::")
        folder = Path("/sys/fs/cgroup", own.lstrip("/"))
        most, used = (int((folder / f"memory.{name}").read_text()) for name in ("max", "current"))
        stat = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())
        return most - used + int(stat.get("inactive_file", 0))  # given back when it is needed
    return None


def _of_process() -> int | None:
    most, _ = resource.getrlimit(resource.RLIMIT_DATA)
    if most == resource.RLIM_INFINITY:
        return None
    with contextlib.suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/self/status").read_text().splitlines()
        return most - 1024 * int(
            next(line for line in lines if line.startswith("VmData")).split()[1]
        )
    return most
