"""The calibration doctor as a command, and before every run."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.pictures.disparity_png import write_disparity_png
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.formats.rigs.rig_json import read_rig, write_rig
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.preflight import DATE, check_source
from pseudolidar.sources.other_rig import with_rig
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.source import pairs_of
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.disparity import DisparityMap
from tests.perturbed import right_turned, warped

FRAMES = 4
OF_THE_RUN = {"run.json", "report.json", "report.html", "journal.jsonl"}


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Folders left and right with four rendered pairs of a room, and their rig."""
    folder = tmp_path_factory.mktemp("room") / "room"
    source = Synthetic("room", width_px=480, frames=FRAMES).open()
    for eye in ("left", "right"):
        (folder / eye).mkdir(parents=True)
    for index in range(FRAMES):
        frame = source.load(index)
        for eye, image in (("left", frame.left), ("right", frame.right)):
            cv2.imwrite(str(folder / eye / f"{index:06d}.png"), image[..., ::-1])
    write_rig(folder / "rig.json", replace(source.rig, origin="bench, 2026-11-01"))
    return folder


@pytest.fixture(scope="module")
def swapped(room, tmp_path_factory):
    folder = tmp_path_factory.mktemp("swapped") / "room"
    shutil.copytree(room, folder)
    (folder / "left").rename(folder / "other")
    (folder / "right").rename(folder / "left")
    (folder / "other").rename(folder / "right")
    return folder


@pytest.fixture
def own_room(room, tmp_path):
    folder = tmp_path / "own"
    shutil.copytree(room, folder)
    return folder


def change(folder, how, frames=range(FRAMES), eye="right"):
    for index in frames:
        path = folder / eye / f"{index:06d}.png"
        cv2.imwrite(str(path), how(cv2.imread(str(path))))


def told(capsys, *line):
    """Exit code and object of a command."""
    code = main([*map(str, line), "--json"])
    return code, json.loads(capsys.readouterr().out)


def findings(report):
    return {finding["name"]: finding for finding in report["findings"]}


def tree(folder):
    files = {str(p.relative_to(folder)): p for p in folder.rglob("*") if p.is_file()}
    return {name: p.read_bytes() for name, p in files.items() if name not in OF_THE_RUN}


def test_a_good_source_ends_with_0_and_a_table(room, capsys):
    assert main(["check", str(room)]) == 0
    text = capsys.readouterr().out
    assert "Pairs and calibration fit together." in text
    assert "pairs looked at: 000000, 000001, 000003" in text
    code, report = told(capsys, "check", room)
    assert (code, report["stops"], len(report["pairs"])) == (0, False, 3)
    assert findings(report)["rows"]["typical_px"] < 0.1


def test_swapped_eyes_end_with_3_and_the_flag_that_mends_them(swapped, capsys):
    code, report = told(capsys, "check", swapped)
    eyes = findings(report)["eyes"]
    assert (code, eyes["severity"], eyes["mend"]) == (3, "stop", "Pass --swap.")
    assert told(capsys, "check", swapped, "--swap")[0] == 0
    assert main(["check", str(swapped)]) == 3
    assert "A run would stop: eyes." in capsys.readouterr().out


def test_frames_are_those_that_are_asked_for(room, capsys):
    _, report = told(capsys, "check", room, "--frames", "1:3")
    assert [pair["id"] for pair in report["pairs"]] == ["000001", "000002"]
    _, report = told(capsys, "check", room, "--exclude", "0")
    assert [pair["id"] for pair in report["pairs"]] == ["000001", "000002", "000003"]


def test_the_picture_shows_matches_by_their_row_difference(own_room, tmp_path, capsys):
    change(own_room, lambda image: warped(image, down_px=3))
    out = tmp_path / "check.png"
    code, report = told(capsys, "check", own_room, "--frames", "0", "--picture", out)
    assert (code, report["picture"]) == (3, str(out))
    picture = read_image(out).pixels.astype(int)
    strip = picture.shape[0] - 2 * 360  # drawn at twice the size of 480x360
    body = picture[strip:]
    red = (body[..., 0] > 200) & (body[..., 2] < 120)
    blue = (body[..., 2] > 200) & (body[..., 0] < 120)
    assert red.sum() > 5000 > 50 > blue.sum()


def test_no_run_starts_with_swapped_eyes(swapped, room, tmp_path, capsys):
    code, answer = told(capsys, "convert", swapped, tmp_path / "out", "--to", "bin")
    error = answer["error"]
    assert (code, error["code"], error["fix"]) == (3, "PairSwapped", "Pass --swap.")
    assert "000000, 000001, 000003" in error["where"]
    assert not list((tmp_path / "out").glob("bin/*"))
    # The flag that it names mends it in the same folder, and gives what right folders give.
    assert main(["convert", str(swapped), str(tmp_path / "out"), "--to", "bin", "--swap"]) == 0
    assert main(["convert", str(room), str(tmp_path / "right"), "--to", "bin"]) == 0
    assert tree(tmp_path / "out") == tree(tmp_path / "right")
    capsys.readouterr()
    assert told(capsys, "convert", swapped, tmp_path / "dry", "--dry-run")[0] == 3
    for line in (
        ("evaluate", "disparity", swapped),
        ("compare", swapped),
        ("compare", swapped, tmp_path / "compared"),
        ("refine", swapped, "--by", "rows", "--out", tmp_path / "rig.json"),
    ):
        assert told(capsys, *line)[1]["error"]["code"] == "PairSwapped", line


@pytest.mark.parametrize("how", [{"down_px": 2.0}, {"roll_deg": 1.0}])
def test_no_run_starts_with_rows_that_are_off(own_room, tmp_path, capsys, how):
    change(own_room, lambda image: warped(image, **how))
    code, answer = told(capsys, "convert", own_room, tmp_path / "out", "--to", "bin")
    assert (code, answer["error"]["code"]) == (3, "NotRectified")
    line = ["convert", str(own_room), str(tmp_path / "out"), "--to", "bin"]
    assert main([*line, "--no-check"]) == 0
    assert json.loads((tmp_path / "out" / "report.json").read_text())["warnings"] == []


def test_the_command_that_is_named_puts_rows_right(own_room, tmp_path, capsys):
    change(own_room, lambda image: warped(image, down_px=3.0, roll_deg=0.5))
    code, report = told(capsys, "check", own_room)
    rows = findings(report)["rows"]
    assert (code, rows["severity"]) == (3, "stop")
    command = rows["mend"].split("`")[1].split()[1:]
    rig = tmp_path / "rig.json"
    words = {"SOURCE": str(own_room), "rig.json": str(rig)}
    assert main([words.get(word, word) for word in command]) == 0
    capsys.readouterr()
    code, report = told(capsys, "check", own_room, "--rig", rig)
    assert (code, findings(report)["rows"]["severity"]) == (0, "good")


def test_another_size_than_the_calibration_stops(own_room, capsys, tmp_path):
    for eye in ("left", "right"):
        change(own_room, lambda image: cv2.resize(image, (400, 300)), eye=eye)
    code, answer = told(capsys, "check", own_room)
    assert (code, answer["error"]["code"]) == (3, "CalibrationSizeMismatch")
    assert "--scale-calibration" in answer["error"]["fix"]
    assert told(capsys, "check", own_room, "--scale-calibration")[0] == 0


def test_a_size_that_is_wrong_in_one_frame_is_a_warning(own_room, capsys):
    for eye in ("left", "right"):
        change(own_room, lambda image: cv2.resize(image, (400, 300)), [3], eye)
    code, report = told(capsys, "check", own_room)
    assert (code, findings(report)["size"]["severity"]) == (0, "warn")
    assert [frame["id"] for frame in report["unreadable"]] == ["000003"]


def test_oddities_are_a_line_of_the_log_and_of_the_report(own_room, tmp_path, caplog):
    def darker(image):
        return (image * 0.6).astype(np.uint8)

    change(own_room, darker)
    out = tmp_path / "out"
    line = ["convert", str(own_room), str(out), "--to", "bin"]
    assert main(line) == 0
    (warning,) = json.loads((out / "report.json").read_text())["warnings"]
    assert warning.startswith("exposure: the right picture is 0.")
    assert "\n" not in warning
    assert f"check: {warning}" in caplog.messages
    assert warning.split(":")[0] in (out / "report.html").read_text()
    caplog.clear()
    assert main(line) == 0  # complete: nothing is looked at again
    assert not any(message.startswith("check:") for message in caplog.messages)


def test_the_same_bytes_with_and_without(room, tmp_path):
    for name, flags in (("with", []), ("without", ["--no-check"]), ("apart", ["--isolate"])):
        line = ["convert", str(room), str(tmp_path / name), "--to", "bin,mcap", *flags]
        assert main(line) == 0
    assert tree(tmp_path / "with") == tree(tmp_path / "without") == tree(tmp_path / "apart")


def test_rendered_worlds_are_not_looked_at(tmp_path, monkeypatch, caplog):
    """Even with a rig that is wrong: it is their point."""
    line = ["convert", "synthetic:room:1", str(tmp_path), "--swap", "--to", "bin"]
    assert main([*line, "--source.width-px", "320"]) == 0
    assert not any(message.startswith("check:") for message in caplog.messages)


def test_given_maps_are_looked_at_too(room, tmp_path, capsys):
    source = Synthetic("room", width_px=480, frames=1).open()
    truth = source.load(0).truth
    for scale, code in ((1.0, 0), (16.0, 3)):
        maps = tmp_path / f"maps{scale:g}"
        maps.mkdir()
        write_disparity_png(maps / "000000.png", DisparityMap(truth.values * np.float32(scale)))
        line = ("check", room, "--frames", "0", "--disparity", maps, "--map-scale", "256")
        got, report = told(capsys, *line)
        assert got == code
        maps_found = findings(report)["given maps"]
        assert maps_found["severity"] == ("good" if code == 0 else "stop")
        assert ("--map-scale" in maps_found["mend"]) == (code == 3)


def test_sources_without_pairs_are_told_so(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["convert", "synthetic:room:1", str(out), "--source.width-px", "320"]) == 0
    capsys.readouterr()
    code, answer = told(capsys, "check", out / "pcd")
    assert (code, answer["error"]["code"]) == (3, "NoPairs")


def test_damaged_pictures_are_named_and_the_others_looked_at(own_room, capsys):
    (own_room / "left" / "000000.png").write_bytes(b"no picture")
    code, report = told(capsys, "check", own_room)
    assert (code, findings(report)["rows"]["severity"]) == (0, "good")
    assert [frame["id"] for frame in report["unreadable"]] == ["000000"]
    for path in own_room.glob("left/*"):
        path.write_bytes(b"no picture")
    code, answer = told(capsys, "check", own_room)
    assert (code, answer["error"]["code"]) == (3, "ImageUnreadable")


def test_a_rig_of_another_day_is_a_warning(room):
    source = pairs_of(recognise(str(room)).open())
    for origin, severities in (("bench, 2020-01-02", ["warn"]), ("bench, 2026-11-01", [])):
        given = with_rig(source, replace(source.rig, origin=origin))
        check = check_source(given, [0], crew=CrewPlan(1))
        assert [f.severity for f in check.findings if f.name == DATE] == severities
        assert check.error is None
        assert len(check.warnings) == len(severities)


def test_the_focal_length_of_another_matrix_is_a_warning(room):
    source = pairs_of(recognise(str(room)).open())
    K = source.rig.left.K.copy()
    K[0, 0] = K[1, 1] = 1.33 * K[0, 0]
    own = source.rig
    other = replace(own, left=replace(own.left, K=K), right=replace(own.right, K=K))
    (line,) = check_source(with_rig(source, other), [0], crew=CrewPlan(1)).warnings
    assert line.startswith("focal length: ")


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from pseudolidar.cli import main; main(['check', '--help']); "
        "sys.exit(int('scipy' in sys.modules or 'numba' in sys.modules))"
    )
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)


def turned_room(room, folder, turn_deg):
    """The room with its right eye turned against what the rig says."""
    shutil.copytree(room, folder)
    source = pairs_of(recognise(str(room)).open())
    for index, name in enumerate(source.ids):
        frame = right_turned(source.load(index), turn_deg)
        cv2.imwrite(str(folder / "right" / f"{name}.png"), frame.right[..., ::-1])
    return folder


def test_the_rig_of_a_turned_eye_is_mended(room, tmp_path, capsys):
    """Found with its angles, written, and taken: with it the pairs are right again."""
    bent, out = turned_room(room, tmp_path / "bent", (0.1, 0, 0.25)), tmp_path / "rig.json"
    call = ["check", str(bent), "--frames", "0::1", "--out", str(out), "--json"]
    main(call)
    report = json.loads(capsys.readouterr().out)
    turn = next(f for f in report["findings"] if f["name"] == "rotation")
    assert turn["severity"] == "note"
    assert turn["pitch_deg"] == pytest.approx(0.1, abs=0.03)
    assert turn["roll_deg"] == pytest.approx(0.25, abs=0.03)
    assert report["out"] == str(out)
    assert main(["check", str(bent), "--rig", str(out), "--frames", "0::1", "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    rows = {f["name"]: f for f in again["findings"]}
    assert rows["rotation"]["severity"] == "good"
    assert rows["rotation"]["rows_before_px"] < 0.2
    assert main(call) == 2  # it is there already
    assert "--overwrite" in json.loads(capsys.readouterr().out)["error"]["fix"]
    assert main([*call, "--overwrite"]) in (0, 3)
    assert out.with_name("rig.previous.json").is_file()


def test_no_rig_is_written_where_no_eye_is_turned(room, tmp_path, capsys):
    out = tmp_path / "rig.json"
    assert main(["check", str(room), "--out", str(out)]) == 0
    assert "no rig is written" in capsys.readouterr().out
    assert not out.exists()


def test_a_rig_of_unknown_scale_warns_and_is_compared_with_nothing(own_room, capsys):
    rig = replace(read_rig(own_room / "rig.json"), metric=False)
    write_rig(own_room / "rig.json", rig)
    assert main(["check", str(own_room), "--json"]) == 0
    findings = {f["name"]: f for f in json.loads(capsys.readouterr().out)["findings"]}
    assert findings["baseline"]["severity"] == "warn"
    assert "not metres" in findings["baseline"]["text"]
    assert main(["compare", str(own_room), "--json"]) == 3
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "CalibrationUnits"
    assert main(["refine", str(own_room), "--out", str(own_room / "new.json"), "--json"]) == 3
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "CalibrationUnits"
    assert main(["info", str(own_room)]) == 0
    assert "no metres" in capsys.readouterr().out
