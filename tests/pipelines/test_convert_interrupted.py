"""Killed, interrupted, out of disk, damaged: what is there at the end is what it always is."""

import json
import multiprocessing
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pseudolidar.pipelines.convert import Convert, run

from pseudolidar.cli import main
from pseudolidar.errors import OutputError, OutputLocked, OutputSettings, StereoConfig
from pseudolidar.running.journal.journal_file import JOURNAL_NAME
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.sources.recognise import recognise
from pseudolidar.stereo.census import Census

ALL = "pcd,ply,bin,npz,disparity,depth,mcap"
# The only files that may differ from run to run.
OF_THE_RUN = {"run.json", "report.json", "report.html", JOURNAL_NAME}
CHILDREN = multiprocessing.get_context("forkserver")
CHILDREN.set_forkserver_preload(
    ["pseudolidar.pipelines.convert", "pseudolidar.pipelines.obstacles", "cv2", "numba", "av"]
)
KILLS = 10


def job(source, out, *, to=ALL, workers=2, **options):
    return Convert(recognise(str(source)), out, to=Outputs.parse(to), workers=workers, **options)


def tree(folder):
    """Every file that must be the same, by name."""
    files = {str(p.relative_to(folder)): p for p in folder.rglob("*") if p.is_file()}
    return {name: p.read_bytes() for name, p in files.items() if name not in OF_THE_RUN}


def command(source, out, *options):
    arguments = ["convert", str(source), str(out), "--to", "pcd,mcap", *options]
    return [sys.executable, "-m", "pseudolidar.cli", *arguments]


def journal_lines(out):
    path = out / JOURNAL_NAME
    return path.read_bytes().count(b"\n") if path.exists() else 0


def wait_for(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.001)


def killed_on_the_way(task, chance, run=run):
    """Let a process commit one more frame, kill it a little later; lines of the journal then."""
    before = journal_lines(task.out)
    child = CHILDREN.Process(target=run, args=(task,))
    child.start()
    wait_for(lambda: journal_lines(task.out) > before or not child.is_alive())
    time.sleep(chance.uniform(0.0, 0.02))
    child.kill()
    child.join()
    assert child.exitcode == -signal.SIGKILL, "it was done before it could be killed"
    return journal_lines(task.out)


@pytest.fixture(scope="module")
def reference(drive, tmp_path_factory):
    """What an uninterrupted run with one worker writes."""
    out = tmp_path_factory.mktemp("reference")
    assert run(job(drive, out, workers=1)).exit_code == 0
    return tree(out)


def test_any_number_of_workers_writes_the_same_bytes(drive, tmp_path, reference):
    assert len(reference) == 6 * 14 + 12 + 1
    for workers in (2, 5):
        run(job(drive, tmp_path / str(workers), workers=workers))
        assert tree(tmp_path / str(workers)) == reference


def test_killed_ten_times_it_ends_with_the_same_bytes(long_drive, tmp_path):
    whole, out, to = tmp_path / "whole", tmp_path / "out", "pcd,ply,bin,npz,mcap"
    run(job(long_drive, whole, to=to, workers=1))
    chance = random.Random(5)
    stops = {killed_on_the_way(job(long_drive, out, to=to), chance) for _ in range(KILLS)}
    assert len(stops) == KILLS
    report = run(job(long_drive, out, to=to))
    assert report.exit_code == 0
    assert report.result.passed_now < 60, "committed frames were done again"
    assert tree(out) == tree(whole)
    assert len(report.result.committed) == 60
    assert report.result.figures["points"]["min"] > 0


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_the_run_in_order(long_drive, tmp_path, number, code):
    child = subprocess.Popen(
        command(long_drive, tmp_path, "--workers", "1"), stdout=subprocess.PIPE, text=True
    )
    wait_for(lambda: journal_lines(tmp_path) > 1)
    child.send_signal(number)
    out, _ = child.communicate(timeout=5)
    assert child.returncode == code
    assert "the same command continues" in out
    result = json.loads((tmp_path / "run.json").read_text())
    assert result["exit_code"] == code
    assert result["committed"] == len(list((tmp_path / "pcd").iterdir())) < 60
    assert not list(tmp_path.rglob("*.tmp"))


def test_a_full_disk_leaves_no_partial_file_and_is_continued(drive, tmp_path, reference):
    whole = len(reference["tiny.mcap"])

    def half_the_room():
        resource.setrlimit(resource.RLIMIT_FSIZE, (whole // 2, whole // 2))

    child = subprocess.run(
        command(drive, tmp_path), capture_output=True, text=True, preexec_fn=half_the_room
    )
    assert child.returncode == 5, child.stderr
    assert "OutputError" in child.stderr
    assert "bytes" in child.stderr
    done = tree(tmp_path)
    clouds = {name: data for name, data in done.items() if name.startswith("pcd/")}
    assert 1 <= len(clouds) < 14
    assert all(reference[name] == data for name, data in clouds.items())
    assert not list(tmp_path.rglob("*.tmp"))
    assert subprocess.run(command(drive, tmp_path), capture_output=True).returncode == 0
    assert {n: d for n, d in tree(tmp_path).items() if n.startswith("pcd/")} == {
        n: d for n, d in reference.items() if n.startswith("pcd/")
    }


@pytest.fixture(scope="module")
def whole(drive, tmp_path_factory):
    """The folder of a complete run; not to be changed."""
    out = tmp_path_factory.mktemp("whole") / "out"
    run(job(drive, out))
    return out


@pytest.fixture
def out(whole, tmp_path):
    """The same, for a test that damages it."""
    return shutil.copytree(whole, tmp_path / "out")


@pytest.mark.parametrize("victim", ["pcd/000003.pcd", "bin/000000.bin", "tiny.mcap"])
@pytest.mark.parametrize("damage", ["missing", "cut", "changed"])
def test_damaged_files_are_found_and_made_again(drive, out, reference, victim, damage):
    path = out / victim
    data = bytearray(path.read_bytes())
    if damage == "missing":
        path.unlink()
    elif damage == "cut":
        path.write_bytes(data[: len(data) // 2])
    else:
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
    report = run(job(drive, out))
    assert report.exit_code == 0
    assert 0 < report.result.passed_now <= 14
    assert tree(out) == reference


def test_a_complete_run_does_nothing_and_says_so(drive, out, reference):
    report = run(job(drive, out))
    assert report.exit_code == 0
    assert report.result.passed_now == 0
    assert "already complete" in report.text()
    assert tree(out) == reference


def test_a_torn_journal_is_continued(drive, out, reference):
    path = out / JOURNAL_NAME
    path.write_bytes(path.read_bytes()[:-30])
    assert run(job(drive, out)).result.passed_now == 1
    assert tree(out) == reference


def test_other_settings_are_refused_unless_overwritten(drive, out):
    before = tree(out)
    with pytest.raises(OutputSettings, match=r"min_depth = null, this one has 2\.0"):
        run(job(drive, out, min_depth=2.0))
    assert tree(out) == before
    run(job(drive, out, min_depth=2.0, to="ply", overwrite=True))
    assert {name.split("/")[0] for name in tree(out)} == {"ply", ".report"}


def test_a_run_that_committed_nothing_binds_nobody(drive, tmp_path):
    with pytest.raises(StereoConfig):
        run(job(drive, tmp_path, matcher=Census(disparities=256)))
    assert run(job(drive, tmp_path)).exit_code == 0


def test_settings_of_a_run_do_not_repeat_that_it_started_anew(drive, tmp_path, capsys):
    assert main(["convert", str(drive), str(tmp_path), "--overwrite"]) == 0
    capsys.readouterr()
    assert main(["convert", "--settings", str(tmp_path / "run.json")]) == 0
    assert "nothing was done" in capsys.readouterr().out


def test_another_calibration_is_refused(own_drive, tmp_path):
    out = tmp_path / "out"
    run(job(own_drive, out, to="pcd"))
    rig = json.loads((own_drive / "rig.json").read_text())
    (own_drive / "rig.json").write_text(json.dumps(rig | {"baseline_m": 0.6}))
    with pytest.raises(OutputSettings, match="calibration"):
        run(job(own_drive, out, to="pcd"))


def test_workers_and_the_like_may_differ(drive, out):
    assert run(job(drive, out, workers=1, on_error="stop")).result.passed_now == 0


def test_it_does_not_matter_where_the_command_is_called_from(drive, out, monkeypatch):
    monkeypatch.chdir(drive.parent)
    assert run(job(drive.name, out)).result.passed_now == 0


def test_a_second_run_is_refused(drive, tmp_path):
    from pseudolidar.running.folder import own_folder

    with own_folder(tmp_path), pytest.raises(OutputLocked, match=str(os.getpid())):
        run(job(drive, tmp_path))


@pytest.mark.parametrize("place", ["/proc/pseudolidar", "taken/out"])
def test_a_folder_that_cannot_be_written_is_refused_before_a_frame_is_read(
    drive, tmp_path, monkeypatch, place
):
    monkeypatch.chdir(tmp_path)
    Path("taken").write_bytes(b"")
    with pytest.raises(OutputError) as caught:
        run(job(drive, Path(place)))
    assert caught.value.exit_code == 5


def test_such_a_folder_is_refused_before_anything_heavy_is_loaded(drive):
    """Kernels and OpenCV take longer than the user should wait for this."""
    program = (
        "import sys; from pseudolidar.cli import main\n"
        "code = main(sys.argv[1:])\n"
        "print(code, sorted({'numba', 'cv2', 'open3d', 'mcap'} & set(sys.modules)))"
    )
    line = [sys.executable, "-c", program, "convert", str(drive), "/proc/pseudolidar/out"]
    ended = subprocess.run(line, capture_output=True, text=True, check=False)
    assert ended.stdout == "5 []\n", ended.stderr
    assert "OutputError: /proc/pseudolidar/out" in ended.stderr


def test_leftovers_and_strangers(drive, out, reference):
    (out / "pcd" / "000001.pcd.0123abcd.tmp").write_bytes(b"half")
    (out / "pcd" / "mine.tmp").write_bytes(b"mine")
    run(job(drive, out))
    assert tree(out) == reference | {"pcd/mine.tmp": b"mine"}
