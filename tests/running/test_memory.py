"""Memory that is given back once it is freed; in a process of its own, for it stays told."""

from __future__ import annotations

import subprocess
import sys

import pytest

# 150 MB in blocks below any mmap threshold, made and freed: how many MB of them are still held, as
# runs want it, for the blocks serve the next frame; and then as a viewer wants it.
BLOCKS_FREED = """
from pathlib import Path
from pseudolidar.running.memory import give_back_freed_memory, keep_freed_memory

def held_mb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4 // 1024

def still_held_mb():
    blocks = [b"z" * 100_000 for _ in range(1500)]
    assert held_mb() > before + 100
    del blocks
    return held_mb() - before

before = held_mb()
give_back_freed_memory()
keep_freed_memory()
kept = still_held_mb()
give_back_freed_memory()
print(kept, still_held_mb())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="tells glibc")
def test_memory_is_given_back_after_a_run_has_kept_it_too():
    command = [sys.executable, "-c", BLOCKS_FREED]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    kept, held = map(int, said.split())
    assert kept > 100
    assert held < 30
