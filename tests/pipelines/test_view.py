"""The verb `view`: how it ends, and what it refuses before it serves anything."""

import os
import signal
import webbrowser
from pathlib import Path

import pytest
from pseudolidar.pipelines.view import View

from pseudolidar.cli import main
from pseudolidar.running.describing.describe import describe
from pseudolidar.viewer.opening import RUN_FILE


def test_ctrl_c_is_the_ordinary_way_out(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    opened: list[str] = []

    def pressed(url: str) -> None:
        opened.append(url)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(webbrowser, "open", pressed)
    assert main(["view", "--port", "0", "--named", "robot.lan"]) == 0
    told = capsys.readouterr()
    assert told.err.splitlines() == opened
    assert told.out.strip() == ""


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--share"], "ssh -L 8080:localhost:8080"),
        (["--share", "--port", "9000"], "ssh -L 9000:localhost:9000"),
        (["--named", "robot.lan:8080"], "without port"),
        (["--named", "http://robot"], "without port"),
        (["--named", ""], "without port"),
    ],
)
def test_what_is_not_safe_is_refused(
    flags: list[str], said: str, capsys: pytest.CaptureFixture[str]
):
    assert main(["view", *flags]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("text", ["[" * 100_000, "{", "[]", '{"settings": 3}', '{"settings": {}}'])
def test_a_run_whose_settings_cannot_be_read_has_no_source(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, text: str
):
    (tmp_path / RUN_FILE).write_text(text)
    assert View().reel_of_run(tmp_path) is None
    assert "its source cannot be opened" in caplog.text
    described = describe(str(tmp_path))
    assert "cannot be read" in str(described.unknown)
