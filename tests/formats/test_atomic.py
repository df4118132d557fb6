"""The one write path: whole files or none, whatever the disk does."""

from __future__ import annotations

import io
import json
import subprocess
import sys

import pytest

from pseudolidar.errors import OutputError
from pseudolidar.formats.atomic import (
    atomic_file,
    is_temporary,
    temporary_beside,
    write_all,
    write_atomic,
    write_group,
)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


# Files cannot grow beyond 1000 bytes in this process, as on a disk that is full.
ON_A_FULL_DISK = """
import json, resource, signal, sys
from pathlib import Path
from pseudolidar.errors import OutputError
from pseudolidar.formats.atomic import write_atomic, write_group

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
folder = Path(sys.argv[1])
try:
    {write}
except OutputError as error:
    print(json.dumps(error.as_dict()))
"""


def refused_on_a_full_disk(folder, write):
    """The error of an expression; the limit binds a child, not what pytest itself writes."""
    line = [sys.executable, "-c", ON_A_FULL_DISK.format(write=write), str(folder)]
    ended = subprocess.run(line, capture_output=True, text=True, check=True)
    return json.loads(ended.stdout)


def test_a_file_is_replaced_whole_and_its_folder_made(tmp_path):
    path = tmp_path / "new" / "a.pcd"
    for data in (b"first", b"the second one"):
        write_atomic(path, data)
        assert path.read_bytes() == data
    assert names(path.parent) == ["a.pcd"]


def test_a_full_disk_keeps_the_old_file_and_leaves_nothing(tmp_path):
    path = tmp_path / "a.pcd"
    write_atomic(path, b"old")
    error = refused_on_a_full_disk(tmp_path, 'write_atomic(folder / "a.pcd", bytes(2000))')
    assert (error["code"], error["exit_code"], error["path"]) == ("OutputError", 5, str(path))
    assert "2000 bytes" in error["want"]
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == ["a.pcd"]


def test_of_a_group_that_does_not_fit_no_file_appears(tmp_path):
    group = '{folder / "pcd" / "0.pcd": b"fits", folder / "ply" / "0.ply": bytes(2000)}'
    assert refused_on_a_full_disk(tmp_path, f"write_group({group})")["code"] == "OutputError"
    assert names(tmp_path / "pcd") == names(tmp_path / "ply") == []


def test_a_group_lies_where_it_should(tmp_path):
    files = {tmp_path / "pcd" / "0.pcd": b"one", tmp_path / "ply" / "0.ply": b""}
    write_group(files)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.p*")} == files


def test_an_error_inside_the_block_leaves_nothing(tmp_path):
    with pytest.raises(TypeError), atomic_file(tmp_path / "a.bin") as file:
        file.writelines([b"half", None])
    assert names(tmp_path) == []


def test_a_file_of_another_size_than_expected_is_refused(tmp_path):
    with (
        pytest.raises(OutputError, match="4 of 5 bytes"),
        atomic_file(tmp_path / "a.bin", expected_bytes=5) as file,
    ):
        file.write(b"four")
    assert names(tmp_path) == []


def test_leftovers_are_known_by_their_name(tmp_path):
    long_name = tmp_path / ("x" * 250 + ".pcd")
    for path in (tmp_path / "a.pcd", long_name):
        name = temporary_beside(path).name
        assert is_temporary(name)
        assert len(name) <= 255
    assert not is_temporary("a.pcd.tmp")
    assert not is_temporary("a.0123abcd.pcd")


class Slow(io.RawIOBase):
    """Takes `most` bytes at a time."""

    def __init__(self, most: int) -> None:
        self.most, self.taken = most, b""

    def write(self, data: memoryview) -> int:
        self.taken += bytes(data[: self.most])
        return min(self.most, len(data))


def test_all_is_written_in_pieces_or_an_error_told():
    file = Slow(3)
    write_all(file, b"eleven byte")
    assert file.taken == b"eleven byte"
    with pytest.raises(OSError, match="nothing"):
        write_all(Slow(0), b"x")
