"""A run that died tells the next one what it was doing."""

import logging
import subprocess
import sys

from pseudolidar.running.crew.in_flight import IN_FLIGHT_NAME, left_by_the_last_run, noting

CRASH = """
import ctypes, sys
from pathlib import Path
from pseudolidar.running.crew.in_flight import noting

with noting(Path(sys.argv[1])) as in_flight:
    with in_flight.noted("a very long name that leaves its length behind"):
        pass
    with in_flight.noted("000007"), in_flight.noted("two\\nlines"):
        ctypes.string_at(0)
"""


def test_a_crash_leaves_the_names_and_the_next_run_tells(tmp_path, caplog):
    ended = subprocess.run([sys.executable, "-c", CRASH, str(tmp_path)], check=False)
    assert ended.returncode < 0
    with caplog.at_level(logging.WARNING), noting(tmp_path) as in_flight:
        (record,) = caplog.records
        assert "frames 000007, two\\nlines" in record.getMessage()
        assert "--isolate" in record.getMessage()
        assert left_by_the_last_run(tmp_path / IN_FLIGHT_NAME) == (), "told once"
        with in_flight.noted("000008"):
            assert left_by_the_last_run(tmp_path / IN_FLIGHT_NAME) == ("000008",)
    assert not list(tmp_path.iterdir())


def test_an_ordinary_end_leaves_nothing_to_tell(tmp_path, caplog):
    for _ in range(2):
        with noting(tmp_path) as in_flight, in_flight.noted("000001"):
            pass
    assert not caplog.records


def test_what_is_no_note_is_no_matter(tmp_path):
    for content in (b"", b"[1, 2", b"{}", b"\xff"):
        (tmp_path / IN_FLIGHT_NAME).write_bytes(content)
        assert left_by_the_last_run(tmp_path / IN_FLIGHT_NAME) == ()
