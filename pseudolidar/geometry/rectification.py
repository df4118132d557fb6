"""From two cameras as they are mounted to the rectified pair that their pictures can become.

Both cameras are turned, in thought, until they look the same way and their rows lie along the
baseline; the same flat picture without distortion is then cut out of what each of them sees. Focal
length and centre of that picture follow OpenCV's `stereoRectify` and its `alpha`. What differs: a
direction is found from a pixel to the last digit (OpenCV stops after five steps), the centre stays
in place where the picture gets another size (OpenCV moves it by the square of the ratio), eyes may
differ in size and lens, and a fisheye, which sees what no flat picture can show, is cut at a field
of view.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.errors import CalibrationValue, UsageError
from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose

# A flat picture that is wider spends most of its pixels on its edges.
FISHEYE_FIELD_DEG = 120.0
NARROWEST_FIELD_DEG, WIDEST_FIELD_DEG = 10.0, 170.0
# Beyond these a picture shows one thing, or is a dot; a side that is shorter holds no window, px.
SMALLEST_ZOOM, LARGEST_ZOOM = 0.05, 20.0
LEAST_SIDE_PX = 16
# Pictures of pinhole lenses are not cut: what is this far off the axis is in none of them.
PINHOLE_FIELD_DEG = 176.0
# So near to each other, px, two sides leave nothing between them.
LEAST_PX = 1e-6
# Points along a side of a picture by which its outline is known, as in OpenCV.
OUTLINE_POINTS = 9
# The baseline must be this much along the rows: the cosine of 60 degrees.
LEAST_ALONG_ROWS = 0.5


@dataclass(frozen=True, eq=False)
class Rectification:
    """How the pictures of a rig become those of a rectified one.

    Args:
        raw: the cameras as they are.
        rig: the rectified pair. Its left camera stands where the left one does, and is turned.
        R_left: (3, 3) turns directions in the left camera's frame into the rectified one's.
        R_right: (3, 3) of the right one.
        shown_rows: first row and the one after the last whose points count, where neighbouring
            views show the others as well; None for all.
    """

    raw: StereoRig
    rig: StereoRig
    R_left: Float64
    R_right: Float64
    shown_rows: tuple[int, int] | None = None

    @property
    def T_rectified_left(self) -> Pose:
        """Pose of the left camera in its rectified frame."""
        frame = self.raw.left.frame
        return Pose.from_rotation(frame, frame, self.R_left, np.zeros(3))


def rectification(
    raw: StereoRig,
    *,
    alpha: float = 0.0,
    zoom: float = 1.0,
    size_px: tuple[int, int] | None = None,
    field_deg: float = FISHEYE_FIELD_DEG,
) -> Rectification:
    """Plan how pairs of a rig are rectified.

    Args:
        raw: the cameras as they are, with distortion, of any sizes and focal lengths.
        alpha: 0 zooms in until every pixel shows something, 1 out until nothing is lost.
        zoom: focal length times this, after that.
        size_px: (width, height) of the rectified pictures, by default those of the left camera.
        field_deg: widest field that is cut out of what a fisheye sees, degrees.

    Raises:
        UsageError: a number that makes no picture.
        CalibrationValue: the cameras do not stand side by side, or see nothing in common.

    Source: Bouguet's method as in OpenCV, `stereoRectify` with ZERO_DISPARITY.
    """
    _check_numbers(alpha, zoom, size_px, field_deg)
    R_left, R_right = aligning_rotations(raw.T_right_left)
    eyes = [(Lens.of(raw.left), R_left), (Lens.of(raw.right), R_right)]
    K = _flat_intrinsics(eyes, alpha, zoom, size_px or raw.left.size_px, field_deg)
    return turned(raw, R_left, R_right, K, size_px or raw.left.size_px)


def turned(
    raw: StereoRig, R_left: Float64, R_right: Float64, K: Float64, size_px: tuple[int, int]
) -> Rectification:
    """The rectification with given rotations and one camera matrix for both rectified eyes.

    Args:
        raw: the cameras as they are.
        R_left: (3, 3) turns directions of the left camera so that rows lie along the baseline.
        R_right: (3, 3) the same for the right one.
        K: (3, 3) of the rectified pictures.
        size_px: their (width, height).

    Raises:
        CalibrationValue: the centre of the picture lies outside of it; or the eyes are exchanged.
    """
    width, height = size_px
    left, right = (Camera(K, width, height, frame=eye.frame) for eye in (raw.left, raw.right))
    t_m = R_right @ raw.T_right_left.translation_m
    shift = np.array([np.copysign(np.linalg.norm(t_m), t_m[0]), 0.0, 0.0])
    frames = raw.T_right_left.dst, raw.T_right_left.src
    turn = Pose.from_rotation(raw.left.frame, raw.left.frame, R_left, np.zeros(3))
    rig = replace(
        raw,
        left=left,
        right=right,
        T_right_left=Pose.from_rotation(*frames, np.eye(3), shift),
        T_left_velodyne=raw.T_left_velodyne and turn @ raw.T_left_velodyne,
        origin=f"{raw.origin}, rectified" if raw.origin else "rectified",
    )
    return Rectification(raw, rig, R_left, R_right)


def aligning_rotations(T_right_left: Pose) -> tuple[Float64, Float64]:
    """(3, 3) rotations of both cameras into frames with one direction and rows on the baseline.

    Each camera is turned by half of what they differ, then both by what the baseline is off.

    Raises:
        CalibrationValue: one camera stands above or behind the other.
    """
    import cv2

    R, t_m = T_right_left.matrix[:3, :3], T_right_left.translation_m
    half = _rotation(-0.5 * np.asarray(cv2.Rodrigues(R)[0][:, 0], np.float64))
    t_m = half @ t_m
    length = float(np.linalg.norm(t_m))
    if abs(t_m[0]) < LEAST_ALONG_ROWS * length:
        below = abs(t_m[1]) > abs(t_m[2])
        raise CalibrationValue(
            f"cameras {'above' if below else 'behind'} each other: the right one sees the left one "
            f"at {t_m[0]:.3g}, {t_m[1]:.3g}, {t_m[2]:.3g} m",
            want="cameras side by side",
            fix="Turn pictures and calibration by 90 degrees." if below else "",
            where="T_right_left",
        )
    along = np.array([np.copysign(1.0, t_m[0]), 0.0, 0.0])
    axis = np.cross(t_m, along)
    sine = float(np.linalg.norm(axis))
    if sine > 0:
        axis *= np.arccos(min(abs(t_m[0]) / length, 1.0)) / sine
    onto_rows = _rotation(axis)
    return onto_rows @ half.T, onto_rows @ half


def _rotation(vector: Float64) -> Float64:
    return exp_twist(np.concatenate([np.zeros(3), vector]))[:3, :3]


def _flat_intrinsics(
    eyes: list[tuple[Lens, Float64]],
    alpha: float,
    zoom: float,
    size_px: tuple[int, int],
    field_deg: float,
) -> Float64:
    """(3, 3) camera matrix of the rectified pictures."""
    old, new = np.array(eyes[0][0].camera.size_px, float), np.array(size_px, float)
    focal = float(np.mean([lens.camera.K[1, 1] for lens, _ in eyes]))
    outlines = [_outline(lens, R, field_deg) for lens, R in eyes]
    middles = [grid[[0, 0, -1, -1], [0, -1, 0, -1]].mean(axis=0) for grid in outlines]
    centre = ((old - 1) / 2 - np.mean(middles, axis=0) * focal) * new / old
    before, behind = centre, new - 1 - centre
    inner, outer = [], []
    for grid in outlines:
        x, y = focal * grid[..., 0], focal * grid[..., 1]
        free = -x[:, 0].max(), x[:, -1].min(), -y[0].max(), y[-1].min()
        whole = -x.min(), x.max(), -y.min(), y.max()
        room = before[0], behind[0], before[1], behind[1]
        if min(free) < LEAST_PX or min(room) < LEAST_PX:
            raise CalibrationValue(
                "cameras that look in such different directions that no picture of both is left",
                want="cameras that look the same way",
                fix="Check R of the calibration: is it that of the right camera in the left one?",
                where="T_right_left",
            )
        inner.append(max(r / f for r, f in zip(room, free, strict=True)))
        outer.append(min(r / f for r, f in zip(room, whole, strict=True)))
    scale = (max(inner) * (1 - alpha) + min(outer) * alpha) * zoom
    return np.array([[focal * scale, 0, centre[0]], [0, focal * scale, centre[1]], [0, 0, 1.0]])


def _outline(lens: Lens, R: Float64, field_deg: float) -> Float64:
    """(9, 9, 2) where a grid over the picture lies on the rectified plane at distance one.

    What is further off the axis than half the field is moved to the edge of that.
    """
    width, height = lens.camera.size_px
    u, v = (np.linspace(0, side - 1, OUTLINE_POINTS) for side in (width, height))
    directions = lens.nearest_directions(np.stack(np.meshgrid(u, v), axis=-1)) @ R.T
    widest_deg = field_deg if lens.camera.model == "fisheye" else PINHOLE_FIELD_DEG
    edge = np.tan(np.deg2rad(widest_deg / 2))
    x, y, z = np.moveaxis(directions, -1, 0)
    side = np.maximum(np.abs(x), np.abs(y))
    beyond = z * edge <= side
    depth = np.where(beyond, side / edge, z)
    return np.asarray(np.stack([x, y], axis=-1) / depth[..., None])


def _check_numbers(
    alpha: float, zoom: float, size_px: tuple[int, int] | None, field_deg: float
) -> None:
    for name, value, low, high in (
        ("alpha", alpha, 0.0, 1.0),
        ("zoom", zoom, SMALLEST_ZOOM, LARGEST_ZOOM),
        ("field", field_deg, NARROWEST_FIELD_DEG, WIDEST_FIELD_DEG),
    ):
        if not low <= value <= high:
            raise UsageError(f"{name} {value:g}", want=f"{low:g} to {high:g}", where="rectify")
    if size_px is not None and min(size_px) < LEAST_SIDE_PX:
        raise UsageError(
            f"pictures of {size_px[0]}x{size_px[1]}",
            want=f"{LEAST_SIDE_PX} px or more",
            where="rectify",
        )
