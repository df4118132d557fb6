"""Time stamp files: exact nanoseconds, UTC, blank lines, refused lines."""

from __future__ import annotations

import pytest

from pseudolidar.errors import SequenceTime
from pseudolidar.formats.timestamps import (
    read_times,
    read_timestamps,
    write_times,
    write_timestamps,
)


def test_dates_are_utc_and_exact(tmp_path):
    path = tmp_path / "timestamps.txt"
    path.write_text("1970-01-01 00:00:01.000000001\n2011-09-26 13:02:44.327963904\n")
    # 2011-09-26 13:02:44 UTC is 1317042164 s (date -u -d @1317042164).
    assert read_timestamps(path) == (1_000_000_001, 1_317_042_164_327_963_904)


def test_short_fractions_are_fractions(tmp_path):
    path = tmp_path / "timestamps.txt"
    path.write_text("1970-01-01 00:00:01.5\r\n1970-01-01 00:00:02\r\n")
    assert read_timestamps(path) == (1_500_000_000, 2_000_000_000)


def test_blank_lines_hold_a_place_except_at_the_end(tmp_path):
    path = tmp_path / "timestamps.txt"
    path.write_text("1970-01-01 00:00:01\n\n1970-01-01 00:00:03\n\n \n")
    assert read_timestamps(path) == (1_000_000_000, None, 3_000_000_000)


@pytest.mark.parametrize(
    "line",
    [
        "2011-13-26 13:02:44.3",
        "2011-09-26",
        "1317042164",
        "2011-09-26 13:02:44,3",
        "now",
        # Beyond int64 nanoseconds since 1970, on either side.
        "2300-01-01 00:00:00",
        "1969-12-31 23:59:59",
    ],
)
def test_what_is_no_date_is_refused_by_line(tmp_path, line):
    path = tmp_path / "timestamps.txt"
    path.write_text(f"2011-09-26 13:02:44.327963904\n{line}\n")
    with pytest.raises(SequenceTime) as caught:
        read_timestamps(path)
    assert (caught.value.where, caught.value.path) == ("line 2", str(path))


def test_seconds_are_exact(tmp_path):
    path = tmp_path / "times.txt"
    path.write_text("0.000000e+00\n1.036224e-01\n4.707581e+02\n")
    assert read_times(path) == (0, 103_622_400, 470_758_100_000)


@pytest.mark.parametrize("line", ["-1", "nan", "0.1 0.2", "0,1", "1e30", "2e-9999999999999999999"])
def test_what_are_no_seconds_is_refused_by_line(tmp_path, line):
    path = tmp_path / "times.txt"
    path.write_text(f"0\n{line}\n")
    with pytest.raises(SequenceTime, match="line 2"):
        read_times(path)


def test_round_trips(tmp_path):
    stamps = (1, 999_999_999, 1_317_042_164_327_963_904, 1_317_042_164_431_104_256)
    write_timestamps(tmp_path / "timestamps.txt", stamps)
    assert read_timestamps(tmp_path / "timestamps.txt") == stamps
    write_times(tmp_path / "times.txt", stamps)
    assert read_times(tmp_path / "times.txt") == stamps


@pytest.mark.real
def test_real_stamps_come_back_byte_for_byte(real_data, tmp_path):
    drive = real_data / "kitti_raw" / "2011_09_26" / "2011_09_26_drive_0002_sync"
    path = drive / "image_02" / "timestamps.txt"
    stamps = read_timestamps(path)
    assert len(stamps) == 77
    write_timestamps(tmp_path / "timestamps.txt", stamps)
    assert (tmp_path / "timestamps.txt").read_text() == path.read_text()
