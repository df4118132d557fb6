"""The verb `view`: how it ends, and what it refuses before it serves anything."""

import os
import signal
import webbrowser

import pytest

from pseudolidar.cli import main


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
