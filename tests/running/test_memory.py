"""Memory that is given back once it is freed; in processes of their own, for it stays told."""

from __future__ import annotations

import subprocess
import sys

import pytest

# 150 MB in arrays of a frame's size, made and freed: how many MB of them are still held.
ARRAYS_FREED = """
import sys
from pathlib import Path
from pseudolidar.running import memory

def held_mb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4 // 1024

for told in sys.argv[1:]:
    getattr(memory, told)()
before = held_mb()
arrays = [b"z" * 1_000_000 for _ in range(150)]
assert held_mb() > before + 100
del arrays
print(held_mb() - before)
"""


def _still_held_mb(*told: str) -> int:
    command = [sys.executable, "-c", ARRAYS_FREED, *told]
    return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


@pytest.mark.skipif(sys.platform != "linux", reason="tells glibc")
def test_a_run_keeps_freed_memory_for_its_next_frame():
    assert _still_held_mb("keep_freed_memory") > 100


@pytest.mark.skipif(sys.platform != "linux", reason="tells glibc")
def test_freed_memory_is_given_back_by_who_was_told_to_keep_it_before():
    assert _still_held_mb("keep_freed_memory", "give_back_freed_memory") < 30
