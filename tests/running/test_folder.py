import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pseudolidar.errors import OutputError, OutputLocked
from pseudolidar.running.folder import LOCK_NAME, inside, own_folder, remove_leftovers

HOLD = """
import sys, time
from pathlib import Path
from pseudolidar.running.folder import own_folder
with own_folder(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def holder(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


def test_a_second_run_is_refused_with_pid_host_and_time(tmp_path, holder):
    with pytest.raises(OutputLocked) as caught, own_folder(tmp_path):
        pass
    owner = json.loads((tmp_path / LOCK_NAME).read_text())
    assert owner["pid"] == holder.pid
    assert all(str(owner[key]) in str(caught.value) for key in ("pid", "host", "since"))
    assert caught.value.exit_code == 5


def test_a_killed_run_leaves_no_lock(tmp_path, holder):
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    with own_folder(tmp_path):
        assert json.loads((tmp_path / LOCK_NAME).read_text())["pid"] == os.getpid()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("place", ["/proc/pseudolidar/out", "file/out"])
def test_a_folder_that_cannot_be_made_is_refused(tmp_path, monkeypatch, place):
    monkeypatch.chdir(tmp_path)
    Path("file").write_bytes(b"")
    with pytest.raises(OutputError) as caught, own_folder(Path(place)):
        pass
    assert caught.value.exit_code == 5


def test_a_folder_that_cannot_be_written_to_is_refused():
    with pytest.raises(OutputError), own_folder(Path("/proc/self")):
        pass


def test_leftovers_of_interrupted_writes_go_and_nothing_else(tmp_path):
    (tmp_path / "pcd").mkdir()
    ours = [tmp_path / "run.json.0123abcd.tmp", tmp_path / "pcd" / "0.pcd.89abcdef.tmp"]
    theirs = [tmp_path / "notes.tmp", tmp_path / "pcd" / "0.pcd"]
    for path in ours + theirs:
        path.write_bytes(b"")
    remove_leftovers(tmp_path)
    assert not any(path.exists() for path in ours)
    assert all(path.exists() for path in theirs)


def test_nothing_is_written_or_deleted_through_a_link(tmp_path):
    """The output folder itself may be one; what is in it may not."""
    elsewhere, out = tmp_path / "elsewhere", tmp_path / "out"
    (elsewhere / "real").mkdir(parents=True)
    theirs = elsewhere / "0.pcd.89abcdef.tmp"
    theirs.write_bytes(b"")
    out.symlink_to(elsewhere / "real")
    (out / "pcd").symlink_to(elsewhere)
    with own_folder(out):
        assert theirs.exists()
        assert inside(out, "ply/0.ply") == out / "ply" / "0.ply"
        with pytest.raises(OutputError, match="a link, to"):
            inside(out, "pcd/0.pcd")
    for name in (LOCK_NAME, "journal.jsonl", "drive.mcap.part"):
        (out / name).symlink_to(elsewhere / "precious")
        with pytest.raises(OutputError, match="through links"), own_folder(out):
            pass
        (out / name).unlink()
    assert not (elsewhere / "precious").exists()


@pytest.mark.parametrize("name", ["", "../x", "pcd/../../x", "/etc/x", "a\0b"])
def test_outputs_stay_inside(tmp_path, name):
    with pytest.raises(OutputError):
        inside(tmp_path, name)


NO_BLOCK = """
import resource, sys
from pathlib import Path
from pseudolidar.errors import OutputError
from pseudolidar.running.folder import own_folder
resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
try:
    with own_folder(Path(sys.argv[1])):
        pass
except OutputError as error:
    print(error)
"""


def test_a_disk_without_a_free_block_is_told(tmp_path):
    line = [sys.executable, "-c", NO_BLOCK, str(tmp_path)]
    done = subprocess.run(line, capture_output=True, text=True, timeout=60, check=False)
    assert "Free some space" in done.stdout
    assert done.returncode == 0
    assert list(tmp_path.iterdir()) == []
