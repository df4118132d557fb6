import json

import pytest

from pseudolidar.errors import OutputSettings
from pseudolidar.running.journal.journal import Journal
from pseudolidar.running.journal.journal_file import JOURNAL_NAME
from pseudolidar.running.journal.record import FileRecord, FrameRecord, OutputFile

SETTINGS = {"matcher": {"kind": "census", "quality": "fast"}, "to": "pcd"}


def commit(journal, index, data=b"data"):
    file = OutputFile.of(f"pcd/{index:06d}.pcd", data)
    names = (FileRecord(file.name, len(data), file.crc32),)
    journal.commit(FrameRecord(f"{index:06d}", index, names, {"points": index}), [file])


@pytest.fixture
def three_frames(tmp_path):
    with Journal.open(tmp_path, SETTINGS) as journal:
        for index in range(3):
            commit(journal, index, bytes([index]) * 10)
    return tmp_path


def committed(folder, settings=SETTINGS, **options):
    with Journal.open(folder, settings, **options) as journal:
        return sorted(journal.committed)


def test_commits_files_and_figures(three_frames):
    assert (three_frames / "pcd" / "000002.pcd").read_bytes() == b"\2" * 10
    with Journal.open(three_frames, SETTINGS) as journal:
        assert sorted(journal.committed) == ["000000", "000001", "000002"]
        assert [record.figures["points"] for record in journal.records()] == [0, 1, 2]


def test_a_line_is_there_before_the_next_frame(tmp_path):
    with Journal.open(tmp_path, SETTINGS) as journal:
        commit(journal, 0)
        lines = (tmp_path / JOURNAL_NAME).read_bytes().splitlines()
        assert [json.loads(line).get("id") for line in lines] == [None, "000000"]


@pytest.mark.parametrize("cut", range(1, 40, 7))
def test_a_torn_last_line_is_dropped(three_frames, cut):
    path = three_frames / JOURNAL_NAME
    path.write_bytes(path.read_bytes()[:-cut])
    assert committed(three_frames) == ["000000", "000001"]
    assert path.read_bytes().endswith(b"\n"), "the next line must not join the torn one"


def test_a_torn_first_line_starts_anew(three_frames):
    path = three_frames / JOURNAL_NAME
    path.write_bytes(path.read_bytes()[:20])
    assert committed(three_frames) == []
    assert json.loads(path.read_bytes())["settings"] == SETTINGS


def test_a_damaged_line_counts_as_not_written(three_frames):
    path = three_frames / JOURNAL_NAME
    lines = path.read_bytes().splitlines(keepends=True)
    lines[2] = lines[2].replace(b'"files"', b'"piles"')
    path.write_bytes(b"".join(lines))
    assert committed(three_frames) == ["000000", "000002"]


@pytest.mark.parametrize(
    "damage",
    [
        lambda path: path.unlink(),
        lambda path: path.write_bytes(path.read_bytes()[:-1]),
        lambda path: path.write_bytes(b"\1" * 9 + b"\0"),
    ],
    ids=["missing", "cut", "changed"],
)
def test_damaged_files_are_done_again(three_frames, damage):
    damage(three_frames / "pcd" / "000001.pcd")
    assert committed(three_frames) == ["000000", "000002"]


def test_a_frame_done_again_counts_once(three_frames):
    (three_frames / "pcd" / "000001.pcd").unlink()
    with Journal.open(three_frames, SETTINGS) as journal:
        commit(journal, 1, b"new")
    with Journal.open(three_frames, SETTINGS) as journal:
        assert len(journal.records()) == 3
        assert len(journal.committed) == 3


def test_a_skipped_frame_is_tried_again(tmp_path):
    error = {"code": "ImageMissing", "got": "no file"}
    with Journal.open(tmp_path, SETTINGS) as journal:
        journal.commit(FrameRecord("000000", 0, skipped=error))
    with Journal.open(tmp_path, SETTINGS) as journal:
        assert not journal.committed
        assert journal.records()[0].skipped == error
        commit(journal, 0)
        assert journal.records()[0].skipped is None


def test_other_settings_are_refused_with_both_values(three_frames):
    other = {"matcher": {"kind": "census", "quality": "fine"}, "to": "pcd"}
    before = (three_frames / JOURNAL_NAME).read_bytes()
    with pytest.raises(OutputSettings) as caught:
        committed(three_frames, other)
    assert caught.value.where == "matcher.quality"
    assert '"fast"' in caught.value.got
    assert '"fine"' in caught.value.got
    assert caught.value.exit_code == 2
    assert (three_frames / JOURNAL_NAME).read_bytes() == before


def test_overwrite_deletes_what_the_journal_names_and_nothing_else(three_frames):
    (three_frames / "pcd" / "mine.pcd").write_bytes(b"mine")
    (three_frames / "notes.txt").write_bytes(b"mine")
    assert committed(three_frames, {"to": "ply"}, overwrite=True) == []
    left = sorted(path.name for path in three_frames.rglob("*") if path.is_file())
    assert left == [JOURNAL_NAME, "mine.pcd", "notes.txt"]


def test_a_journal_cannot_name_files_outside(three_frames, tmp_path_factory):
    outside = tmp_path_factory.mktemp("outside") / "victim"
    outside.write_bytes(b"mine")
    path = three_frames / JOURNAL_NAME
    path.write_bytes(path.read_bytes().replace(b"pcd/000001.pcd", str(outside).encode()))
    committed(three_frames, overwrite=True)
    assert outside.read_bytes() == b"mine"


def test_a_journal_of_something_else_is_refused(tmp_path):
    (tmp_path / JOURNAL_NAME).write_bytes(b'{"schema": 99, "settings": {}, "products": []}\n')
    with pytest.raises(OutputSettings, match="99"):
        committed(tmp_path)
    (tmp_path / JOURNAL_NAME).write_bytes(b"[]\n")
    with pytest.raises(OutputSettings):
        committed(tmp_path)
