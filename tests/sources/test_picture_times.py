"""Sequences of pictures with a file of times: matched by name where it names them."""

from __future__ import annotations

from pathlib import Path

import pytest

from pseudolidar.cli import main
from pseudolidar.errors import SequenceTime
from pseudolidar.sources.folder import Folders
from tests.sources.test_folder import fill, is_pair

T0 = 1_403_636_579_763_555_584


def frames(folder: Path, *names: str) -> Path:
    return fill(folder, *(f"{eye}/{name}.png" for eye in ("left", "right") for name in names))


def test_a_list_is_matched_by_name_and_orders_the_frames(tmp_path: Path) -> None:
    frames(tmp_path, "a", "b", "c", "d")
    (tmp_path / "data.csv").write_text(
        f"#timestamp [ns],filename\n{T0 + 30},b.png\n{T0},d.png\n{T0 + 10},x.png\n{T0 + 20},a.png\n"
    )
    source = Folders(str(tmp_path)).open()
    assert source.ids == ("d", "a", "b")
    assert source.timestamps_ns == (T0, T0 + 20, T0 + 30)
    assert is_pair(source, 0, "left/d.png", "right/d.png")
    assert source.load(2).timestamp_ns == T0 + 30
    assert [(name, type(error)) for name, error in source.refused] == [("c", SequenceTime)]
    assert "no line names 'c.png'" in source.refused[0][1].got
    notes = source.summary.notes
    assert "time: of data.csv, nanoseconds, by the names of the pictures" in notes
    assert "data.csv: 1 lines of pictures that are not there" in notes


@pytest.mark.parametrize(
    "line",
    ["{time} {name}", "{time} left/{name}.png", "{time} D:\\rgb\\{name}.jpg", "{name},{time}"],
)
def test_names_count_with_or_without_folder_and_extension(tmp_path: Path, line: str) -> None:
    frames(tmp_path, "f1", "f2")
    text = "\n".join(line.format(time=f"{n}.5", name=f"f{n}") for n in (2, 1))
    (tmp_path / "t.txt").write_text(text)
    source = Folders(str(tmp_path), times=str(tmp_path / "t.txt")).open()
    assert source.timestamps_ns == (1_500_000_000, 2_500_000_000)


def test_one_list_of_both_eyes(tmp_path: Path) -> None:
    frames(tmp_path, "f1", "f2")
    lines = [f"{n}.{k} {eye}/f{n}.png" for n in (1, 2) for k, eye in enumerate(("left", "right"))]
    (tmp_path / "rgb.txt").write_text("\n".join(lines))
    assert Folders(str(tmp_path)).open().timestamps_ns == (1_000_000_000, 2_000_000_000)


@pytest.mark.parametrize(
    ("text", "where", "got"),
    [
        ("1 a.png\n2 b.png\n3 a.png\n", "line 3", "again, after line 1"),
        ("1 a.png\n1 b.png\n", "line 2", "the same time as line 1"),
        ("1 x.png\n2 y.png\n", "", "none of 2 pictures is in it; it names 'x.png', 'y.png'"),
        ("1 a.png\ntwo b.png\n", "line 2", "'two b.png'"),
    ],
)
def test_lists_that_do_not_fit_are_refused_by_line(tmp_path, text, where, got) -> None:
    frames(tmp_path, "a", "b")
    (tmp_path / "times.txt").write_text(text)
    with pytest.raises(SequenceTime) as caught:
        Folders(str(tmp_path)).open()
    assert caught.value.where.startswith(where)
    assert got in caught.value.got


def test_dates_and_nanoseconds_by_position(tmp_path: Path) -> None:
    frames(tmp_path, "1", "2", "3")
    (tmp_path / "right" / "2.png").unlink()
    file = tmp_path / "timestamps.txt"
    file.write_text("".join(f"2011-09-26 13:02:2{n}.594360375\n" for n in range(3)))
    source = Folders(str(tmp_path)).open()
    assert source.timestamps_ns == (1_317_042_140_594_360_375, 1_317_042_142_594_360_375)
    file.write_text("0\n100000000\n200000000\n")
    assert Folders(str(tmp_path)).open().timestamps_ns == (10**9, 1_200_000_000)


def test_a_file_that_is_named_wins_over_names_that_are_times(tmp_path: Path) -> None:
    frames(tmp_path, str(T0), str(T0 + 10**8))
    (tmp_path / "t.txt").write_text("5\n6\n")
    assert Folders(str(tmp_path)).open().timestamps_ns == (T0, T0 + 10**8)
    source = Folders(str(tmp_path), times=str(tmp_path / "t.txt")).open()
    assert source.timestamps_ns == (5 * 10**9, 6 * 10**9)
    with pytest.raises(SequenceTime):
        Folders(str(tmp_path), times=str(tmp_path / "nowhere.txt")).open()


def test_the_flag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames(tmp_path, "a", "b")
    (tmp_path / "t.txt").write_text("1 a.png\n1 b.png\n")
    line = ["convert", str(tmp_path), str(tmp_path / "out"), "--times", str(tmp_path / "t.txt")]
    assert main(line) == 3
    assert "t.txt: line 2: the same time as line 1" in capsys.readouterr().err
