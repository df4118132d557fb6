"""The rig file: exact round trip, minimal form, and every mistake named by its place."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationField,
    CalibrationMissing,
    CalibrationSyntax,
    CalibrationValue,
    LimitError,
    OutputError,
    PseudolidarError,
    StructureError,
)
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.rigs.rig_fields import MINIMAL_RIG
from pseudolidar.formats.rigs.rig_json import (
    parse_rig,
    read_rig,
    rig_notes,
    rig_schema,
    rig_text,
    write_rig,
)
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.correction import DisparityCorrection, RowCorrection, SigmaScale
from pseudolidar.structures.pose import Pose


def rotation(seed: int) -> np.ndarray:
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def full_rig(*, rectified: bool) -> StereoRig:
    """A rig with all that a rig can have, in numbers that need all their digits."""
    rng = np.random.default_rng(5)
    K = np.array([[721.5377 + 1 / 3, 0, 609.5593], [0, 721.1 + 1 / 7, 172.854], [0, 0, 1.0]])
    K_right = K + np.array([[0.0, 0, 2.5], [0, 0, 0], [0, 0, 0]])
    lens = np.zeros(0) if rectified else rng.normal(size=5) / 10
    near_x = np.array([-0.53 - 1e-17, 1e-3 / 3, -0.0])
    R = np.eye(3) if rectified else rotation(3)
    return StereoRig(
        Camera(K, 1242, 375, lens, frame="camera_left"),
        Camera(K_right, 1242, 375, lens * 2, frame="camera_right"),
        Pose.from_rotation("camera_right", "camera_left", R, near_x),
        T_left_velodyne=Pose.from_rotation(
            "camera_left", "velodyne", rotation(1), rng.normal(size=3)
        ),
        T_velodyne_imu=Pose.from_rotation("velodyne", "imu", rotation(2), rng.normal(size=3)),
        lidar_pitch_rad=1e-3 / 3,
        correction=DisparityCorrection(rng.normal(size=10) / 3, 0.1 + 0.2, "22 frames, Velodyne"),
        rows=RowCorrection(rng.normal(size=9) / 3, 0.1 + 0.7, "matches of 22 frames"),
        origin='KITTI 2011_09_26, "größer" \n\udcff',
    )


def assert_same(a: StereoRig, b: StereoRig) -> None:
    for camera, other in ((a.left, b.left), (a.right, b.right)):
        assert camera.K.tobytes() == other.K.tobytes()
        assert camera.distortion.tobytes() == other.distortion.tobytes()
        assert (camera.size_px, camera.model, camera.frame) == (
            other.size_px,
            other.model,
            other.frame,
        )
    for name in ("T_right_left", "T_left_velodyne", "T_velodyne_imu"):
        pose, other_pose = getattr(a, name), getattr(b, name)
        assert (pose is None) == (other_pose is None)
        if pose is not None:
            assert (pose.dst, pose.src) == (other_pose.dst, other_pose.src)
            assert np.array_equal(pose.matrix, other_pose.matrix)
    assert a.lidar_pitch_rad == b.lidar_pitch_rad
    for mine, theirs in ((a.correction, b.correction), (a.rows, b.rows)):
        assert (mine is None) == (theirs is None)
        if mine is not None and theirs is not None:
            assert mine.coefficients.tobytes() == theirs.coefficients.tobytes()
            assert mine.residual_px == theirs.residual_px
            assert mine.origin == theirs.origin
    assert a.origin == b.origin


@pytest.mark.parametrize("rectified", [True, False])
def test_round_trip_is_exact(tmp_path: Path, rectified: bool) -> None:
    rig = full_rig(rectified=rectified)
    write_rig(tmp_path / "rig.json", rig)
    assert_same(read_rig(tmp_path / "rig.json"), rig)


def test_round_trip_of_fisheye_and_two_sizes() -> None:
    rig = full_rig(rectified=False)
    small = replace(rig.right, K=rig.right.K / 2 + np.diag([0, 0, 0.5]), width_px=640)
    fish = replace(small, distortion=np.array([0.1, -0.2, 1e-300, 0]), model="fisheye")
    rig = replace(rig, right=fish, correction=None, T_left_velodyne=None, T_velodyne_imu=None)
    assert_same(parse_rig(rig_text(rig), "rig.json"), rig)


def test_rectified_rig_is_written_by_its_baseline() -> None:
    rig = parse_rig(MINIMAL_RIG, "rig.json")
    text = rig_text(rig)
    assert '"baseline_m": 0.54' in text
    assert "T_right_left" not in text
    assert_same(parse_rig(text, "rig.json"), rig)


def test_minimal_form() -> None:
    rig = parse_rig(MINIMAL_RIG, "rig.json")
    assert rig.is_rectified
    assert rig.baseline_m == 0.54
    assert rig.left.size_px == (1242, 375)
    assert np.array_equal(rig.left.K, [[721.5, 0, 609.6], [0, 721.5, 172.9], [0, 0, 1]])
    assert np.array_equal(rig.right.K, rig.left.K)
    assert rig.correction is None


def test_bom_crlf_and_trailing_blanks(tmp_path: Path) -> None:
    path = tmp_path / "rig.json"
    text = MINIMAL_RIG.replace(",", ",  \r\n")
    path.write_bytes(b"\xef\xbb\xbf" + text.encode() + b" \r\n\r\n")
    assert read_rig(path).baseline_m == 0.54


def test_missing_shows_the_least(tmp_path: Path) -> None:
    with pytest.raises(CalibrationMissing) as caught:
        read_rig(tmp_path / "rig.json")
    shown = caught.value.fix[caught.value.fix.index("{") :]
    assert parse_rig(shown, "shown").baseline_m == 0.54


def changed(**fields: object) -> str:
    """The minimal rig with other fields; None takes one out."""
    rig = json.loads(MINIMAL_RIG) | fields
    return json.dumps({key: value for key, value in rig.items() if value is not None})


EYE = np.eye(3).tolist()
LEFT = {"fx": 700, "cx": 600, "cy": 170}
MISTAKES = {
    # row 18: missing and unknown keys
    "no width": (changed(width_px=None), CalibrationField, "line 1", "'width_px'"),
    "no baseline": (changed(baseline_m=None), CalibrationField, "line 1", "'baseline_m'"),
    "both": (
        changed(T_right_left={"R": EYE, "t_m": [-1, 0, 0]}),
        CalibrationField,
        "baseline_m",
        "both",
    ),
    "unknown": (changed(baselin_m=1), CalibrationField, "baselin_m", "unknown"),
    "no cx": (changed(left={"fx": 1, "cy": 2}), CalibrationField, "left", "'cx'"),
    "K and fx": (changed(left={"K": EYE, "fx": 1}), CalibrationField, "left", "both"),
    "pitch": (
        changed(lidar_pitch_rad=0.2),
        CalibrationValue,
        "lidar_pitch_rad",
        "off by 11.5 degrees",
    ),
    "no t": (changed(T_left_velodyne={"R": EYE}), CalibrationField, "T_left_velodyne", "'t_m'"),
    # row 19: wrong counts
    "K of 2": (changed(left={"K": [[1, 0, 1], [0, 1, 1]]}), CalibrationSyntax, "left.K", "2"),
    "row of 4": (
        changed(left={"K": [[1, 0, 1], [0, 1, 1, 5], [0, 0, 1]]}),
        CalibrationSyntax,
        "left.K[1]",
        "4",
    ),
    "distortion of 3": (
        changed(left={**LEFT, "distortion": [1, 2, 3]}),
        CalibrationSyntax,
        "left.distortion",
        "3 numbers",
    ),
    "rows of 8": (
        changed(rows={"coefficients": [0] * 8, "residual_px": 0.2}),
        CalibrationSyntax,
        "rows.coefficients",
        "8",
    ),
    "rows residual < 0": (
        changed(rows={"coefficients": [0] * 9, "residual_px": -1}),
        CalibrationValue,
        "rows.residual_px",
        "negative",
    ),
    "correction of 7": (
        changed(correction={"coefficients": [0] * 7, "residual_px": 0.2}),
        CalibrationSyntax,
        "correction.coefficients",
        "7",
    ),
    # row 20: what is no number
    "text": (changed(baseline_m="0.54"), CalibrationSyntax, "baseline_m", '"0.54"'),
    "true": (changed(baseline_m=True), CalibrationSyntax, "baseline_m", "true"),
    "list": (changed(baseline_m=[1]), CalibrationSyntax, "baseline_m", "list"),
    "half pixel": (changed(width_px=1242.5), CalibrationSyntax, "width_px", "1242.5"),
    "nan": (MINIMAL_RIG.replace("721.5", "NaN"), CalibrationSyntax, "left.fx", "NaN"),
    "inf": (MINIMAL_RIG.replace("721.5", "Infinity"), CalibrationSyntax, "left.fx", "Inf"),
    "overflow": (MINIMAL_RIG.replace("721.5", "1e999"), CalibrationSyntax, "left.fx", "1e999"),
    "underscore": (MINIMAL_RIG.replace("721.5", "7_21"), CalibrationSyntax, "left.fx", "7_21"),
    "comma": (MINIMAL_RIG.replace("721.5", "721,5"), CalibrationSyntax, "line 1", "5"),
    "full width": (MINIMAL_RIG.replace("721.5", "７２１"), CalibrationSyntax, "left.fx", "７"),
    "plus": (MINIMAL_RIG.replace("721.5", "+721"), CalibrationSyntax, "left.fx", "+721"),
    # row 21: twice
    "twice": (
        '{"schema": 1,\n"schema": 1}',
        CalibrationField,
        "lines 1 and 2",
        "'schema' twice",
    ),
    # row 22: impossible values
    "negative f": (changed(left={**LEFT, "fx": -1}), CalibrationValue, "left", "-1"),
    "centre": (changed(left={**LEFT, "cx": 2000}), CalibrationValue, "left", "2000"),
    "baseline 0": (changed(baseline_m=0), CalibrationValue, "baseline_m", "0 m"),
    "baseline < 0": (changed(baseline_m=-0.5), CalibrationValue, "baseline_m", "-0.5"),
    "swapped": (
        changed(baseline_m=None, T_right_left={"R": EYE, "t_m": [0.5, 0, 0]}),
        CalibrationValue,
        "T_right_left",
        "right of the other",
    ),
    "K last row": (
        changed(left={"K": [[700, 0, 600], [0, 700, 170], [0, 0, 2]]}),
        CalibrationValue,
        "left.K",
        "rows",
    ),
    "residual < 0": (
        changed(correction={"coefficients": [0] * 8, "residual_px": -1}),
        CalibrationValue,
        "correction.residual_px",
        "negative",
    ),
    "lens": (changed(left={**LEFT, "model": "lens"}), CalibrationValue, "left.model", "'lens'"),
    "schema 2": (changed(schema=2), CalibrationValue, "schema", "2"),
    # row 23: rotation
    "not orthonormal": (
        changed(T_left_velodyne={"R": [[1, 0.01, 0], [0, 1, 0], [0, 0, 1]], "t_m": [0, 0, 0]}),
        CalibrationValue,
        "T_left_velodyne.R",
        "0.01",
    ),
    "mirror": (
        changed(T_left_velodyne={"R": [[-1, 0, 0], [0, 1, 0], [0, 0, 1]], "t_m": [0, 0, 0]}),
        CalibrationValue,
        "T_left_velodyne.R",
        "2",
    ),
    # row 24: millimetres
    "millimetres": (changed(baseline_m=193), CalibrationValue, "baseline_m", "193"),
    # syntax
    "empty": ("", CalibrationSyntax, "line 1", "end of the file"),
    "cut": (MINIMAL_RIG[:-30], CalibrationSyntax, "line 1", ""),
    "list at the top": ("[]", CalibrationSyntax, "line 1", "list"),
    "after the end": (MINIMAL_RIG + "}", CalibrationSyntax, "line 1", "after the end"),
    "trailing comma": ('{"schema": 1,\n}', CalibrationSyntax, "line 1", "comma"),
    "single quotes": ("{'schema': 1}", CalibrationSyntax, "line 1, column 2", "'"),
    "comment": ("// rig\n" + MINIMAL_RIG, CalibrationSyntax, "line 1", "//"),
    "brackets": ("[" * 20_000, CalibrationSyntax, "line 1, column 34", "brackets"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_named_by_their_place(tmp_path: Path, mistake: str) -> None:
    text, kind, where, got = MISTAKES[mistake]
    path = tmp_path / "rig.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(PseudolidarError) as caught:
        read_rig(path)
    assert type(caught.value) is kind
    assert caught.value.path == str(path)
    assert where in caught.value.where
    assert got in caught.value.got


def test_lines_and_columns_are_those_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "rig.json"
    path.write_text(rig_text(full_rig(rectified=True)).replace("1242", "12_42"))
    with pytest.raises(CalibrationSyntax) as caught:
        read_rig(path)
    place = caught.value.where
    line = path.read_text().splitlines()[int(place.split("line ")[1].split(",")[0]) - 1]
    assert line[int(place.split("column ")[1]) - 1 :].startswith("12_42")


def read_or_refuse(path: Path) -> StereoRig | PseudolidarError:
    try:
        return read_rig(path)
    except PseudolidarError as error:
        return error


def test_any_cut_and_any_damaged_byte_is_a_rig_or_our_error(tmp_path: Path) -> None:
    data = rig_text(full_rig(rectified=True)).encode()
    path = tmp_path / "rig.json"
    rng = np.random.default_rng(0)
    for place in rng.integers(0, len(data) - 2, 150):
        path.write_bytes(data[:place])
        cut = read_or_refuse(path)
        assert isinstance(cut, PseudolidarError)
        assert cut.path == str(path)
        path.write_bytes(data[:place] + rng.bytes(1) + data[place + 1 :])
        damaged = read_or_refuse(path)
        assert isinstance(damaged, StereoRig) or damaged.path == str(path)


def test_large_binary_and_folder(tmp_path: Path) -> None:
    path = tmp_path / "rig.json"
    with path.open("wb") as file:
        os.truncate(file.fileno(), 10**9)
    with pytest.raises(LimitError):
        read_rig(path)
    path.write_bytes(MINIMAL_RIG.encode("utf-16"))
    with pytest.raises(CalibrationSyntax):
        read_rig(path)
    with pytest.raises(LimitError):
        read_rig(path, limits=Limits(text_bytes=100))
    (tmp_path / "folder").mkdir()
    with pytest.raises(CalibrationSyntax):
        read_rig(tmp_path / "folder")


def test_rounded_rotation_is_told() -> None:
    R = [[1, 5e-5, 0], [0, 1, 0], [0, 0, 1]]
    rig = parse_rig(changed(T_left_velodyne={"R": R, "t_m": [0, 0, 0]}), "rig.json")
    (warning,) = rig_notes(rig)
    assert "T_camera_left_velodyne" in warning
    assert "5.0e-05" in warning
    refined, raised = rig_notes(full_rig(rectified=True))
    assert "leaves 0.30 px (22 frames, Velodyne)" in refined
    assert "raised by 0.019 degrees" in raised
    bare = replace(full_rig(rectified=True), correction=None, lidar_pitch_rad=0.0)
    assert rig_notes(bare) == ()


def test_other_frame_names_are_not_lost_silently(tmp_path: Path) -> None:
    rig = full_rig(rectified=True)
    with pytest.raises(StructureError, match="cam2"):
        write_rig(tmp_path / "rig.json", replace(rig, left=replace(rig.left, frame="cam2")))
    with pytest.raises(OutputError):
        write_rig(Path("/proc/nowhere/rig.json"), rig)


def test_schema_accepts_what_is_written_and_refuses_mistakes() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(rig_schema())
    jsonschema.Draft202012Validator.check_schema(rig_schema())
    for text in (
        MINIMAL_RIG,
        rig_text(full_rig(rectified=True)),
        rig_text(full_rig(rectified=False)),
        rig_text(parse_rig(MINIMAL_RIG, "")),
    ):
        validator.validate(json.loads(text))
    for mistake in ("no width", "no baseline", "both", "unknown", "K and fx", "row of 4", "lens"):
        assert not validator.is_valid(json.loads(MISTAKES[mistake][0])), mistake


def test_the_uncertainty_of_a_correction_stays(tmp_path: Path) -> None:
    rig = full_rig(rectified=True)
    assert rig.correction is not None
    half = np.random.default_rng(1).normal(size=(10, 10))
    scale = SigmaScale(np.array([6.5, 15.0, 40.0]), np.array([0.6, 0.9, 0.7]))
    known = replace(
        rig.correction, sigma_scale=scale, covariance=half @ half.T, fitted_m=(4.5, 78.25)
    )
    write_rig(tmp_path / "rig.json", rig.with_correction(known))
    read = read_rig(tmp_path / "rig.json").correction
    assert read is not None
    np.testing.assert_array_equal(read.sigma_scale.disparities_px, scale.disparities_px)
    np.testing.assert_array_equal(read.sigma_scale.factors, scale.factors)
    assert read.fitted_m == (4.5, 78.25)
    np.testing.assert_array_equal(read.covariance, known.covariance)
    d, u, v = np.array([5.0, 50.0]), np.array([0.0, 600.0]), np.array([10.0, 300.0])
    sigma_px = read.offset_sigma_px(d, u, v, rig.left.size_px)
    features = read.features(d, u, v, rig.left.size_px)
    np.testing.assert_allclose(sigma_px, np.linalg.norm(features @ half, axis=1))


def test_one_factor_on_sigma_is_a_number() -> None:
    good = rig_text(full_rig(rectified=True))
    read = parse_rig(good.replace('"sigma_scale": 1.0', '"sigma_scale": 0.7'), "rig.json")
    np.testing.assert_array_equal(read.sigma_scale.at(np.array([3.0, 80.0])), 0.7)
    assert '"sigma_scale": 0.7' in rig_text(read)


@pytest.mark.parametrize("scale", ["0", "-1", "[[5, 1], [9, 0]]", "[[9, 1], [5, 1]]"])
def test_an_impossible_factor_on_sigma_is_refused(scale: str) -> None:
    good = rig_text(full_rig(rectified=True))
    text = good.replace('"sigma_scale": 1.0', f'"sigma_scale": {scale}')
    assert f'"sigma_scale": {scale}' in text
    with pytest.raises(CalibrationValue, match="sigma_scale"):
        parse_rig(text, "rig.json")


def test_a_correction_of_eight_coefficients_has_none_of_the_last_two(tmp_path):
    """Rig files had eight before x^2 y and x^4 came."""
    half = np.random.default_rng(3).normal(size=(8, 8))
    earlier = {
        "coefficients": list(range(1, 9)),
        "residual_px": 0.1,
        "covariance": (half @ half.T).tolist(),
    }
    (tmp_path / "rig.json").write_text(changed(correction=earlier))
    correction = read_rig(tmp_path / "rig.json").correction
    assert correction.coefficients.tolist() == [*range(1, 9), 0, 0]
    assert np.allclose(correction.covariance[:8, :8], half @ half.T)
    assert not correction.covariance[8:].any()
