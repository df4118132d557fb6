"""What a stranger gets for bad input and bad disks, through the command line."""

import json
import multiprocessing
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from pseudolidar.cli import main
from pseudolidar.formats.points.npz import read_npz
from pseudolidar.formats.points.pcd import read_pcd
from pseudolidar.formats.points.ply import read_ply
from pseudolidar.formats.rigs.kitti import CAM_TO_CAM, VELO_TO_CAM
from pseudolidar.running.folder import own_folder
from tests.formats.mcap.test_reader import BOMBS, MAGIC, Footer, record_bytes
from tests.formats.test_whole_read import keep_writing

ALL = "pcd,ply,bin,npz,disparity,depth,mcap"
DEPTH_M = 100.0 * 0.5 / 9  # of the drive in conftest


def convert(capsys, *args):
    """Exit code and the object of `convert --json`; the terminal must show no traceback."""
    code = main(["convert", *map(str, args), "--json"])
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return code, json.loads(captured.out)


def skips(out):
    report = json.loads((out / "report.json").read_text())
    return {skip["id"]: (skip["code"], skip["got"]) for skip in report["skipped"]}


def rewrite(drive, change, suffix=".png"):
    """Every picture of a drive anew: `change(image)` is stored."""
    for path in sorted(drive.glob("*/*.png")):
        image = change(cv2.imread(str(path)))
        path.unlink()
        assert cv2.imwrite(str(path.with_suffix(suffix)), image)


# --- pictures (rows 3 to 7) -------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".jpg", ".tif", ".pgm"])
def test_a_cut_picture_of_any_kind_costs_its_frame(own_drive, tmp_path, capsys, suffix):
    grey = (lambda image: image[:, :, 0]) if suffix == ".pgm" else (lambda image: image)
    rewrite(own_drive, grey, suffix)
    path = own_drive / "left" / f"000002{suffix}"
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    out = tmp_path / "out"
    code, report = convert(capsys, own_drive, out)
    assert (code, report["committed"], report["skipped"]) == (4, 5, 1)
    kind, got = skips(out)["000002"]
    assert kind == "ImageTruncated"
    assert got
    assert not (out / "pcd" / "000002.pcd").exists()


def test_a_header_that_claims_gigabytes_is_refused_before_decoding(own_drive, tmp_path, capsys):
    path = own_drive / "left" / "000002.png"
    data = bytearray(path.read_bytes())
    data[16:24] = (30_000).to_bytes(4, "big") * 2
    path.write_bytes(data)
    code, _ = convert(capsys, own_drive, tmp_path / "out")
    assert code == 4
    assert skips(tmp_path / "out")["000002"][0] == "LimitError"


def test_sixteen_bits_stay(own_drive, tmp_path, capsys):
    rewrite(own_drive, lambda image: image.astype(np.uint16) * 16)
    assert convert(capsys, own_drive, tmp_path / "out")[0] == 0
    cloud = read_pcd(tmp_path / "out" / "pcd" / "000000.pcd")
    assert np.median(cloud.xyz[:, 2]) == pytest.approx(DEPTH_M, rel=0.01)
    assert len(np.unique(cloud.intensity)) > 256, "more levels than 8 bits have"


def test_alpha_is_dropped_and_that_is_told(own_drive, tmp_path, capsys):
    rewrite(own_drive, lambda image: cv2.cvtColor(image, cv2.COLOR_BGR2BGRA))
    assert convert(capsys, own_drive, tmp_path / "out")[0] == 0
    assert "alpha" in (tmp_path / "out" / "report.json").read_text()
    cloud = read_pcd(tmp_path / "out" / "pcd" / "000000.pcd")
    assert np.median(cloud.xyz[:, 2]) == pytest.approx(DEPTH_M, rel=0.01)


# --- points (row 16) --------------------------------------------------------------------------


@pytest.mark.parametrize("matcher", ["census", "sgbm", "bm"])
def test_nothing_written_is_not_finite(drive, tmp_path, capsys, matcher):
    options = ("--to", ALL, "--matcher", matcher, "--frames", "0:2", "--reproject.max-range-m", 1e9)
    assert convert(capsys, drive, tmp_path, *options)[0] == 0
    for read, kind in ((read_pcd, "pcd"), (read_ply, "ply"), (read_npz, "npz")):
        cloud = read(tmp_path / kind / f"000001.{kind}")
        columns = [cloud.xyz, cloud.intensity, cloud.uv]
        columns += [] if cloud.sigma_m is None else [cloud.sigma_m]
        assert all(np.isfinite(column).all() for column in columns), kind
    assert np.isfinite(np.fromfile(tmp_path / "bin" / "000001.bin", "<f4")).all()
    with (tmp_path / "tiny.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        clouds = [m for *_, m in reader.iter_decoded_messages(topics=["/stereo/points"])]
    assert len(clouds) == 2
    for cloud in clouds:
        rows = np.frombuffer(cloud.data, np.uint8).reshape(-1, cloud.point_stride)
        assert np.isfinite(rows[:, :12].copy().view("<f4")).all()


def test_a_bin_of_organised_clouds_holds_points_alone(drive, tmp_path, capsys):
    options = ("--to", "pcd,bin", "--reproject.organised", "--frames", "0:1")
    assert convert(capsys, drive, tmp_path, *options)[0] == 0
    cloud = read_pcd(tmp_path / "pcd" / "000000.pcd")
    assert cloud.shape == (64, 128)
    records = np.fromfile(tmp_path / "bin" / "000000.bin", "<f4").reshape(-1, 4)
    assert np.isfinite(records).all()
    assert len(records) == np.isfinite(cloud.xyz).all(axis=1).sum()


# --- calibration and scans of KITTI (rows 18 to 20, 30 to 32) ---------------------------------


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    """A small street as KITTI raw data."""
    root = tmp_path_factory.mktemp("kitti") / "raw"
    options = ["--frames", "3", "--width-px", "240", "--height-px", "96"]
    assert main(["synth", str(root), *options]) == 0
    return root


@pytest.fixture
def raw(written, tmp_path) -> Path:
    """The same, for a test that damages it."""
    return Path(shutil.copytree(written, tmp_path / "raw"))


def line_of(text, key):
    return next(line for line in text.splitlines() if line.startswith(key))


@pytest.mark.parametrize(
    ("name", "key", "change", "code", "said"),
    [
        (CAM_TO_CAM, "P_rect_03", lambda line: "", "CalibrationField", "P_rect_03"),
        (VELO_TO_CAM, "T:", lambda line: "", "CalibrationField", "T"),
        (CAM_TO_CAM, "P_rect_02", lambda line: line.rsplit(" ", 1)[0], "CalibrationSyntax", "12"),
        *(
            (CAM_TO_CAM, "P_rect_02", lambda line, bad=bad: line.rsplit(" ", 1)[0] + " " + bad,
             "CalibrationSyntax", "line")
            for bad in ("nan", "inf", "1_000", "1,5", "\uff11", "abc")
        ),
    ],
)  # fmt: skip
def test_a_broken_calibration_is_refused_by_place(
    raw, tmp_path, capsys, name, key, change, code, said
):
    (file,) = raw.rglob(name)
    text = file.read_text()
    line = line_of(text, key)
    file.write_text(text.replace(line, change(line)), encoding="utf-8")
    ended, answer = convert(capsys, raw, tmp_path / "out")
    error = answer["error"]
    assert (ended, error["code"], error["path"]) == (3, code, str(file))
    assert said in " ".join(map(str, error.values()))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("cut", "ended"), [(-7, 4), (None, 0)], ids=["a fraction of a point", "no point at all"]
)
def test_a_broken_scan_costs_its_frame_and_an_empty_one_nothing(raw, tmp_path, capsys, cut, ended):
    scan = sorted(raw.rglob("velodyne_points/data/*.bin"))[1]
    scan.write_bytes(scan.read_bytes()[:cut] if cut else b"")
    out = tmp_path / "out"
    code, report = convert(capsys, raw, out, "--to", "pcd,mcap")
    assert (code, report["skipped"]) == (ended, 1 if ended else 0)
    assert [kind for kind, _ in skips(out).values()] == ["PointFileTruncated"] * (ended == 4)


# --- names of any bytes (row 50) --------------------------------------------------------------


@pytest.mark.parametrize("name", ["with space", "snow\u2603man \U0001f600", "a\nb", "raw\udcff"])
def test_names_of_any_bytes_work_and_are_shown_escaped(drive, tmp_path, capsys, name):
    source, out = tmp_path / name, tmp_path / f"out {name}"
    shutil.copytree(drive, source)
    code, report = convert(capsys, source, out, "--to", "pcd,mcap", "--frames", "0:2")
    assert (code, report["committed"]) == (0, 2)
    assert len(list((out / "pcd").iterdir())) == 2
    assert len(list(out.glob("*.mcap"))) == 1
    (out / "report.html").read_text(encoding="utf-8")
    json.loads((out / "run.json").read_text(encoding="utf-8"))
    code, answer = convert(capsys, source / "absent", out)
    assert code == 3
    assert "\n" not in answer["error"]["got"]


def test_a_picture_with_a_long_name(drive, tmp_path, capsys):
    """As long as a file system allows: the output's temporary name must still fit."""
    name = "\U0001f600" * 61
    for eye in ("left", "right"):
        (tmp_path / "d" / eye).mkdir(parents=True)
        shutil.copy(drive / eye / "000000.png", tmp_path / "d" / eye / f"{name}.png")
    shutil.copy(drive / "rig.json", tmp_path / "d")
    code, report = convert(capsys, tmp_path / "d", tmp_path / "out")
    assert (code, report["committed"]) == (0, 1)


# --- texts of other editors, poses, files that change, bombs (rows 28, 44, 53, 66) -------------


def test_what_editors_do_to_a_calibration_changes_no_byte(written, raw, tmp_path, capsys):
    (file,) = raw.rglob(CAM_TO_CAM)
    lines = file.read_bytes().splitlines()
    dressed = b"\xef\xbb\xbf" + b"".join(line + b"  \t\r\n" for line in lines)
    file.write_bytes(dressed)
    options = ("--to", "pcd", "--frames", "0:1")
    assert convert(capsys, written, tmp_path / "plain", *options)[0] == 0
    assert convert(capsys, raw, tmp_path / "dressed", *options)[0] == 0
    (plain,), (other,) = ((tmp_path / out).rglob("*.pcd") for out in ("plain", "dressed"))
    assert plain.read_bytes() == other.read_bytes()
    at = dressed.index(b"P_rect_02")
    file.write_bytes(dressed[:at] + b"\0" + dressed[at:])
    error = convert(capsys, raw, tmp_path / "binary", *options)[1]["error"]
    assert error["code"] == "CalibrationSyntax"
    assert f"byte {at}" in error["where"]


def test_broken_poses_are_told_with_the_row_and_both_counts(tmp_path, capsys):
    root = tmp_path / "kitti"
    size = ["--frames", "3", "--width-px", "160", "--height-px", "64"]
    assert main(["synth", str(root), "--layout", "odometry", *size]) == 0
    capsys.readouterr()
    (file,) = root.rglob("poses/*.txt")
    rows = file.read_text().splitlines()
    bent = rows[1].split()
    bent[0] = "3.5"
    for number, (content, where, said) in enumerate(
        [
            (rows[:2], "row 3", "2 poses"),
            ([rows[0], "nan " + rows[1].split(" ", 1)[1], rows[2]], "line 2", "nan"),
            ([rows[0], " ".join(bent), rows[2]], "line 2", "pose 1 of 3 is not rigid"),
        ]
    ):
        file.write_text("\n".join(content) + "\n")
        code, answer = convert(capsys, root, tmp_path / f"out{number}")
        error = answer["error"]
        assert (code, error["code"], error["path"]) == (3, "PoseFileError", str(file))
        assert where in error["where"]
        assert said in error["got"]
        assert error["fix"]


def test_a_file_that_somebody_writes_to_costs_its_frame(tmp_path, capsys):
    folder = tmp_path / "clouds"
    folder.mkdir()
    for name in ("0", "1", "2"):
        np.ones((50, 4), np.float32).tofile(folder / f"{name}.bin")
    busy = folder / "1.bin"
    busy.write_bytes(bytes(64_000_000))
    writer = multiprocessing.get_context("spawn").Process(target=keep_writing, args=(busy,))
    writer.start()
    try:
        before = busy.stat().st_mtime_ns
        while busy.stat().st_mtime_ns == before:
            time.sleep(0.01)
        code, report = convert(capsys, folder, tmp_path / "out", "--to", "npz")
    finally:
        writer.kill()
        writer.join()
    assert (code, report["committed"]) == (4, 2)
    assert {name: kind for name, (kind, _) in skips(tmp_path / "out").items()} == {
        "1": "InputChanged"
    }
    assert convert(capsys, folder, tmp_path / "out", "--to", "npz")[1]["committed"] == 3


@pytest.mark.parametrize("bomb", BOMBS)
def test_a_recording_that_is_a_bomb_is_refused_by_its_place(tmp_path, capsys, bomb):
    path = tmp_path / "a.mcap"
    path.write_bytes(MAGIC + BOMBS[bomb]() + record_bytes(Footer(0, 0, 0)) + MAGIC)
    for verb, *more in (("convert", str(tmp_path / "out")), ("recover",)):
        assert main([verb, str(path), *more, "--json"]) == 3
        error = json.loads(capsys.readouterr().out)["error"]
        assert (error["code"], error["path"]) == ("RecordingError", str(path))
        assert error["where"].startswith("byte ")
        assert error["fix"]
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.mcap"]


# --- links and file systems (rows 52, 63) -----------------------------------------------------


def test_nothing_is_written_through_links_in_the_output(drive, tmp_path, capsys):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    out.mkdir()
    elsewhere.mkdir()
    (out / "pcd").symlink_to(elsewhere)
    code, answer = convert(capsys, drive, out, "--to", "pcd", "--frames", "0:2")
    error = answer["error"]
    assert (code, error["code"], error["path"]) == (5, "OutputError", str(out / "pcd"))
    assert "Remove the link" in error["fix"]
    assert not list(elsewhere.iterdir())
    (out / "pcd").unlink()
    assert convert(capsys, drive, out, "--to", "pcd", "--frames", "0:2")[0] == 0


def test_a_source_that_is_a_loop_of_links_is_told(tmp_path, capsys):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    code, answer = convert(capsys, tmp_path / "loop", tmp_path / "out")
    assert (code, answer["error"]["code"]) == (3, "SourceUnknown")
    assert "a link" in answer["error"]["got"]
    assert answer["error"]["fix"] == "Mend the link."


# Every file that is made and every name that is given, of a run in a process of its own.
WITNESSED = """
import json, os, sys
made, renamed = [], []

def note(event, arguments):
    if event == "os.rename":
        renamed.append([os.fsdecode(path) for path in arguments[:2]])
    elif event == "open" and isinstance(arguments[0], (str, bytes)) and arguments[2] & os.O_CREAT:
        made.append(os.fsdecode(arguments[0]))

from pseudolidar.cli import main
sys.addaudithook(note)
code = main(sys.argv[1:])
print(json.dumps({"code": code, "made": made, "renamed": renamed}))
"""


def test_no_name_is_given_across_file_systems(drive, tmp_path):
    """The output lies on another disk than the input and the folder of temporary files."""
    memory = Path("/dev/shm")
    if not memory.is_dir() or memory.stat().st_dev == tmp_path.stat().st_dev:
        pytest.skip("there is no second file system to write to")
    with tempfile.TemporaryDirectory(dir=memory) as other:
        out = Path(other) / "out"
        line = ["convert", str(drive), str(out), "--to", ALL, "--frames", "0:2"]
        ended = subprocess.run(
            [sys.executable, "-c", WITNESSED, *line],
            env=os.environ | {"TMPDIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        seen = json.loads(ended.stdout.splitlines()[-1])
        assert seen["code"] == 0
        targets = {target for _, target in seen["renamed"]}
        written = {str(path) for path in out.rglob("*") if path.is_file()}
        assert {str(out / "pcd" / "000000.pcd"), str(out / "run.json")} <= targets
        assert written - targets == {str(out / "journal.jsonl")}
        for source, target in seen["renamed"]:
            assert Path(source).parent == Path(target).parent
        # What is not ours (caches of libraries) lies in neither place.
        assert not any(path.startswith(str(tmp_path)) for path in seen["made"])


# --- nothing left (row 12) --------------------------------------------------------------------


def test_a_pair_of_which_no_point_is_left_is_no_empty_cloud(own_drive, tmp_path, capsys):
    """A baseline of a tenth of a millimetre has everything at the lens."""
    rig = json.loads((own_drive / "rig.json").read_text())
    (own_drive / "rig.json").write_text(json.dumps({**rig, "baseline_m": 0.0001}))
    code, answer = convert(capsys, own_drive, tmp_path / "out", "--to", "pcd")
    assert (code, answer["error"]["code"]) == (3, "CloudEmpty")
    assert "removed were 100% near-lens noise" in answer["error"]["got"]
    assert "baseline" in answer["error"]["fix"]
    assert not list((tmp_path / "out").rglob("*.pcd"))


# --- disks (rows 56, 58, 62) ------------------------------------------------------------------


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 16 MB."""
    place = tmp_path / "small"
    place.mkdir()
    line = ["mount", "-t", "tmpfs", "-o", "size=16m", "tmpfs", str(place)]
    if (
        not shutil.which("mount")
        or subprocess.run(line, capture_output=True, check=False).returncode
    ):
        pytest.skip("no file system may be mounted here")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def test_a_full_disk_is_told_and_continued_once_there_is_room(drive, small_disk, tmp_path, capsys):
    options = ("--to", "pcd,ply,mcap", "--frames", "0:6")
    whole = tmp_path / "whole"
    assert convert(capsys, drive, whole, *options)[0] == 0
    size = sum(path.stat().st_size for path in whole.rglob("*") if path.is_file())
    out = small_disk / "out"
    filler = small_disk / "filler"
    filler.write_bytes(bytes(16 * 1024**2 - size // 2))
    code, answer = convert(capsys, drive, out, *options)
    error = answer["error"]
    assert (code, error["code"]) == (5, "OutputError")
    assert "bytes" in error["got"] + error["want"]
    assert "free" in error["got"] + error["want"] + error["fix"]
    assert not list(small_disk.rglob("*.tmp"))
    filler.unlink()
    assert convert(capsys, drive, out, *options)[0] == 0
    for path in whole.rglob("*.pcd"):
        assert (out / "pcd" / path.name).read_bytes() == path.read_bytes()


def test_the_second_of_two_runs_is_told_who_is_first(drive, tmp_path, capsys):
    with own_folder(tmp_path):
        code, answer = convert(capsys, drive, tmp_path)
    error = answer["error"]
    assert (code, error["code"], error["path"]) == (5, "OutputLocked", str(tmp_path))
    assert f"process {os.getpid()} on {socket.gethostname()}" in error["got"]
    assert "since 20" in error["got"]


def test_a_frame_is_durable_before_the_journal_says_so(drive, tmp_path, monkeypatch, capsys):
    """Its bytes, then its name, then the folder, then the journal's line."""
    events = []
    fsync, replace = os.fsync, os.replace

    def noted_fsync(descriptor):
        events.append(("fsync", str(Path(f"/proc/self/fd/{descriptor}").readlink())))
        fsync(descriptor)

    def noted_replace(source, target, **options):
        events.append(("rename", str(source), str(target)))
        replace(source, target, **options)

    if not sys.platform.startswith("linux"):
        pytest.skip("names of descriptors are Linux's")
    monkeypatch.setattr(os, "fsync", noted_fsync)
    monkeypatch.setattr(os, "replace", noted_replace)
    assert convert(capsys, drive, tmp_path, "--frames", "0:2", "--to", "pcd,bin")[0] == 0
    journal = ("fsync", str(tmp_path / "journal.jsonl"))
    for frame, nth in (("000000", 1), ("000001", 2)):
        told = [i for i, event in enumerate(events) if event == journal][nth]
        for kind in ("pcd", "bin"):
            target = str(tmp_path / kind / f"{frame}.{kind}")
            (renamed,) = (i for i, event in enumerate(events) if event[-1] == target)
            written = events.index(("fsync", events[renamed][1]))
            folder = events.index(("fsync", str(tmp_path / kind)), renamed)
            assert written < renamed < folder < told
