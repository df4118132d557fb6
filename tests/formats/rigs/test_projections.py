"""Rigs of two projection matrices alone: read in all their spellings, inconsistencies named."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationField,
    CalibrationSyntax,
    CalibrationUnits,
    CalibrationValue,
    NotRectified,
    PseudolidarError,
)
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_folder import find_rig

SIZE = (1280, 960)
K = np.array([[640.0, 0, 640], [0, 480, 480], [0, 0, 1]])
# Where the world's origin is in the left camera.
T_LEFT = np.array([2.0, -0.25, 1.4])


def projection(
    K: np.ndarray = K, *, t: np.ndarray = T_LEFT, turn: tuple[float, float, float] = (0, 0, 0)
) -> np.ndarray:
    R = cv2.Rodrigues(np.radians(turn))[0]
    return K @ np.hstack([R, t[:, None]])


LEFT = projection()
RIGHT = projection(t=T_LEFT - [0.5, 0, 0])


def rows_of(P: np.ndarray, brackets: str = "[[]]") -> str:
    inner = "],\n [".join(", ".join(repr(float(x)) for x in row) for row in P)
    return f"[[{inner}]]" if brackets else inner


def python_text(left: np.ndarray = LEFT, right: np.ndarray = RIGHT) -> str:
    return f"p_left = {rows_of(left)}\np_right = {rows_of(right)}\n"


def matlab(P: np.ndarray) -> str:
    return "[" + "; ".join(" ".join(repr(float(x)) for x in row) for row in P) + "];"


def plain(P: np.ndarray, form: str = "%.17g") -> str:
    return "\n".join(" ".join(form % x for x in row) for row in P) + "\n"


def in_one_line(P: np.ndarray) -> str:
    return " ".join(repr(float(x)) for x in P.ravel()) + "\n"


@pytest.mark.parametrize(
    "text",
    [
        python_text(),
        "# cameras\nP1 = " + matlab(LEFT) + "\n% right\nP2 = " + matlab(RIGHT) + "\n",
        plain(LEFT) + "\n" + plain(RIGHT),
        "p_right = np.array(" + rows_of(RIGHT) + ")\np_left = np.array(" + rows_of(LEFT) + ")\n",
        python_text(-2 * LEFT, 0.25 * RIGHT),
    ],
    ids=["python", "matlab", "plain", "right first", "scaled"],
)
def test_one_file_in_all_its_spellings(text: str, tmp_path: Path) -> None:
    path = tmp_path / "camera_data.txt"
    path.write_text(text)
    assert find_rig(tmp_path) == path
    for place in (path, tmp_path):
        rig = read_any_rig(place, size_px=SIZE).of_rectified
        np.testing.assert_allclose(rig.left.K, K, rtol=1e-12)
        np.testing.assert_allclose(rig.right.K, K, rtol=1e-12)
        assert rig.baseline_m == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize("form", [plain, in_one_line, matlab])
def test_a_file_for_each_eye(form: object, tmp_path: Path) -> None:
    left, right = tmp_path / "P_left.txt", tmp_path / "P_right.txt"
    left.write_text(form(LEFT))  # type: ignore[operator]
    right.write_text(form(RIGHT))  # type: ignore[operator]
    for place in (f"{left},{right}", tmp_path):
        assert read_any_rig(place, size_px=SIZE).of_rectified.baseline_m == pytest.approx(0.5)
    with pytest.raises(CalibrationValue, match="stands right of the other"):
        read_any_rig(f"{right},{left}", size_px=SIZE)


def test_numpy_savetxt_is_read(tmp_path: Path) -> None:
    paths = [tmp_path / "a.txt", tmp_path / "b.txt"]
    for path, P in zip(paths, (LEFT, RIGHT), strict=True):
        np.savetxt(path, P)
    reading = read_any_rig(f"{paths[0]},{paths[1]}", size_px=SIZE)
    assert reading.of_rectified.baseline_m == pytest.approx(0.5)
    assert reading.form == "two projection matrices"


def test_the_world_of_the_matrices_does_not_matter(tmp_path: Path) -> None:
    """A pair that is rectified, in a world that is turned against it, in seven digits."""
    world = np.eye(4)
    world[:3, :3], world[:3, 3] = cv2.Rodrigues(np.array([0.7, -1.2, 2.0]))[0], (30, -2, 5)
    paths = [tmp_path / "a.txt", tmp_path / "b.txt"]
    for path, P in zip(paths, (LEFT, RIGHT), strict=True):
        path.write_text(plain(P @ world, "%.9e"))
    rig = read_any_rig(f"{paths[0]},{paths[1]}", size_px=SIZE).of_rectified
    assert rig.baseline_m == pytest.approx(0.5, abs=1e-5)
    np.testing.assert_allclose(rig.left.K, K, rtol=1e-6, atol=1e-3)


# --- what is inconsistent is named ---------------------------------------------------------------

K_LOWER = K * [[1, 1, 1], [1, 1, 487 / 480], [1, 1, 1]]
K_OUTSIDE = K * [[1, 1, 3], [1, 1, 1], [1, 1, 1]]
K_OTHER = K * [[1.1, 1, 1], [1, 1, 1], [1, 1, 1]]


@pytest.mark.parametrize(
    ("right", "kind", "words"),
    [
        (
            projection(t=T_LEFT - [0, -0.5, 0]),
            CalibrationValue,
            "stands 0.5 above the left one: baseline (0, -0.5, 0); the matrices differ in row 2, "
            "column 4 alone",
        ),
        (projection(t=T_LEFT - [0, 0.5, 0]), CalibrationValue, "stands 0.5 below the left one"),
        (projection(t=T_LEFT - [0, 0, 0.5]), CalibrationValue, "stands 0.5 in front of the left"),
        (projection(t=T_LEFT - [-0.5, 0, 0]), CalibrationValue, "stands right of the other"),
        (LEFT, CalibrationValue, "baseline 0"),
        (projection(K_OTHER, t=T_LEFT - [0.5, 0, 0]), NotRectified, "fx 640 px left and 704 px"),
        (
            projection(t=T_LEFT - [0.5, 0, 0], turn=(0, 3, 0)),
            NotRectified,
            "a rotation of 3 degrees between",
        ),
        (projection(t=T_LEFT - [0.5, 0.1, 0]), NotRectified, "the right camera 0.1 m below"),
        (projection(K_LOWER, t=T_LEFT - [0.5, 0, 0]), NotRectified,
         "cy 480 px left and 487 px right"),
        (projection(t=T_LEFT - [500.0, 0, 0]), CalibrationUnits, "cameras 500 apart"),
        (np.zeros((3, 4)), CalibrationValue, "is no camera"),
        (projection(K_OUTSIDE, t=T_LEFT - [0.5, 0, 0]), CalibrationValue, "principal point"),
    ],
)  # fmt: skip
def test_inconsistent_matrices_are_named(
    right: np.ndarray, kind: type[PseudolidarError], words: str, tmp_path: Path
) -> None:
    path = tmp_path / "camera_data.txt"
    path.write_text(python_text(right=right))
    with pytest.raises(kind) as error:
        _ = read_any_rig(path, size_px=SIZE).of_rectified
    assert words in str(error.value)
    assert error.value.path == str(path)
    if kind is CalibrationValue:
        assert error.value.where == "p_right, line 4"


@pytest.mark.parametrize("scale", [1.0, -2.0])
def test_the_number_of_a_baseline_along_the_rows_is_told(scale: float, tmp_path: Path) -> None:
    """640 px times 0.5 less in the first row: the right camera 0.5 to the right."""
    path = tmp_path / "camera_data.txt"
    path.write_text(
        python_text(left=scale * LEFT, right=scale * projection(t=T_LEFT - [0, -0.5, 0]))
    )
    with pytest.raises(CalibrationValue) as error:
        read_any_rig(path, size_px=SIZE)
    wanted, now = scale * (LEFT[0, 3] - 320), scale * LEFT[0, 3]
    assert f"row 1: {wanted:g} in place of {now:g} in column 4 of p_right" in error.value.fix
    mended = scale * LEFT.copy()
    mended[0, 3] = wanted
    path.write_text(python_text(left=scale * LEFT, right=mended))
    assert read_any_rig(path, size_px=SIZE).of_rectified.baseline_m == pytest.approx(0.5)


def test_unrectified_matrices_are_the_rig_of_their_pictures(tmp_path: Path) -> None:
    path = tmp_path / "camera_data.txt"
    right = projection(K_OTHER, t=T_LEFT - [0.5, 0, 0], turn=(0, 3, 0))
    path.write_text(python_text(right=right))
    reading = read_any_rig(path, size_px=SIZE)
    assert reading.rectified is None
    assert reading.raw is not None
    points = np.random.default_rng(0).uniform((-2, -2, 7), (2, 2, 11), (20, 3))
    in_left = points + T_LEFT
    seen = np.c_[in_left, np.ones(20)] @ reading.raw.P_right.T
    wanted = np.c_[points, np.ones(20)] @ right.T
    np.testing.assert_allclose(seen[:, :2] / seen[:, 2:], wanted[:, :2] / wanted[:, 2:], rtol=1e-9)
    assert any(note.startswith("warning: ") and "rotation of 3 deg" in note
               for note in reading.notes)  # fmt: skip


@pytest.mark.parametrize(
    ("text", "kind", "words"),
    [
        (python_text().replace("640.0, 2176.0", "640.0"), CalibrationSyntax,
         "line 1: 3 numbers of p_left; wanted rows of 4"),
        (python_text().replace("2176.0", "nan"), CalibrationSyntax, "line 1, column 31"),
        (python_text().replace("2176.0", "2_176"), CalibrationSyntax, "'2_176'"),
        (python_text().replace("2176.0", "2176,0"), CalibrationSyntax, "5 numbers of p_left"),
        (python_text().replace("2176.0", "２１７６"), CalibrationSyntax, "'２１７６'"),
        (python_text().replace("2176.0", "__import__('os')"), CalibrationSyntax, "line 1"),
        (python_text().replace("p_right", "p_left"), CalibrationField, "p_left twice, in lines 1"),
        (python_text() + "p_third = [[1, 2, 3, 4]]\n", CalibrationSyntax, "line 7: a third matrix"),
        (f"p_left = {rows_of(LEFT)}\n", CalibrationField, "1 projection matrices"),
        (python_text()[:-40], CalibrationSyntax, "line"),
        (f"p_left = {rows_of(LEFT[:2])}\np_right = {rows_of(RIGHT)}\n", CalibrationSyntax,
         "line 1: 8 numbers of p_left; wanted 12"),
        (f"p_left = {rows_of(LEFT)}\np_right = {rows_of(RIGHT[:2])}\n", CalibrationSyntax,
         "8 numbers of p_right; wanted 12"),
    ],
)  # fmt: skip
def test_mistakes_are_named_by_their_place(
    text: str, kind: type[PseudolidarError], words: str, tmp_path: Path
) -> None:
    path = tmp_path / "camera_data.txt"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(kind) as error:
        read_any_rig(path, size_px=SIZE)
    assert words in str(error.value)
    assert error.value.path == str(path)


@pytest.mark.real
@pytest.mark.parametrize("name", ["", "camera_data.txt"])
def test_the_real_matrices_of_a_simulator_are_not_trusted(name: str, real_data: Path) -> None:
    with pytest.raises(CalibrationValue, match=r"stands 0\.5 above the left one") as error:
        read_any_rig(real_data / "bike_avoidance" / name, size_px=SIZE)
    assert "row 2, column 4 alone, 552 and 792" in error.value.got
    assert "the difference belongs into row 1: 1856 in place of 2176" in error.value.fix
    assert error.value.where == "p_right, line 4"
