"""Processes that crash, hang and eat memory: each costs its frame, none the run."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from pseudolidar.errors import UsageError, WorkerFault
from pseudolidar.running.bad_frames import good_frames
from pseudolidar.running.crew import child
from pseudolidar.running.crew.attempt import Done
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.crew.parcels import new_area, packed, unpacked
from pseudolidar.running.stream import stream
from tests.misbehaviour import CrashingSource, Misbehave

ROOT = Path(__file__).resolve().parents[3]
CHILD = child.__name__  # what the command line of a process names


def isolated(source, per_frame, workers=1, **options):
    plan = CrewPlan(workers, isolate=True, **options)
    return list(stream(source, per_frame, crew=plan))


def descendants():
    return [p for p in psutil.Process().children(recursive=True) if CHILD in _line(p)]


def _line(process):
    try:
        return " ".join(process.cmdline())
    except psutil.Error:
        return ""


def wait_for(condition, seconds=20.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.01)


def test_processes_give_what_threads_give(texture_source):
    source = texture_source(12)
    threads = list(stream(source, Misbehave(), crew=CrewPlan(2)))
    processes = isolated(source, Misbehave(), workers=2)
    assert [(o.id, o.index, o.value) for o in processes] == [
        (o.id, o.index, o.value) for o in threads
    ]
    assert len({o.value[1] for o in processes}) == 12
    assert not descendants()


@pytest.mark.parametrize(
    ("fault", "code", "said"),
    [
        ("read_null", "NativeCrash", "SIGSEGV in string_at"),
        ("abort", "NativeCrash", "SIGABRT in abort"),
        ("be_killed", "NativeCrash", "SIGKILL"),
        ("leave", "NativeCrash", "exit status 7"),
        ("want_everything", "MemoryLimit", "no memory left"),
    ],
)
def test_a_crash_costs_its_frame(texture_source, fault, code, said):
    first, bad, last = isolated(texture_source(3), Misbehave({1: fault}))
    assert isinstance(first, Done)
    assert isinstance(last, Done)
    assert (bad.id, bad.index, bad.error.code) == ("000001", 1, code)
    assert said in str(bad.error)
    assert "frame 000001" in bad.error.where
    assert "processing" in bad.error.where or code != "NativeCrash"


def test_a_crash_of_the_reader_is_told_as_one():
    first, bad, last = isolated(CrashingSource(), Misbehave())
    assert isinstance(first, Done)
    assert isinstance(last, Done)
    assert bad.error.where == "frame 000001, reading"
    assert "in load" in bad.trace, "the last words of the process are for developers"


def test_a_frame_whose_process_died_once_is_done_in_another(texture_source, tmp_path):
    """As when the system kills a process for others' hunger."""
    source = texture_source(4)
    work = Misbehave({1: "be_killed", 2: "read_null"}, once=tmp_path)
    outcomes = isolated(source, work, workers=2)
    assert [o.value for o in outcomes] == [o.value for o in stream(source, Misbehave())]


def test_memory_is_limited(texture_source):
    work = Misbehave({1: "hog", 3: "unpack_much"})
    outcomes = isolated(texture_source(5), work, memory_limit_mb=1000)
    assert [getattr(getattr(o, "error", None), "code", None) for o in outcomes] == [
        None, "MemoryLimit", None, "MemoryLimit", None,
    ]  # fmt: skip


def test_a_limit_too_low_for_anything_ends_the_run(texture_source):
    first, _ = isolated(texture_source(2), Misbehave(), memory_limit_mb=1)
    assert isinstance(first.error, WorkerFault)
    assert "a limit of 1 MB" in str(first.error)
    assert "taken before the first frame" in str(first.error)


def test_a_process_that_hangs_is_killed(texture_source):
    begin_s = time.monotonic()
    outcomes = isolated(texture_source(4), Misbehave({1: "hang", 2: "hang"}), timeout_s=1)
    assert [isinstance(o, Done) for o in outcomes] == [True, False, False, True]
    assert outcomes[1].error.code == outcomes[2].error.code == "FrameTimeout"
    assert time.monotonic() - begin_s < 20
    assert not descendants()


def test_work_that_cannot_travel_is_refused(texture_source):
    with pytest.raises(UsageError, match="cannot be sent"):
        isolated(texture_source(2), lambda frame: None)


def test_work_that_cannot_be_loaded_ends_the_run(texture_source, tmp_path, monkeypatch):
    """A module that the process cannot import."""
    (tmp_path / "only_here.py").write_text("def work(frame): return 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    import only_here

    monkeypatch.undo()
    with pytest.raises(WorkerFault, match="only_here"):
        list(
            good_frames(
                isolated(texture_source(3), only_here.work),
                frames=3,
                on_error="skip",
                skipped=lambda frame: None,
            )
        )


def test_a_child_killed_from_outside_is_replaced(texture_source):
    source, killed = texture_source(30), []

    def kill_one():
        wait_for(descendants)
        time.sleep(0.5)
        killed.append(descendants()[0])
        killed[0].kill()

    killer = threading.Thread(target=kill_one)
    killer.start()
    outcomes = isolated(source, Misbehave(pause_s=0.1), workers=2)
    killer.join()
    assert killed
    assert [o.value for o in outcomes] == [o.value for o in stream(source, Misbehave())]


PARENT = """
import sys
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.stream import stream
from tests.misbehaviour import Misbehave
from tests.running.conftest import TextureSource

plan = CrewPlan(2, isolate=True)
work = Misbehave({2: "hang", 3: "hang"}, pause_s=0.05)
for outcome in stream(TextureSource(8), work, crew=plan):
    print(outcome.id, flush=True)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a child ends after its frame")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_no_process_outlives_its_parent(number):
    """Although both children hang in C."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=environment,
        cwd=ROOT,
    )
    assert [parent.stdout.readline() for _ in range(2)] == ["000000\n", "000001\n"]
    time.sleep(0.3)
    children = psutil.Process(parent.pid).children(recursive=True)
    assert len(children) == 2
    parent.send_signal(number)
    parent.wait(5)
    parent.stdout.close()
    gone, alive = psutil.wait_procs(children, timeout=5)
    assert (len(gone), alive) == (2, [])


# --- how results travel -----------------------------------------------------------------------


def test_parcels_bring_back_what_was_sent():
    area = new_area()
    values = [
        {"small": b"x", "large": bytes(range(256)) * 1000, "array": np.arange(50_000)},
        {"larger": b"y" * 3_000_000, "view": memoryview(b"abc"), "none": b""},
        {"again": b"z" * 70_000},
    ]
    for value in values:
        back = unpacked(packed(value, area), area)
        assert list(back) == list(value)
        assert all(np.array_equal(bytes(back[k]), bytes(v)) for k, v in value.items())
    area.close()


def test_large_bytes_do_not_go_through_the_pipe():
    area = new_area()
    assert len(packed([b"x" * 1_000_000, b"y" * 100_000], area)) < 1000
    area.close()
