from __future__ import annotations

import json
from pathlib import Path

import pytest

from pseudolidar.cli import main
from tests.formats.mcap.test_recover import ours, part_path, read, write


@pytest.fixture
def cut(tmp_path: Path) -> Path:
    path = tmp_path / "drive.mcap"
    write(path)
    path.write_bytes(path.read_bytes()[:-10_000])
    return path


def test_a_cut_file_is_saved_beside_it(cut: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = cut.read_bytes()
    assert main(["recover", str(cut)]) == 4
    saved = read(cut.with_name("drive_recovered.mcap"))
    out = capsys.readouterr().out
    assert f"{len(saved)} messages recovered" in out
    assert "byte " in out
    assert cut.read_bytes() == before


def test_the_same_as_json(cut: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recover", str(cut), str(cut.with_name("new.mcap")), "--json"]) == 4
    told = json.loads(capsys.readouterr().out)
    assert told["messages"] == len(read(cut.with_name("new.mcap")))
    assert told["messages"] == sum(t["recovered"] for t in told["topics"].values())
    assert (told["intact"], told["lost_known"], told["attachments"]) == (False, False, 1)
    assert told["damage"][-1]["byte"] == cut.stat().st_size


def test_an_intact_file_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path / "a.mcap")
    assert main(["recover", str(tmp_path / "a.mcap")]) == 0
    assert "intact: 300 messages" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_a_part_of_whole_frames_loses_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ours(tmp_path / "a.mcap", 3)
    assert main(["recover", str(part_path(tmp_path / "a.mcap"))]) == 0
    assert "0 lost" in capsys.readouterr().out
    assert len(read_topics(tmp_path / "a_recovered.mcap")) > 4


def read_topics(path: Path) -> set[str]:
    from mcap.reader import make_reader

    with path.open("rb") as file:
        return {channel.topic for _, channel, _ in make_reader(file).iter_messages()}


def test_nothing_is_written_over(cut: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = cut.with_name("drive_recovered.mcap")
    other.write_text("mine")
    assert main(["recover", str(cut)]) == 2
    assert other.read_text() == "mine"
    assert "--overwrite" in capsys.readouterr().err
    assert main(["recover", str(cut), "--overwrite"]) == 4
    assert read(other)


def test_the_damaged_file_is_never_written_over(
    cut: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = cut.read_bytes()
    (cut.parent / "link.mcap").symlink_to(cut)
    for out in (cut, cut.parent / "link.mcap"):
        assert main(["recover", str(cut), str(out), "--overwrite"]) == 2
        assert "the damaged recording itself" in capsys.readouterr().err
    assert cut.read_bytes() == before


@pytest.mark.parametrize("content", [b"", b"some text"])
def test_what_is_no_recording_is_refused(
    tmp_path: Path, content: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.mcap").write_bytes(content)
    assert main(["recover", str(tmp_path / "a.mcap")]) == 3
    assert "nothing that can be saved" in capsys.readouterr().err
    assert main(["recover", str(tmp_path / "absent.mcap")]) == 3
    assert "no such file" in capsys.readouterr().err


@pytest.mark.real
def test_a_cut_recording_of_other_software(real_data: Path, tmp_path: Path) -> None:
    whole = real_data / "mcap" / "nav2_turtlebot.mcap"
    assert main(["recover", str(whole), str(tmp_path / "out.mcap")]) == 0
    path = tmp_path / "nav2.mcap"
    path.write_bytes(whole.read_bytes()[:300_000])
    assert main(["recover", str(path)]) == 4
    from rosbags.highlevel import AnyReader

    with AnyReader([tmp_path / "nav2_recovered.mcap"]) as reader:
        kinds = {connection.msgtype for connection in reader.connections}
        count = sum(
            bool(reader.deserialize(raw, connection.msgtype))
            for connection, _, raw in reader.messages()
        )
    assert "tf2_msgs/msg/TFMessage" in kinds
    assert count > 6000
