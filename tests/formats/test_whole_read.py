"""Files that somebody writes to while they are read."""

import multiprocessing
import os
import time
from pathlib import Path

import pytest

from pseudolidar.errors import ImageUnreadable, InputChanged
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.formats.points.ply import read_ply
from pseudolidar.formats.points.velodyne_bin import read_velodyne_bin
from pseudolidar.formats.whole_read import read_whole


class Written(type(Path())):
    """A file that another program finishes during the first `times` readings."""

    times = 1
    readings = 0

    def read_bytes(self):
        data = super().read_bytes()
        type(self).readings += 1
        if self.readings <= self.times:
            with Path(self).open("ab") as file:
                file.write(b"more")
        return data


@pytest.fixture
def written(tmp_path):
    Written.readings, Written.times = 0, 1
    path = Written(tmp_path / "a.bin")
    path.write_bytes(bytes(16))
    return path


def test_a_file_that_grew_is_read_again(written):
    assert read_whole(written) == bytes(16) + b"more"
    assert written.readings == 2


def test_one_that_does_not_come_to_rest_is_refused(written):
    Written.times = 10
    with pytest.raises(InputChanged, match=r"a\.bin.*changed while it was read"):
        read_whole(written)
    assert written.readings == 2, "it is not waited for"


@pytest.mark.parametrize("read", [read_velodyne_bin, read_ply])
def test_every_reader_of_frames_looks(written, read):
    Written.times = 10
    with pytest.raises(InputChanged):
        read(written)


def keep_writing(path):
    with Path(path).open("r+b", buffering=0) as file:
        while True:
            file.seek(0)
            file.write(os.urandom(8))


def said_it_changed(read, path):
    """Whether a reading met the writer, which gets no time in some readings on a busy machine."""
    try:
        read(path)
    except InputChanged:
        return True
    except ImageUnreadable:
        return False
    return False


@pytest.mark.parametrize("read", [read_whole, read_image])
def test_a_program_that_keeps_writing(tmp_path, read):
    path = tmp_path / "a.bin"
    path.write_bytes(bytes(64_000_000))
    writer = multiprocessing.get_context("spawn").Process(target=keep_writing, args=(path,))
    writer.start()
    try:
        before = path.stat().st_mtime_ns
        while path.stat().st_mtime_ns == before:
            time.sleep(0.01)
        assert any(said_it_changed(read, path) for _ in range(20)), (
            "the writer is not starved 20 times"
        )
    finally:
        writer.kill()
        writer.join()
    assert len(read_whole(path)) == 64_000_000
