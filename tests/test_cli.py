"""The command line, through its door: a user's pipeline file, real arguments, real exit codes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pseudolidar.cli import main
from pseudolidar.commandline.verbs import pipelines_folder
from pseudolidar.running.settings_docs import doc_parts

JOB = Path(__file__).parent / "example_job.py"
KITTI = {"kind": "kitti-raw", "path": "kitti/a", "camera": "colour"}


def settings_of(capsys: pytest.CaptureFixture[str], *args: str) -> dict[str, Any]:
    """Resolved settings of the example job, as it reports them."""
    assert main(["run", str(JOB), "--json", *args]) == 0, capsys.readouterr().err
    settings: dict[str, Any] = json.loads(capsys.readouterr().out)["settings"]
    return settings


def error_of(capsys: pytest.CaptureFixture[str], *args: str) -> dict[str, Any]:
    """The error object of a call that must fail; the terminal must show one line besides."""
    code = main(["--json", *args])
    captured = capsys.readouterr()
    error: dict[str, Any] = json.loads(captured.out)["error"]
    assert error["exit_code"] == code != 0
    assert captured.err.count("\n") == 1
    assert captured.err.startswith(error["code"])
    return error


def command(*args: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "pseudolidar.cli", *args],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, **environment},
        check=False,
    )


def job(*args: str) -> list[str]:
    return ["run", str(JOB), *args]


# --- flags, places, choices ------------------------------------------------------------------


@pytest.mark.parametrize(
    "args",
    [
        ["kitti/a", "out", "--workers", "3", "--shift", "-2"],
        ["--workers", "3", "kitti/a", "--shift", "-2", "out"],
        ["--workers=3", "--shift=-2", "--no-noisy", "kitti/a", "out"],
        ["--shift", "-2", "kitti/a", "--no-noisy", "out", "--workers", "3"],
    ],
)
def test_places_may_stand_anywhere_among_flags(
    capsys: pytest.CaptureFixture[str], args: list[str]
) -> None:
    settings = settings_of(capsys, *args)
    assert settings["source"] == KITTI
    assert (settings["out"], settings["workers"], settings["shift"]) == ("out", 3, -2.0)


@pytest.mark.parametrize(
    ("args", "matcher"),
    [
        ([], {"kind": "census", "quality": "fast", "disparities": None}),
        (["--matcher", "census:fine"], {"kind": "census", "quality": "fine", "disparities": None}),
        (
            ["--matcher.disparities", "64", "--matcher=census:fine"],
            {"kind": "census", "quality": "fine", "disparities": 64},
        ),
        (
            ["--matcher", "block-match", "--matcher.block-size", "3"],
            {"kind": "block-match", "block_size": 3},
        ),
        (["--matcher", "block-match:7"], {"kind": "block-match", "block_size": 7}),
        (["--matcher", "census", "--matcher", "nothing"], {"kind": "nothing"}),
    ],
)
def test_a_choice_is_picked_by_name_and_brings_its_own_flags(
    capsys: pytest.CaptureFixture[str], args: list[str], matcher: dict[str, Any]
) -> None:
    assert settings_of(capsys, "kitti/a", *args)["matcher"] == matcher


def test_a_choice_may_be_none(capsys: pytest.CaptureFixture[str]) -> None:
    assert settings_of(capsys, "kitti/a")["gate"] is None
    gate = settings_of(capsys, "kitti/a", "--gate", "block-match:7")["gate"]
    assert gate == {"kind": "block-match", "block_size": 7}
    assert settings_of(capsys, "kitti/a", "--gate", "none")["gate"] is None


@pytest.mark.parametrize(
    ("args", "source"),
    [
        (["world:room"], {"kind": "world", "name": "room", "seed": 0, "rain": False}),
        (
            ["--source.rain", "world:room", "--source.seed", "3"],
            {"kind": "world", "name": "room", "seed": 3, "rain": True},
        ),
        (["kitti/a", "--source.camera", "grey"], {**KITTI, "camera": "grey"}),
        (["kitti/a", "--camera=grey"], {**KITTI, "camera": "grey"}),
        (
            ["--rain", "world:room", "--seed", "3"],
            {"kind": "world", "name": "room", "seed": 3, "rain": True},
        ),
        (
            ["--rain", "world:room", "--source.no-rain"],
            {"kind": "world", "name": "room", "seed": 0, "rain": False},
        ),
        (
            ["--source", "kitti-raw", "world:x", "--source.camera=grey"],
            {"kind": "kitti-raw", "path": "world:x", "camera": "grey"},
        ),
        (["--source", "kitti-raw:kitti/a"], KITTI),
        (
            ["--source", "world", "street"],
            {"kind": "world", "name": "street", "seed": 0, "rain": False},
        ),
    ],
)
def test_a_source_is_recognised_or_forced(
    capsys: pytest.CaptureFixture[str], args: list[str], source: dict[str, Any]
) -> None:
    settings = settings_of(capsys, *args, "out")
    assert (settings["source"], settings["out"]) == (source, "out")


def test_the_verbs_own_flags_win_over_those_of_the_source() -> None:
    from pseudolidar.pipelines.convert import Convert

    from pseudolidar.commandline.bare_flags import bare_flags

    flags = bare_flags(Convert)
    assert {"--sequence", "--camera", "--rate", "--left-pattern"} <= set(flags)
    assert flags["--rate"] == "--source.rate"
    # The selection of frames, the rig and its scaling are the verb's; SOURCE itself is no flag.
    assert not {"--frames", "--rig", "--scale-calibration", "--path", "--json"} & set(flags)


def test_values_with_a_constructor_from_text(capsys: pytest.CaptureFixture[str]) -> None:
    assert settings_of(capsys, "kitti/a", "--to", "ply,mcap")["to"] == "ply,mcap"


@pytest.mark.parametrize(
    ("args", "said"),
    [
        ([], "SOURCE"),
        (["kitti", "--matcher", "cenzus"], "Did you mean 'census'"),
        (["kitti", "--wokers", "2"], "Did you mean '--workers'"),
        (["kitti", "--matcher.block-size", "3"], "--matcher block-match"),
        (["world:room", "--source.name", "street"], "given by SOURCE"),
        (["world:room", "--camera", "grey"], "--source kitti-raw"),
        (["world:room", "--sead", "3"], "Did you mean '--seed'"),
        (["kitti", "--matcher", "census:best"], "--matcher.quality"),
        (["kitti", "--matcher", "nothing:3"], "no value after a colon"),
        (["kitti", "--workers", "two"], "--workers"),
        (["kitti", "--to", "doc"], "--to"),
        (["kitti", "--matcher"], "no value"),
        (["kitti", "out", "more"], "more"),
        (["--source", "world", "kitti"], "kitti"),
    ],
)
def test_usage_errors_exit_2_and_name_the_argument(
    capsys: pytest.CaptureFixture[str], args: list[str], said: str
) -> None:
    error = error_of(capsys, *job(*args))
    assert (error["code"], error["exit_code"]) == ("UsageError", 2)
    assert said in " ".join(map(str, error.values()))


def test_a_usage_error_is_one_sentence_on_any_terminal() -> None:
    """Without characters for its box tyro draws rules of dashes."""
    for args in (["kitti", "out", "more"], ["kitti", "--workers", "two"], []):
        ended = command(*job(*args), PYTHONIOENCODING="ascii", PYTHONUTF8="0", LC_ALL="C")
        assert ended.returncode == 2
        assert "---" not in ended.stderr
        assert len(ended.stderr.splitlines()) == 1


def test_an_unknown_verb_suggests_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    error = error_of(capsys, "docter")
    assert error["exit_code"] == 2
    assert "'doctor'" in error["fix"]


def test_a_file_that_is_no_pipeline_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "empty_job.py").write_text("")
    (tmp_path / "json.py").write_text("")
    for name, said in [("empty_job.py", "run(settings)"), ("json.py", "another name")]:
        error = error_of(capsys, "run", str(tmp_path / name))
        assert error["exit_code"] == 2
        assert said in error["want"] + error["fix"]
    assert error_of(capsys, "run", str(tmp_path / "absent.py"))["exit_code"] == 2


# --- the settings of an earlier run ------------------------------------------------------------


def test_settings_of_an_earlier_run_come_back_and_flags_override(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    first = settings_of(capsys, "kitti/a", "out", "--matcher", "block-match:7", "--to", "ply")
    file = tmp_path / "run.json"
    file.write_text(json.dumps({"verb": "x", "settings": first}))
    assert settings_of(capsys, "--settings", str(file)) == first
    changed = settings_of(capsys, f"--settings={file}", "--matcher.block-size", "9", "--workers=5")
    assert changed == {
        **first,
        "workers": 5,
        "matcher": {"kind": "block-match", "block_size": 9},
    }
    other = settings_of(capsys, "--settings", str(file), "world:room", "--matcher", "census")
    assert (other["source"]["kind"], other["matcher"]["kind"]) == ("world", "census")
    assert other["to"] == "ply"


@pytest.mark.parametrize("text", ["", "[]", '{"speed": 1}', "[" * 100_000, "\xff"])
def test_a_settings_file_that_is_none_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, text: str
) -> None:
    file = tmp_path / "run.json"
    file.write_bytes(text.encode("latin-1"))
    error = error_of(capsys, *job("kitti", "--settings", str(file)))
    assert (error["exit_code"], error["path"]) == (2, str(file))


def test_tuned_settings_are_taken_by_what_has_them(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "settings.json"
    tuned = {"matcher": {"kind": "block-match", "block_size": 11}, "smooth": None}
    file.write_text(json.dumps({"schema": 1, "tuned": {"by": "truth"}, "settings": tuned}))
    settings = settings_of(capsys, "kitti/a", "--settings", str(file), "--workers", "3")
    assert settings["matcher"] == {"kind": "block-match", "block_size": 11}
    assert (settings["source"], settings["workers"]) == (KITTI, 3)
    over = settings_of(capsys, "kitti/a", "--settings", str(file), "--matcher.block-size", "5")
    assert over["matcher"]["block_size"] == 5
    # Settings of a run must all be known, and those that are known must be right.
    file.write_text(json.dumps({"settings": tuned}))
    assert "smooth" in error_of(capsys, *job("kitti/a", "--settings", str(file)))["got"]
    wrong = {"tuned": {}, "settings": {"matcher": {"kind": "guess"}}}
    file.write_text(json.dumps({"schema": 1, **wrong}))
    assert error_of(capsys, *job("kitti/a", "--settings", str(file)))["where"] == "matcher"
    file.write_text(json.dumps(wrong))
    assert error_of(capsys, *job("kitti/a", "--settings", str(file)))["where"] == "schema"


# --- results, errors, exit codes -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("args", "code", "kind"),
    [
        (["nowhere"], 3, "SourceUnknown"),
        (["kitti", "--matcher", "block-match:4"], 3, "StereoConfig"),
        (["kitti", "--fail", "disk"], 5, "OutputError"),
        (["kitti", "--fail", "import"], 5, "MissingDependency"),
        (["kitti", "--fail", "bug"], 1, "ValueError"),
    ],
)
def test_errors_end_with_their_code(
    capsys: pytest.CaptureFixture[str], args: list[str], code: int, kind: str
) -> None:
    error = error_of(capsys, *job(*args))
    assert (error["exit_code"], error["code"]) == (code, kind)
    assert set(error) == {"path", "where", "got", "want", "fix", "code", "exit_code"}


def test_the_reports_own_code_is_the_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(job("kitti", "--fail", "skip")) == 4
    assert "KittiRaw" in capsys.readouterr().out


def test_a_traceback_is_shown_for_debug_alone(capsys: pytest.CaptureFixture[str]) -> None:
    main(job("kitti", "--fail", "bug"))
    assert "Traceback" not in capsys.readouterr().err
    main(job("kitti", "--fail", "bug", "--debug"))
    assert "Traceback" in capsys.readouterr().err


def test_json_is_alone_on_the_standard_output_even_when_native_code_prints() -> None:
    ended = command(*job("kitti", "--json", "--noisy"))
    assert json.loads(ended.stdout)["error_m"] is None
    assert "noise\n" in ended.stderr
    assert "noise from C" in ended.stderr


@pytest.mark.parametrize(("name", "code"), [("sigint", 130), ("sigterm", 143)])
def test_signals_end_with_their_code(name: str, code: int) -> None:
    ended = command(*job("kitti", "--json", "--fail", name))
    assert ended.returncode == code
    assert json.loads(ended.stdout)["error"]["code"] == "Interrupted"
    assert "Traceback" not in ended.stderr


# --- help --------------------------------------------------------------------------------------


def test_help_of_a_verb_shows_examples_places_choices_and_the_flags_of_the_chosen(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(job("--help")) == 0
    text = capsys.readouterr().out
    for part in ["Turn pairs into clouds", "--matcher blocks", "SOURCE", "[OUT]", "--json"]:
        assert part in text
    assert "{census,block-match,nothing}" in text
    assert "processes that match, two by default" in text
    assert "--matcher.quality" in text
    assert "--matcher.block-size" not in text
    assert main(job("--matcher", "block-match", "--help")) == 0
    text = capsys.readouterr().out
    assert "--matcher.block-size" in text
    assert "--matcher.quality" not in text


def test_indented_lines_of_a_docstring_are_examples() -> None:
    doc = (
        "Do it.\n\nMore\nof it.\n\n    do it now\n\nArgs:\n    a: one,\n        two.\n    b: three."
    )
    parts = doc_parts(doc)
    assert (parts.summary, parts.body) == ("Do it.", "Do it.\n\nMore\nof it.")
    assert parts.examples == ("do it now",)
    assert parts.fields == {"a": "one, two.", "b": "three."}


def test_help_of_a_source_shows_its_flags(capsys: pytest.CaptureFixture[str]) -> None:
    for args in (["world:room", "--help"], ["--help", "--source", "world"]):
        assert main(job(*args)) == 0
        assert "--rain, --no-rain" in capsys.readouterr().out
    assert main(job("nowhere", "--help")) == 0


def test_overview_lists_every_verb_with_its_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    for file in pipelines_folder().glob("*.py"):
        assert f"  {file.stem}" in text
    assert main([]) == 2
    assert "usage" in capsys.readouterr().err


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    from pseudolidar import __version__

    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"pseudolidar {__version__}\n"


@pytest.mark.parametrize("args", [["--help"], ["doctor", "--help"]])
def test_a_reader_that_goes_away_is_no_error(args: list[str]) -> None:
    line = " ".join([sys.executable, "-m", "pseudolidar.cli", *args])
    shell = f"set -o pipefail; {line} | head -n 0"
    ended = subprocess.run(
        ["bash", "-c", shell], capture_output=True, text=True, timeout=60, check=False
    )
    assert (ended.returncode, ended.stderr) == (0, "")


def test_names_that_are_no_text_are_printed_escaped() -> None:
    ended = command(*job("no\udcffwhere"), PYTHONIOENCODING="utf-8")
    assert ended.returncode == 3
    assert "no\\udcffwhere" in ended.stderr


@pytest.mark.parametrize("given_up", [True, False])
def test_a_frame_that_was_given_up_does_not_take_the_status_away(given_up):
    """The interpreter is not ended around a thread in a library, which would abort the process."""
    script = f"""
import atexit, sys, threading, time
from pseudolidar.cli import program
from pseudolidar.running.crew.given_up import WORKER_NAME
atexit.register(print, "the interpreter ended")
if {given_up}:
    threading.Thread(target=time.sleep, args=(600,), name=WORKER_NAME + "-0", daemon=True).start()
sys.argv = ["pseudolidar", "info", "no such place"]
program()
"""
    ended = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=120
    )
    assert ended.returncode == 3
    assert "no such place" in ended.stderr
    assert ("the interpreter ended" in ended.stdout) == (not given_up)
