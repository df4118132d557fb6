"""Every form of a calibration, spoilt in one place: the named error, the place, and what to do."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pseudolidar.errors import (
    CalibrationField,
    CalibrationSyntax,
    CalibrationUnits,
    CalibrationValue,
    PseudolidarError,
)
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_json import rig_notes
from pseudolidar.formats.rigs.rig_reading import RigReading
from tests.rig_texts import FORMS, SIZE_PX

FIELD, SYNTAX, VALUE = CalibrationField, CalibrationSyntax, CalibrationValue
UNITS = CalibrationUnits


def read(folder: Path, form: str, *changes: tuple[str, str]) -> RigReading:
    return read_any_rig(FORMS[form].written(folder, *changes), size_px=SIZE_PX)


def refusal(folder: Path, form: str, *changes: tuple[str, str]) -> PseudolidarError:
    with pytest.raises(PseudolidarError) as caught:
        read(folder, form, *changes)
    error = caught.value
    told = error.as_dict()
    assert all(told[key] for key in ("path", "where", "got", "want", "fix")), told
    assert error.exit_code == 3
    assert str(folder) in str(error.path)
    return error


@pytest.mark.parametrize("form", FORMS)
def test_whole_files_are_read(form: str, tmp_path: Path) -> None:
    reading = read(tmp_path, form)
    assert not any("warning" in note for note in (*reading.notes, *rig_notes(reading.of_pictures)))


# --- numbers -------------------------------------------------------------------------------------

# A number of each form, and the place it stands at.
NUMBER_AT = {
    "yaml": ("500.5", "M1.data[0], line 9"),
    "xml": ("500.5", "M1.data, line 9"),
    "json": ("500.5", "M1.data[0], line 4"),
    "ros": ("500.5", "camera_matrix.data[0], line 8"),
    "kalibr": ("458.5", "cam0.intrinsics[0], line 6"),
    "object": ("7.0e+02", "line 1, column 5"),
    "bare": ("7.0e+02", "line 1, column 1"),
    "raw": ("7.0e+02", "line 4, column 7"),
    "rig": ("500.5", "left.K[0][0], line 4"),
    "middlebury": ("994.5", "line 1, column 7"),
    "k": ("500.5", "line 1, column 1"),
    "matrices": ("500.5", "line 1, column 12"),
}
NO_NUMBERS = ("abc", "nan", ".nan", "inf", "-.Inf", "1e400", "1_000", "\uff15\uff10", "0x1F4")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("word", NO_NUMBERS)
def test_what_is_no_number_is_refused_at_its_place(form: str, word: str, tmp_path: Path) -> None:
    number, place = NUMBER_AT[form]
    error = refusal(tmp_path, form, (number, word))
    assert type(error) is SYNTAX
    assert error.where.startswith(place)
    assert word in error.got or (form, word) == ("xml", "1e400")


@pytest.mark.parametrize("form", FORMS)
def test_a_decimal_comma_is_never_half_a_number(form: str, tmp_path: Path) -> None:
    number, _ = NUMBER_AT[form]
    assert type(refusal(tmp_path, form, (number, number.replace(".", ",")))) is SYNTAX


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("focal", ["-700", "0", "1e300", "1e-300"])
def test_impossible_focal_lengths_are_refused(form: str, focal: str, tmp_path: Path) -> None:
    # KITTI's first row is of a camera that is not used; the third and K_00 have nothing to say.
    number = {"object": "7.0e+02 0 3.2e+02 45.00", "raw": "7.0e+02 0 3.2e+02 45.00"}
    old = number.get(form, NUMBER_AT[form][0])
    new = old.replace("7.0e+02", focal).replace("500.5", focal)
    error = refusal(tmp_path, form, (old, new.replace("994.5", focal).replace("458.5", focal)))
    assert type(error) is VALUE
    # A projection has any scale: minus its first row is that of a camera that is turned.
    words = ("focal lengths", "no camera", "no projection", "look 180 degrees apart")
    assert any(word in error.got for word in words)


@pytest.mark.parametrize("form", FORMS)
def test_an_empty_file_says_so(form: str, tmp_path: Path) -> None:
    given = FORMS[form].written(tmp_path)
    (tmp_path / list(FORMS[form].files)[-1]).write_text(" \n\n")
    with pytest.raises(SYNTAX, match="nothing in the file"):
        read_any_rig(given, size_px=SIZE_PX)


# --- values --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("form", "old", "new", "kind", "where", "got"),
    [
        # principal point of other pictures
        ("yaml", "320.0", "1320.0", VALUE, "M1, line 6", r"principal point \(1320"),
        ("xml", "320.0", "1320.0", VALUE, "M1, line 5", r"principal point \(1320"),
        ("ros", "322.0", "1320.0", VALUE, "projection_matrix, line 18", "principal point"),
        ("kalibr", "367.25", "967.25", VALUE, "cam0.intrinsics, line 6", "principal point"),
        ("object", "3.2e+02 45.00", "3.2e+03 45.00", VALUE, "P2, line 3", "principal point"),
        ("bare", "3.2e+02 -380", "3.2e+03 -380", VALUE, "P1, line 2", "principal point"),
        ("raw", "3.2e+02 45.00", "3.2e+03 45.00", VALUE, "P_rect_02, line 26", "principal point"),
        ("rig", "[500.5, 0, 320]", "[500.5, 0, -1]", VALUE, "left.K, line 4", "principal point"),
        ("middlebury", "311.25", "911.25", VALUE, "cam0, line 1", "principal point"),
        ("k", "320", "1320", VALUE, "K", "principal point"),
        ("matrices", "320.0", "1320.0", VALUE, "p_left, line 1", "principal point"),
        # eyes exchanged
        ("yaml", "-0.125", "0.125", VALUE, "T, line 31", "stands right of the other"),
        ("ros", "-57.6", "57.6", VALUE, "projection_matrix, line 18", "stands right of the other"),
        ("kalibr", "-0.11]", "0.11]", VALUE, "cam1.T_cn_cnm1, line 11", "stands right of"),
        ("object", "-330.00", "330.00", VALUE, "P3, line 4", "stands right of the other"),
        ("bare", "-380.00", "380.00", VALUE, "P1, line 2", "stands right of the other"),
        ("raw", "-330.00", "330.00", VALUE, "P_rect_03, line 34", "stands right of the other"),
        ("rig", "-0.125", "0.125", VALUE, "T_right_left, line 6", "stands right of the other"),
        ("middlebury", "=193.25", "=-193.25", VALUE, "baseline, line 4", "baseline -193.25"),
        ("k", "0.125", "-0.125", VALUE, "baseline", "baseline -0.125"),
        ("matrices", "-60.25", "60.25", VALUE, "p_right, line 4", "stands right of the other"),
        # one place for both
        ("yaml", "-0.125, 0.001, 0.002", "0, 0, 0", VALUE, "T, line 31", "baseline 0"),
        ("ros", "-57.6", "0.0", VALUE, "projection_matrix, line 18", "baseline 0"),
        ("object", "-330.00", "45.00", VALUE, "P3, line 4", "baseline 0"),
        ("rig", "-0.125, 0.001, 0.002", "0, 0, 0", VALUE, "T_right_left, line 6", "baseline 0 m"),
        ("matrices", "-60.25", "0.0", VALUE, "p_right, line 4", "baseline 0"),
        # above and behind
        ("yaml", "-0.125, 0.001", "0.0, -0.125", VALUE, "T, line 31", "0.125 below"),
        ("yaml", "-0.125, 0.001, 0.002", "0.01, 0, 0.125", VALUE, "T, line 31", "0.125 behind"),
        # millimetres
        ("yaml", "-0.125", "-125", UNITS, "T, line 31", "cameras 125 apart"),
        ("ros", "-57.6", "-57600.0", UNITS, "projection_matrix, line 18", "cameras 120 apart"),
        ("kalibr", "-0.11]", "-110.0]", UNITS, "cam1.T_cn_cnm1, line 11", "cameras 110 apart"),
        ("object", "-330.00", "-330000.00", UNITS, "P3, line 4", "cameras 471.493 m apart"),
        ("object", "-0.27", "-270", VALUE, "Tr_velo_to_cam, line 6", "velodyne 270 m from"),
        ("rig", "-0.125", "-125", VALUE, "T_right_left, line 6", "cameras 125 m apart"),
        ("middlebury", "=193.25", "=0.19325", UNITS, "baseline, line 4", "0.00019325 m"),
        ("k", "0.125", "125", UNITS, "baseline", "baseline of 125"),
        # no rotation
        ("yaml", "data: [1.0", "data: [1.01", VALUE, "R, line 26", "off by 0.02, determinant 1.01"),
        ("yaml", "0, 1.0]\nT", "0, -1.0]\nT", VALUE, "R, line 26", "determinant -1"),
        ("ros", "data: [1.0", "data: [1.01", VALUE, "rectification_matrix, line 14", "off by 0.02"),
        ("kalibr", "[1.0,", "[1.01,", VALUE, "cam1.T_cn_cnm1, line 11", "off by 0.02"),
        ("object", "t: 1 0", "t: 1.01 0", VALUE, "R0_rect, line 5", "off by 0.02"),
        ("rig", "[[1.0", "[[1.01", VALUE, "T_right_left.R, line 6", "off by 0.02"),
        # no camera matrix
        ("yaml", "0, 0, 1.0]\nD1", "0, 0, 2.0]\nD1", VALUE, "M1, line 6", "rows"),
        ("object", "1 0\nP3", "2 0\nP3", VALUE, "P2, line 3", "no projection"),
        ("middlebury", "0 0 1]", "0 0 2]", VALUE, "cam0, line 1", "rows"),
        ("k", "0 0 1\n", "0 0 2\n", VALUE, "K", "rows"),
        # two cameras of different rectifications
        ("ros", "[480.0", "[481.0", VALUE, "projection_matrix, line 18", "one rectification: fx"),
        ("object", "7.0e+02 0 3.2e+02 45", "7.1e+02 0 3.2e+02 45", VALUE, "P3, line 4", "fx 710"),
        ("raw", "S_rect_03: 6.4", "S_rect_03: 6.5", VALUE, "P_rect_03, line 34", "650x480"),
        ("middlebury", "342.25; 0 994.5 254.75", "342.25; 0 994.5 264.75", VALUE, "cam1, line 2",
         "cy 254.75 px left and 264.75"),
        # sizes
        ("raw", "S_rect_02: 6.4e+02", "S_rect_02: -6.4e+02", VALUE, "S_rect_02, line 24", "-640"),
        ("raw", "S_rect_02: 6.4e+02", "S_rect_02: 640.5", VALUE, "S_rect_02, line 24", "640.5"),
        ("yaml", "_width: 640", "_width: 9999999999", VALUE, "M1, line 6", "pictures of 1e\\+10"),
        # lenses
        ("yaml", "-0.1, 0.05", "-1e300, 0.05", VALUE, "D1, line 11", "distortion"),
        ("kalibr", "-0.281", "1e300", VALUE, "cam0.distortion_coeffs, line 4", "distortion"),
        ("rig", "-0.1, 0.05", "1e300, 0.05", VALUE, "left.distortion, line 4", "distortion"),
    ],
)  # fmt: skip
def test_one_fault_is_named_by_its_place(
    form: str, old: str, new: str, kind: type, where: str, got: str, tmp_path: Path
) -> None:
    error = refusal(tmp_path, form, (old, new))
    assert type(error) is kind
    assert error.where.startswith(where)
    assert re.search(got, error.got), error.got


# --- keys ----------------------------------------------------------------------------------------


def lines_of(form: str, start: str, count: int = 1) -> str:
    """Lines of the file to spoil from the one that begins with `start` on."""
    text = list(FORMS[form].files.values())[-1]
    lines = text.splitlines(keepends=True)
    first = next(n for n, line in enumerate(lines) if line.lstrip().startswith(start))
    return "".join(lines[first : first + count])


@pytest.mark.parametrize(
    ("form", "start", "count", "want", "got"),
    [
        ("yaml", "M1:", 5, "M1 and M2", "no camera matrix of the left camera; found image_width"),
        ("yaml", "M2:", 5, "M1 and M2", "no camera matrix of the right camera"),
        ("yaml", "D1:", 5, "distortion of both", "no distortion numbers of the left camera"),
        ("yaml", "R:", 5, "R and T, or P1 and P2", "no R; found"),
        ("yaml", "T:", 5, "R and T, or P1 and P2", "no T; found"),
        ("ros", "projection_matrix:", 4, "P1 and P2, or R and T", "no projection matrix of the r"),
        ("ros", "distortion_coefficients:", 4, "distortion of both", "no distortion numbers of"),
        ("kalibr", "camera_model", 1, "camera_model", "cam0 has no camera_model; found cam_over"),
        ("kalibr", "intrinsics", 1, "intrinsics", "cam0 has no intrinsics"),
        ("kalibr", "T_cn_cnm1", 5, "T_cn_cnm1", "cam1 has no T_cn_cnm1"),
        ("middlebury", "cam0", 1, "cam0", "no cam0; found cam1, doffs"),
        ("middlebury", "cam1", 1, "cam1", "no cam1; found cam0, doffs"),
        ("middlebury", "baseline", 1, "baseline", "no baseline; found cam0, cam1, doffs, width"),
        ("rig", '"T_right_left"', 1, "'baseline_m' or 'T_right_left'", "no 'baseline_m' or"),
    ],
)
def test_a_missing_key_is_named_with_those_that_are_there(
    form: str, start: str, count: int, want: str, got: str, tmp_path: Path
) -> None:
    gone = lines_of(form, start, count)
    changes = [(gone, "")]
    if form == "rig":
        changes = [(",\n" + gone, "}\n")]
    error = refusal(tmp_path, form, *changes)
    assert type(error) is FIELD
    assert want in error.want
    assert error.got.startswith(got)


@pytest.mark.parametrize(
    ("form", "start", "count", "lines"),
    [
        ("yaml", "M1:", 5, "lines 5 and 35"),
        ("xml", "<M1", 5, "lines 5 and"),
        ("ros", "camera_matrix:", 4, "lines 5 and 21"),
        ("kalibr", "cam1:", 12, "lines 9 and 22"),
        ("object", "P2:", 1, "lines 3 and 8"),
        ("raw", "P_rect_02", 1, "lines 26 and"),
        ("middlebury", "baseline", 1, "lines 4 and 8"),
    ],
)
def test_a_key_that_is_there_twice_is_named_with_both_lines(
    form: str, start: str, count: int, lines: str, tmp_path: Path
) -> None:
    again = lines_of(form, start, count)
    text = list(FORMS[form].files.values())[-1]
    end = "</opencv_storage>\n" if form == "xml" else text[-1:]
    whole = text.removesuffix(end) if form == "xml" else text
    error = refusal(tmp_path, form, (text, whole + again + (end if form == "xml" else "")))
    assert type(error) is FIELD
    assert lines in f"{error.where} {error.got}"
    assert "twice" in error.got


def test_of_several_faults_one_is_told_whole(tmp_path: Path) -> None:
    """The rotation before the baseline that it turns; the first camera before the second."""
    changes = (("data: [1.0", "data: [1.01"), ("-0.125", "0.125"))
    assert refusal(tmp_path, "yaml", *changes).where.startswith("R, line 26")
    changes = (("320.0", "1320.0"), ("321.0", "1321.0"))
    assert refusal(tmp_path, "yaml", *changes).where.startswith("M1, line 6")


@pytest.mark.parametrize("form", ["yaml", "ros", "kalibr", "object", "rig"])
def test_a_rounded_rotation_is_a_warning_with_its_value(form: str, tmp_path: Path) -> None:
    place = {
        "yaml": ("data: [1.0", "data: [1.0002"),
        "ros": ("data: [1.0", "data: [1.0002"),
        "kalibr": ("[1.0,", "[1.0002,"),
        "object": ("t: 1 0", "t: 1.0002 0"),
        "rig": ("[[1.0", "[[1.0002"),
    }
    reading = read(tmp_path, form, place[form])
    rig = reading.raw if reading.rectified is None or form == "ros" else reading.rectified
    assert rig is not None
    notes = (*reading.notes, *rig_notes(rig))
    assert any(note.startswith("warning: rotation of") and "4.0e-04" in note for note in notes)


# --- ROS -----------------------------------------------------------------------------------------


def test_a_lens_model_of_other_formulas_is_refused_where_it_counts(tmp_path: Path) -> None:
    reading = read(tmp_path, "ros", ("plumb_bob", "omni"))
    assert reading.raw is None  # the rectified pictures do not need it
    assert reading.rectified is not None
    assert any("lens model 'omni': P of both cameras alone counts" in n for n in reading.notes)
    error = refusal(tmp_path, "yaml", ("M1:", "distortion_model: omni\nM1:"))
    assert type(error) is VALUE
    assert error.where.startswith("distortion_model, line 5")
    assert error.got == "lens model 'omni'"


def test_a_fisheye_beside_a_lens_without_a_name_is_not_guessed(tmp_path: Path) -> None:
    four = ("0.05, 0.001, -0.002, 0.01]", "0.05, 0.001, -0.002]")
    named = (("plumb_bob", "equidistant"), ("cols: 5", "cols: 4"), four)
    left = FORMS["ros"].files["left.yaml"]
    FORMS["ros"].written(tmp_path, *named)
    assert "no lens model" in "".join(unnamed_left(tmp_path, left).notes)


def unnamed_left(folder: Path, left: str) -> RigReading:
    (folder / "left.yaml").write_text(left.replace("distortion_model: plumb_bob\n", ""))
    return read_any_rig(f"{folder}/left.yaml,{folder}/right.yaml")


def test_calibrations_of_single_cameras_are_no_rig(tmp_path: Path) -> None:
    error = refusal(tmp_path, "ros", ("-57.6", "0.0"))
    assert "Calibrate both cameras together" in error.fix
    FORMS["ros"].written(tmp_path)
    with pytest.raises(FIELD, match="for both cameras"):
        read_any_rig(f"{tmp_path}/left.yaml,{tmp_path}/left.yaml")


# --- which form it is ----------------------------------------------------------------------------


def test_a_first_word_that_is_no_number_is_not_taken_for_a_key(tmp_path: Path) -> None:
    """Of rows without keys; a row that has lost its key among others is named by its line."""
    error = refusal(tmp_path, "bare", ("7.0e+02", "nan"))
    assert (error.where, error.got) == ("line 1, column 1", "'nan'")
    error = refusal(tmp_path, "object", ("P1: ", ""))
    assert error.where == "line 2, column 1"
    assert "KEY: numbers" in error.want


def test_k_txt_is_known_by_its_name(tmp_path: Path) -> None:
    error = refusal(tmp_path, "k", ("0.125", "0.125\n1 2 3"))
    assert "more than 10 numbers" in error.got


def test_a_file_that_is_not_there_is_not_asked_to_be_another(tmp_path: Path) -> None:
    for name, hint in (("a.yml", "camera_info"), ("rig.json", '"schema": 1')):
        with pytest.raises(PseudolidarError, match="no such file") as caught:
            read_any_rig(tmp_path / name)
        assert hint in f"{caught.value.want} {caught.value.fix}"
