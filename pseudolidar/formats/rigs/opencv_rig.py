"""Stereo rigs of OpenCV and ROS: matrices by name, in YAML, XML or JSON.

OpenCV's samples keep M1 D1 M2 D2 and R T R1 R2 P1 P2 Q, in one file or two; ROS keeps a camera a
file (`camera_info`). Both mean: K and D are of the picture as taken, P of the rectified one.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pseudolidar.errors import (
    CalibrationSyntax,
    CalibrationValue,
    PseudolidarError,
)
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.placed import Node, at_place
from pseudolidar.formats.rigs.rig_parts import LEFT, RIGHT
from pseudolidar.formats.rigs.rig_reading import (
    RigReading,
    RigUnit,
    checked_order,
    in_metres,
    of_one_rectification,
    pose_right_left,
)
from pseudolidar.formats.rigs.stereo_fields import Eye, StereoFields, of_eye
from pseudolidar.formats.rigs.stereo_lens import lens_refusal, with_lens
from pseudolidar.formats.rigs.stereo_sizes import Sizes, sizes_of
from pseudolidar.formats.rigs.storage import read_storage
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose

SUFFIXES = (".yml", ".yaml", ".xml", ".json")
# Q repeats what P1 and P2 say, both in 17 digits; beyond this one of them is of another rig.
Q_TOLERANCE = 1e-6


def read_opencv_rig(
    files: Mapping[str, Path],
    *,
    path: Path,
    size_px: tuple[int, int] | None = None,
    unit: RigUnit | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> RigReading:
    """Read a pair's cameras.

    Args:
        files: by a name with `left` or `right` in it; by any other name where the files name the
            eyes themselves.
        path: file or folder, for errors and words.
        size_px: (width, height) of the pictures, for files that do not say it.
        unit: of lengths, where metres are not meant.
        limits: cap on the files.

    Raises:
        CalibrationMissing, CalibrationField, CalibrationSyntax, CalibrationValue, LimitError: as
            they say, by line and column.
        CalibrationUnits: lengths that are no metres, and `unit` is not given.
    """
    fields = StereoFields.of(path, _parts(files, limits))
    form = "ROS camera_info" if fields.node("model", 0) else "OpenCV stereo calibration"
    sizes = sizes_of(fields, size_px)
    notes: list[str] = []
    rectified = _rectified(fields, sizes[0], unit)
    refusal = lens_refusal(fields)
    if refusal is None:
        raw = _raw(fields, sizes, unit, notes)
    elif rectified is not None:
        raw = None
        notes.append(f"{path.name}: {refusal.got.split(';')[0]}: P of both cameras alone counts")
    else:
        raise refusal
    if raw is not None and raw.is_rectified:
        # Nothing was rectified: T has the digits that P has lost by its product.
        rectified = raw
    if rectified is None and raw is None:
        raise _no_pose(fields)
    turns = None if raw is None or rectified in (None, raw) else _turns(fields)
    return RigReading(
        path,
        form,
        rectified,
        raw,
        tuple(notes),
        turns=turns,
        projections=_projections(fields),
        rectified_note="" if rectified in (None, raw) else _rectified_note(path, raw),
    )


def _no_pose(fields: StereoFields) -> PseudolidarError:
    """What keeps the place of the cameras to each other from being known."""
    P_left, P_right = (fields.node("P", eye) for eye in (0, 1))
    if P_left is not None and P_right is not None:
        path, where = fields.place("P", 1)
        return CalibrationValue(
            "baseline 0: the last column of both projection matrices is 0",
            want="-fx * baseline in row 1, column 4 of the right camera's",
            fix="Calibrate both cameras together: calibrations of one camera each do not know "
            "where the cameras stand to each other.",
            path=path,
            where=where,
        )
    without = [name for name in ("R", "T") if fields.node(name) is None]
    eye = fields.alone("P")
    if len(without) == 2 and eye is not None:
        return fields.lacks(of_eye("P", eye), "P1 and P2, or R and T")
    missing = without[0] if len(without) == 1 else "pose of the cameras to each other"
    return fields.lacks(missing, "R and T, or P1 and P2")


def _rectified_note(path: Path, raw: StereoRig | None) -> str:
    note = f"{path.name}: the pictures are taken for rectified: P of both cameras is used"
    if raw is None:
        return note
    return f"{note}, not K and distortion (--rectify.pictures raw if they are not)"


def _parts(files: Mapping[str, Path], limits: Limits) -> list[tuple[Eye, Node]]:
    """Trees by eye; of a file with a document for each camera, each by its camera's name."""
    parts: list[tuple[Eye, Node]] = []
    for eye, file in files.items():
        documents = read_storage(file, limits=limits)
        if len(documents) == 1:
            parts.append((eye_of(eye), documents[0]))
            continue
        named = [(_camera_eye(node), node) for node in documents]
        if sorted(str(name) for name, _ in named) != ["left", "right"]:
            raise CalibrationSyntax(
                f"{len(documents)} documents",
                want="one, or two with 'left' and 'right' in their camera_name",
                path=file,
                where=documents[1].where,
            )
        parts += named
    return parts


def _camera_eye(node: Node) -> Eye:
    name = node.value.get("camera_name") if isinstance(node.value, dict) else None
    return None if name is None else eye_of(str(name.value))


def eye_of(name: str) -> Eye:
    """Which eye a name means, None for both or neither."""
    left, right = "left" in name.lower(), "right" in name.lower()
    if left == right:
        return None
    return "left" if left else "right"


# --- rectified ---------------------------------------------------------------------------------


def _rectified(
    fields: StereoFields, size_px: tuple[int, int], unit: RigUnit | None
) -> StereoRig | None:
    """The rig of P1 and P2; None without them, or where ROS's P hold no baseline."""
    left, right = (fields.matrix("P", eye, 3, 4) for eye in (0, 1))
    if left is None or right is None:
        return None
    t = _offset(right, fields, 1) - _offset(left, fields, 0)
    if not t.any():
        return None
    path, where = fields.place("P", 1)
    # As in StereoRig.baseline_m: eyes that are not quite beside each other count at the centre.
    along_rows = float(t[0] + t[2] * right[0, 2] / right[0, 0])
    _check_q(fields, left, along_rows, float(left[0, 2] - right[0, 2]))
    checked_order(Pose.from_rotation(RIGHT, LEFT, np.eye(3), t), path=path, where=where)
    t_m = in_metres(t, unit, path=path, where=where)
    rig = StereoRig(
        _camera(left[:, :3].copy(), size_px, fields, "P", 0),
        _camera(right[:, :3].copy(), size_px, fields, "P", 1),
        Pose.from_rotation(RIGHT, LEFT, np.eye(3), t_m),
        origin=fields.path.name,
    )
    return of_one_rectification(rig, "P of both cameras", path=path, where=where)


def _projections(fields: StereoFields) -> dict[str, Float64]:
    """P of each eye as it is in the file, in the file's unit."""
    found = {f"P{eye + 1}": fields.matrix("P", eye, 3, 4) for eye in (0, 1)}
    return {name: P for name, P in found.items() if P is not None}


def _offset(P: Float64, fields: StereoFields, eye: int) -> Float64:
    """Translation of P = K [I | t]."""
    if (
        not np.array_equal(P[2, :3], (0.0, 0.0, 1.0))
        or P[1, 0] != 0
        or not np.sign(P[0, 0]) * np.sign(P[1, 1]) > 0
    ):
        raise CalibrationValue(
            "no projection of a rectified camera",
            want="K [I | t] with focal lengths above 0 and third row 0 0 1",
            path=fields.place("P", eye)[0],
            where=fields.place("P", eye)[1],
        )
    return np.asarray(np.linalg.solve(P[:, :3], P[:, 3]), dtype=np.float64)


def _check_q(fields: StereoFields, P: Float64, baseline: float, cx_difference: float) -> None:
    """Refuse a Q that is of another rig than P1 and P2; its sign differs between programs."""
    Q = fields.matrix("Q", None, 4, 4)
    if Q is None:
        return
    got = np.array([-Q[0, 3], -Q[1, 3], Q[2, 3], abs(Q[3, 2]), abs(Q[3, 3])])
    want = np.array([P[0, 2], P[1, 2], P[0, 0], abs(1 / baseline), abs(cx_difference / baseline)])
    scale = np.array([P[0, 0], P[1, 1], P[0, 0], abs(1 / baseline), abs(P[0, 0] / baseline)])
    names = ("cx", "cy", "f", "1 / baseline", "cx difference / baseline")
    for name, mine, theirs, size in zip(names, got, want, scale, strict=True):
        if abs(mine - theirs) > Q_TOLERANCE * size:
            raise CalibrationValue(
                f"Q has {name} {mine:.9g}, P1 and P2 have {theirs:.9g}",
                want="Q of the same rectification",
                fix="Take all matrices from one run of stereoRectify, or leave Q out.",
                path=fields.place("Q")[0],
                where=fields.place("Q")[1],
            )


# --- as taken ----------------------------------------------------------------------------------


def _raw(
    fields: StereoFields, sizes: Sizes, unit: RigUnit | None, notes: list[str]
) -> StereoRig | None:
    """The rig of K, D and the pose of the cameras; None where one of them is not known."""
    left, right = (fields.matrix("K", eye, 3, 3) for eye in (0, 1))
    T_right_left = _raw_pose(fields, unit)
    if T_right_left is None or left is None or right is None:
        return None
    as_taken = [
        with_lens(_camera(K, sizes[eye], fields, "K", eye), fields, eye)
        for eye, K in enumerate((left, right))
    ]
    if all(fields.node("D", eye) is None for eye in (0, 1)):
        notes.append(f"{fields.path.name}: no distortion numbers: lenses taken for straight")
    if all(camera.model == "pinhole" and len(camera.distortion) == 4 for camera in as_taken):
        notes.append(f"{fields.path.name}: four distortion numbers without a model are k1 k2 p1 p2")
    try:
        return StereoRig(
            as_taken[0], as_taken[1], T_right_left, origin=f"{fields.path.name}, as taken"
        )
    except PseudolidarError as error:
        raise error.located(fields.path) from None


def _raw_pose(fields: StereoFields, unit: RigUnit | None) -> Pose | None:
    R, T = fields.matrix("R", None, 3, 3), fields.matrix("T", None, 3, 1)
    if R is not None and T is not None:
        path, where = fields.place("R")
        pose = pose_right_left(R, T[:, 0], path=path, where=where)
        path, where = fields.place("T")
        checked_order(pose, path=path, where=where)
        t_m = in_metres(T[:, 0], unit, path=path, where=where)
        return Pose.from_rotation(RIGHT, LEFT, R, t_m)
    return _pose_of_rectification(fields, unit)


def _pose_of_rectification(fields: StereoFields, unit: RigUnit | None) -> Pose | None:
    """x_right = R2^T (R1 x_left + t): ROS keeps the pose in the rectification and P alone."""
    turns = _turns(fields)
    P1, P2 = (fields.matrix("P", eye, 3, 4) for eye in (0, 1))
    if turns is None or P1 is None or P2 is None:
        return None
    t = _offset(P2, fields, 1) - _offset(P1, fields, 0)
    if not t.any():
        return None
    R1, R2 = turns
    path, where = fields.place("P", 1)
    t_m = in_metres(t, unit, path=path, where=where)
    return Pose.from_rotation(RIGHT, LEFT, R2.T @ R1, R2.T @ t_m)


def _turns(fields: StereoFields) -> tuple[Float64, Float64] | None:
    """R1 and R2: directions of each camera to the rectified one's; None without them."""
    R1, R2 = (fields.matrix("R_rect", eye, 3, 3) for eye in (0, 1))
    if R1 is None or R2 is None:
        return None
    for eye, R in ((0, R1), (1, R2)):
        path, where = fields.place("R_rect", eye)
        pose_right_left(R, np.zeros(3), path=path, where=where)
    return R1, R2


def _camera(
    K: Float64, size_px: tuple[int, int], fields: StereoFields, kind: str, eye: int
) -> Camera:
    path, where = fields.place(kind, eye)
    if not np.array_equal(K[2], (0.0, 0.0, 1.0)) or K[1, 0] != 0:
        raise CalibrationValue(
            f"a camera matrix with rows {K[1].tolist()} and {K[2].tolist()}",
            want="[0, fy, cy] and [0, 0, 1]",
            path=path,
            where=where,
        )
    try:
        return Camera(K, *size_px, frame=(LEFT, RIGHT)[eye])
    except CalibrationValue as error:
        raise at_place(error, path=path, where=where) from None
