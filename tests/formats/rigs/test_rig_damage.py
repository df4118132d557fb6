"""Damaged calibrations of other programs: refused by place, and nothing but typed errors."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationField,
    CalibrationMissing,
    CalibrationSyntax,
    CalibrationValue,
    LimitError,
    PseudolidarError,
)
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.rigs.k_txt import write_k_txt
from pseudolidar.formats.rigs.opencv_rig_writers import write_opencv
from pseudolidar.formats.rigs.rig_file import read_any_rig
from tests.formats.rigs.test_rig_file import (
    CALIB,
    FORMS,
    LEFT,
    RIGHT,
    SIZE,
    assert_same_cameras,
    by_opencv,
    rig,
    stereo,
)

PLAIN = "%YAML:1.0\n---\nM1: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: {}\n   data: [ {} ]\n"
K_DATA = "500., 0., 320., 0., 500., 240., 0., 0., 1."


@pytest.mark.parametrize(
    ("text", "kind", "words"),
    [
        (PLAIN.format("d", K_DATA).replace("   cols: 3\n", ""), CalibrationField, "'cols'"),
        (PLAIN.format("d", K_DATA).replace("cols", "colz"), CalibrationField, "'cols'"),
        (PLAIN.format("d", K_DATA).replace("cols: 3", "cols: -3"), CalibrationValue, "cols -3"),
        (
            PLAIN.format("d", K_DATA).replace(": 3\n", ": 1000000\n"),
            CalibrationValue,
            "1000000 x 1000000",
        ),
        (PLAIN.format("q", K_DATA), CalibrationSyntax, "dt 'q'"),
        (PLAIN.format("u", "700, 0, 1, 0, 1, 1, 0, 0, 1"), CalibrationValue, "700 in a matrix"),
        (PLAIN.format("i", K_DATA.replace("320.", "320.5")), CalibrationValue, "320.5"),
        (PLAIN.format("d", K_DATA + ", 7."), CalibrationSyntax, "10 numbers"),
        (PLAIN.format("d", K_DATA.replace("320.", ".Nan")), CalibrationSyntax, "line 7, column 22"),
        (PLAIN.format("d", K_DATA.replace("320.", "1_000")), CalibrationSyntax, "'1_000'"),
        (PLAIN.format("d", K_DATA.replace("320.", "３２０")), CalibrationSyntax, "'３２０'"),
        ("a: !!python/object/apply:os.system ['x']\n", CalibrationSyntax, "a tag"),
        ("a: &a [x, x]\nb: &b [*a, *a]\n", CalibrationSyntax, "an anchor"),
        ("b: [*a, *a]\n", CalibrationSyntax, "an alias"),
        ("<<: {a: 1}\n", CalibrationSyntax, "line 1"),
        ("a: " + "[" * 20_000, CalibrationSyntax, "32 levels"),
        ("".join(f"{' ' * n}a:\n" for n in range(40)), CalibrationSyntax, "32 levels"),
        ("a:\n\tb: 1\n", CalibrationSyntax, "a tab"),
        ("M1: 1\nM1: 2\n", CalibrationField, "lines 1 and 2"),
        ("M1: [1, 2\n", CalibrationSyntax, "the end of the document"),
        ("M1: 1\n   M2: 2\n", CalibrationSyntax, "indented more"),
    ],
)
def test_malformed_yaml_is_refused_by_place(
    text: str, kind: type[PseudolidarError], words: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.yml"
    path.write_text(
        text + ("M2: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nR: 1\nT: 1\n" if "%Y" in text else "")
    )
    with pytest.raises(kind) as error:
        read_any_rig(path, size_px=SIZE)
    assert words in str(error.value)
    assert error.value.path == str(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><opencv_storage/>', "line 1"),
        ("<opencv_storage><a>&x;</a></opencv_storage>", "entity '&x;'"),
        ("<opencv_storage><![CDATA[x]]></opencv_storage>", "line 1, column 17"),
        ("<opencv_storage>\n<a>1</b></opencv_storage>", "line 2, column 5"),
        ("<opencv_storage><?php x ?></opencv_storage>", "line 1, column 17"),
        ("<opencv_storage><a>1", "the end"),
        ("<a>" * 20_000, "32 levels"),
        ("<other></other>", "<opencv_storage>"),
    ],
)
def test_malformed_xml_is_refused_by_place(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    path.write_text(f'<?xml version="1.0"?>\n{text}'.replace('<?xml version="1.0"?>\n', "", 1))
    with pytest.raises(CalibrationSyntax) as error:
        read_any_rig(path, size_px=SIZE)
    assert words in str(error.value)


def test_a_claim_of_terabytes_allocates_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.yml"
    text = PLAIN.format("d", K_DATA).replace(": 3\n", ": 1000000\n")
    path.write_text(text + "M2: [1]\nR: 1\nT: 1\n")
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin_s = time.process_time()
    with pytest.raises(CalibrationValue):
        read_any_rig(path, size_px=SIZE)
    assert time.process_time() - begin_s < 0.5
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 2_000


def test_a_file_beyond_the_cap_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "a.yml"
    path.write_text("a: 1\n" * 50)
    with pytest.raises(LimitError, match="250 bytes"):
        read_any_rig(path, limits=Limits(text_bytes=100))
    with pytest.raises(CalibrationMissing):
        read_any_rig(tmp_path / "absent.yml")


@pytest.mark.parametrize(
    ("name", "begin", "item", "end"),
    [
        ("a.yml", "M1: [", "1,", "1]\n"),
        ("a.yml", "", "---\na: 1\n", ""),
        ("a.json", '{"M1": [', "1,", "1]}"),
        ("a.xml", "<opencv_storage><M1>", "1 ", "</M1></opencv_storage>"),
        ("a.xml", "<opencv_storage>", "<_>1</_>", "</opencv_storage>"),
    ],
)
def test_millions_of_values_are_no_calibration(
    name: str, begin: str, item: str, end: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_text(begin + item * (9_000_000 // len(item)) + end)
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(LimitError, match=r"more than 100000 values|lines; wanted at most"):
        read_any_rig(path, size_px=SIZE)
    # the text in a few copies, and what 100 000 values take
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 300_000


def files(folder: Path) -> dict[str, Path]:
    """One good file of each format."""
    mine = rig()
    write_opencv(folder / "own.yml", mine)
    write_k_txt(folder / "K.txt", mine)
    (folder / "calib.txt").write_text(CALIB)
    (folder / "one.yaml").write_text(f"---\n{LEFT}---\n{RIGHT}")
    found = {form: by_opencv(folder / f"cv.{form}", stereo()) for form in FORMS}
    names = {"K.txt": "K.txt", "middlebury": "calib.txt", "ros": "one.yaml", "own": "own.yml"}
    return found | {form: folder / name for form, name in names.items()}


@pytest.mark.parametrize("form", [*FORMS, "K.txt", "middlebury", "ros", "own"])
@pytest.mark.parametrize(
    "changed",
    [
        lambda data: b"\xef\xbb\xbf" + data,
        lambda data: data.replace(b"\n", b"\r\n"),
        lambda data: data.replace(b"\n", b"  \t\n"),
        lambda data: data + b"\n\n  \n",
    ],
    ids=["BOM", "CRLF", "trailing blanks", "blank lines"],
)
def test_what_editors_do_to_text_is_harmless(
    form: str, changed: Callable[[bytes], bytes], tmp_path: Path
) -> None:
    path = files(tmp_path)[form]
    want = read_any_rig(path, size_px=SIZE if form in FORMS else (1242, 375), unit="mm")
    path.write_bytes(changed(path.read_bytes()))
    got = read_any_rig(path, size_px=SIZE if form in FORMS else (1242, 375), unit="mm")
    assert_same_cameras(got.of_rectified, want.of_rectified)


def test_latin_1_in_a_comment_is_harmless(tmp_path: Path) -> None:
    path = files(tmp_path)["own"]
    path.write_bytes(path.read_bytes() + "# größer\nwho: Jörg\n".encode("latin-1"))
    assert_same_cameras(read_any_rig(path).of_rectified, rig())


MUTATIONS = 300  # of each form, and any number of other ones by `make fuzz`


@pytest.mark.parametrize("form", [*FORMS, "K.txt", "middlebury", "ros"])
def test_mutations_give_a_rig_or_a_typed_error(form: str, tmp_path: Path) -> None:
    path = files(tmp_path)[form]
    # A short file: every byte of it gets its mutations.
    keep = ("M1", "M2", "R", "T") if form in FORMS else ()
    if keep:
        path = by_opencv(tmp_path / f"cv.{form}", {name: stereo()[name] for name in keep})
    data = np.frombuffer(path.read_bytes(), np.uint8)
    rng = np.random.default_rng(11)
    read, errors = 0, list[PseudolidarError]()
    for _ in range(MUTATIONS):
        mutant = data.copy()
        for _ in range(rng.integers(1, 4)):
            at = rng.integers(max(1, len(mutant)))
            kind = rng.integers(4)
            if kind == 0 and len(mutant):
                mutant[at] = rng.integers(256)
            elif kind == 1:
                mutant = np.delete(mutant, slice(at, at + rng.integers(1, 20)))
            elif kind == 2:
                mutant = np.insert(
                    mutant, at, rng.choice(np.frombuffer(b"\n :[]{}-#!&<>\"',=9e", "u1"))
                )
            else:
                mutant = mutant[: max(1, at)]
        path.write_bytes(mutant.tobytes())
        try:
            read_any_rig(path, size_px=SIZE, unit="mm")
            read += 1
        except PseudolidarError as error:
            errors.append(error)
    assert read > 0
    assert len(errors) > MUTATIONS / 10
    assert all(error.path is not None and error.exit_code == 3 for error in errors)
