"""Files of times: every form that users have, exact, and errors by line."""

from __future__ import annotations

import pytest

from pseudolidar.errors import SequenceTime
from pseudolidar.formats.time_table import read_time_table

T0 = 1_403_636_579_763_555_584
FORMS = {
    "seconds": ("0.5\n1.6e0\n2\n", (500_000_000, 1_600_000_000, 2_000_000_000), None, "s"),
    "whole seconds": ("1\n2\n3\n", (10**9, 2 * 10**9, 3 * 10**9), None, "s"),
    "seconds of the day": (
        "1305031102.175304\n1305031102.211214\n",
        (1_305_031_102_175_304_000, 1_305_031_102_211_214_000),
        None,
        "s",
    ),
    "dates": (
        "2011-09-26 13:02:25.594360375\n\n2011-09-26 13:02:25.7\n",
        (1_317_042_145_594_360_375, None, 1_317_042_145_700_000_000),
        None,
        "dates",
    ),
    "nanoseconds": (f"{T0}\n{T0 + 1}\n", (T0, T0 + 1), None, "ns"),
    "nanoseconds from the start": ("0\n33333333\n7e7\n", (0, 33_333_333, 70_000_000), None, "ns"),
    "nanoseconds since boot": (
        "123456789012345\n123456822345678\n",
        (123_456_789_012_345, 123_456_822_345_678),
        None,
        "ns",
    ),
    "microseconds": (
        "1403636579763555\n1403636579813555\n",
        (1_403_636_579_763_555_000, 1_403_636_579_813_555_000),
        None,
        "us",
    ),
    "milliseconds": (
        "1403636579763\n1403636579813\n",
        (1_403_636_579_763_000_000, 1_403_636_579_813_000_000),
        None,
        "ms",
    ),
    "EuRoC": (
        f"#timestamp [ns],filename\n{T0},{T0}.png\n{T0 + 5},{T0 + 5}.png\n",
        (T0, T0 + 5),
        (f"{T0}.png", f"{T0 + 5}.png"),
        "ns",
    ),
    "TUM": (
        "# color images\n# timestamp filename\n1.5 rgb/1.5.png\n1.75 rgb/1.75.png\n",
        (1_500_000_000, 1_750_000_000),
        ("rgb/1.5.png", "rgb/1.75.png"),
        "s",
    ),
    "associated": (
        "1.5 rgb/a.png 1.51 depth/a.png\n1.75 rgb/b.png 1.76 depth/b.png\n",
        (1_500_000_000, 1_750_000_000),
        ("rgb/a.png", "rgb/b.png"),
        "s",
    ),
    "a heading, names first": (
        "filename;time\na.png;1.5\nb.png;1.75\n",
        (1_500_000_000, 1_750_000_000),
        ("a.png", "b.png"),
        "s",
    ),
    "dates and names": (
        "2011-09-26 13:02:25.5, a.png\n2011-09-26 13:02:26 b.png\n",
        (1_317_042_145_500_000_000, 1_317_042_146_000_000_000),
        ("a.png", "b.png"),
        "dates",
    ),
    "quoted, CR LF, BOM": (
        '\ufefftime,name\r\n1.5,"a.png"\r\n2.5,"b.png"\r\n',
        (1_500_000_000, 2_500_000_000),
        ("a.png", "b.png"),
        "s",
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_forms(tmp_path, form):
    text, stamps, names, unit = FORMS[form]
    path = tmp_path / "times.txt"
    path.write_bytes(text.encode())
    table = read_time_table(path)
    assert (table.stamps_ns, table.names, table.unit) == (stamps, names, unit)


def test_lines_are_those_of_the_file(tmp_path):
    path = tmp_path / "rgb.txt"
    path.write_text("# heading\n\n1.5 a.png\n# between\n2.5 b.png\n")
    assert read_time_table(path).lines == (3, 5)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("1\nx\n", "line 2"),
        ("1\n1,5\n", "line 2"),
        ("1\n1_000\n", "line 2"),
        ("1\n-2\n", "line 2"),
        ("1\n2 a.png\n", "line 2"),
        ("1 a.png\n2\n", "line 2"),
        ("1\n1e999999999\n", "line 2"),
        ("2011-09-26 13:02:25\n2011-13-26 13:02:25\n", "line 2"),
        ("2011-09-26 13:02:25\n5\n", "line 2"),
        ("1 0.1 0.2 0.3 0 0 0 1\n", "line 1"),
        ("1 2\n", "line 1"),
        ("100000\n133333\n166667\n", "line 1"),
        ("# nothing\n", ""),
        ("", ""),
    ],
)
def test_what_is_no_time_is_refused_by_line(tmp_path, text, where):
    path = tmp_path / "times.txt"
    path.write_text(text)
    with pytest.raises(SequenceTime) as caught:
        read_time_table(path)
    assert caught.value.where.startswith(where)
    assert caught.value.path == str(path)


def test_no_file(tmp_path):
    with pytest.raises(SequenceTime):
        read_time_table(tmp_path / "nowhere.txt")
