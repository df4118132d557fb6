"""Pictures with depth: TUM's RGB-D layout, and plain folders of depth cameras."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from pseudolidar.errors import (
    CalibrationMissing,
    MapScale,
    PseudolidarError,
    SourceUnknown,
    UsageError,
)
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.image import read_image, read_size
from pseudolidar.formats.pictures.map_pixels import read_map_pixels
from pseudolidar.formats.rigs.camera_file import CameraReading, read_camera
from pseudolidar.formats.tum import read_tum_trajectory
from pseudolidar.geometry.frames import BASE_LINK, MAP, R_BODY_OPTICAL
from pseudolidar.sources.depth_layout import (
    TRAJECTORY,
    DepthLayout,
    DepthPair,
    find_camera,
    find_depth_layout,
    has_layout,
)
from pseudolidar.sources.source import SourceSummary
from pseudolidar.sources.stamps import FrameTimes, synthetic_times
from pseudolidar.sources.timed_pairs import nearest
from pseudolidar.structures.arrays import Float32, Float64
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.disparity import DepthMap
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import DepthFrame

# Steps a metre of TUM's depth pictures, and of those that are in millimetres.
TUM_STEPS, MILLIMETRE_STEPS = 5000.0, 1000.0
# Camera that TUM's depth was registered with, by the page of its file formats.
TUM_SIZE_PX = (640, 480)
TUM_K = np.array([[525.0, 0.0, 319.5], [0.0, 525.0, 239.5], [0.0, 0.0, 1.0]])
# Pictures that are looked at for their size.
PICTURES_TRIED = 20


@dataclass(frozen=True)
class TumDepth:
    """Pictures with depth: `rgb`, `depth`, `rgb.txt`, `depth.txt` as of TUM, or plain folders.

    TUM: paired by time, poses of `groundtruth.txt`. Plain folders `rgb`, `color` or `image` beside
    `depth` (RealSense, ScanNet, Replica): paired by the number in the names; with the camera in
    `K.txt`, `camera.json`, `intrinsic/intrinsic_color.txt` or the like.

    Args:
        path: the folder.
        rig: file with the camera; else the one in the folder.
        depth_scale: steps a metre of 16-bit depth; by default what the camera's file says, else
            5000 for TUM's layout and 1000 (millimetres) for others.
        tolerance_s: largest difference of times that belong together.
        rate_hz: frames a second, where no times are known.
        limits: caps on the files.
    """

    path: str
    rig: str | None = None
    depth_scale: float | None = None
    tolerance_s: float = 0.02
    rate_hz: float = 10.0
    limits: Limits = DEFAULT_LIMITS

    @classmethod
    def looks_like(cls, path: Path) -> bool:
        """Whether `path` holds pictures with depth, by content."""
        return has_layout(path)

    def open(self) -> DepthPictures:
        """List and pair the pictures, read camera and poses.

        Raises:
            SourceUnknown: not this layout. SourceEmpty: no pair.
            CalibrationMissing, CalibrationField, CalibrationSyntax, CalibrationValue: no good
                camera.
            SequenceTime, PoseFileError: lists or trajectory are not legal.
            UsageError: a depth scale that is none.
        """
        folder = Path(self.path)
        if not has_layout(folder):
            raise SourceUnknown(
                "no pictures with depth",
                want="rgb.txt and depth.txt, or folders rgb and depth",
                path=folder,
            )
        if self.depth_scale is not None and not self.depth_scale > 0:
            raise UsageError(f"depth_scale {self.depth_scale:g}", want="above 0")
        layout = find_depth_layout(folder, tolerance_s=self.tolerance_s, limits=self.limits)
        reading = self._camera(folder, layout)
        steps, scale_note = self._steps(reading, layout)
        times = _times(layout, self.rate_hz)
        poses, pose_notes = self._poses(folder, times)
        notes = (f"pairs: {layout.rule}", *times.notes, scale_note, *reading.notes, *pose_notes)
        return DepthPictures(
            summary=_summary(self.path, layout, reading.camera, poses, notes),
            pairs=layout.pairs,
            timestamps_ns=times.timestamps_ns,
            refused=layout.refused,
            poses=poses,
            camera=reading.camera,
            steps_per_m=steps,
            limits=self.limits,
        )

    def _camera(self, folder: Path, layout: DepthLayout) -> CameraReading:
        size = _first_size(layout.pairs, self.limits)
        file = find_camera(folder) if self.rig is None else Path(self.rig)
        if file is not None:
            return read_camera(file, size_px=size, limits=self.limits)
        if layout.timed and size == TUM_SIZE_PX:
            note = "camera: f 525 px, centre (319.5, 239.5), which TUM's depth is registered with"
            return CameraReading(Camera(TUM_K.copy(), *size), None, (note,))
        raise CalibrationMissing(
            f"no camera for pictures of {size[0]}x{size[1]}",
            want="K.txt with nine numbers, or camera.json with fx, fy, cx and cy",
            fix="Put one into the folder, or name it by --rig.",
            path=folder,
        )

    def _steps(self, reading: CameraReading, layout: DepthLayout) -> tuple[float, str]:
        """Steps a metre, and where that is from."""
        if self.depth_scale is not None:
            return self.depth_scale, f"depth: {self.depth_scale:g} steps a metre, as asked for"
        if reading.steps_per_m is not None:
            return reading.steps_per_m, (
                f"depth: {reading.steps_per_m:g} steps a metre, as the camera's file says"
            )
        if layout.timed:
            return TUM_STEPS, f"depth: {TUM_STEPS:g} steps a metre, as in TUM's data"
        return MILLIMETRE_STEPS, "depth: millimetres, as depth cameras write"

    def _poses(
        self, folder: Path, times: FrameTimes
    ) -> tuple[tuple[Pose | None, ...], tuple[str, ...]]:
        """Pose of each frame by its time; none without a trajectory, or without times."""
        path = folder / TRAJECTORY
        if not path.is_file() or times.notes:
            return (None,) * len(times.timestamps_ns), ()
        stamps, T_world_camera = read_tum_trajectory(path, limits=self.limits)
        order = np.argsort(np.array(stamps, dtype=np.int64), kind="stable")
        increasing = [stamps[k] for k in order]
        tolerance_ns = round(self.tolerance_s * 1e9)
        at = [nearest(increasing, t, tolerance_ns=tolerance_ns) for t in times.timestamps_ns]
        poses = tuple(None if k is None else _body_pose(T_world_camera[order[k]]) for k in at)
        lost = sum(pose is None for pose in poses)
        notes = [f"poses: {TRAJECTORY}, map is its world"]
        if lost:
            notes.append(f"poses: {lost} frames without one within {self.tolerance_s * 1e3:g} ms")
        return poses, tuple(notes)


@dataclass(frozen=True, eq=False)
class DepthPictures:
    """Opened pictures with depth.

    Args:
        summary: what it is.
        pairs: the files by frame.
        timestamps_ns: times of the frames.
        refused: pictures without depth.
        poses: `T_map_base_link` by frame, None where nobody knows.
        camera: of picture and depth.
        steps_per_m: of stored integers.
        limits: caps on the files.
    """

    summary: SourceSummary
    pairs: tuple[DepthPair, ...]
    timestamps_ns: tuple[int, ...]
    refused: tuple[tuple[str, PseudolidarError], ...]
    poses: tuple[Pose | None, ...]
    camera: Camera = field(repr=False)
    steps_per_m: float
    limits: Limits = DEFAULT_LIMITS
    yields: ClassVar = DepthFrame
    rig: ClassVar = None

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the frames."""
        return tuple(pair.name for pair in self.pairs)

    def load(self, index: int) -> DepthFrame:
        """Read and decode a picture and its depth.

        Raises:
            ImageMissing, ImageUnreadable, ImageTruncated, ImageFormat, LimitError: as they say.
            StructureError: picture and depth differ in size.
            CalibrationSizeMismatch: the camera is for another size.
            MapScale: most depths are beyond what any depth camera sees.
        """
        pair = self.pairs[index]
        picture = read_image(pair.picture, limits=self.limits)
        stored = read_map_pixels(pair.depth, limits=self.limits)
        values = stored.values / np.float32(self.steps_per_m) if stored.whole else stored.values
        check_depth_scale(values, self.steps_per_m if stored.whole else 1.0, pair.depth)
        try:
            return DepthFrame(
                picture.pixels,
                DepthMap(values),
                self.camera,
                pair.name,
                index,
                self.timestamps_ns[index],
                pose=self.poses[index],
                notes=picture.notes,
            )
        except PseudolidarError as error:
            raise error.located(pair.depth) from None


# Depths that pictures with depth can have, m: indoor cameras to outdoor networks.
NEAREST_M, FARTHEST_M = 0.05, 500.0


def check_depth_scale(values: Float32, steps_per_m: float, path: Path) -> None:
    """Refuse depth that cannot be in the unit it is read in.

    Raises:
        MapScale: more than half of it lies outside 0.05 to 500 m.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return
    outside = (known < NEAREST_M) | (known > FARTHEST_M)
    if np.mean(outside) <= 0.5:
        return
    median = float(np.median(known))
    others = [s for s in (1.0, 256.0, MILLIMETRE_STEPS, TUM_STEPS) if s != steps_per_m]
    readings = ", ".join(f"{median * steps_per_m / s:.3g} m at {s:g}" for s in others)
    raise MapScale(
        f"a median depth of {median:.3g} m at {steps_per_m:g} steps a metre",
        want=f"depths of {NEAREST_M:g} to {FARTHEST_M:g} m",
        fix=f"It would be {readings}: say which by --source.depth-scale.",
        path=path,
    )


def _body_pose(T_world_camera: Float64) -> Pose:
    """`T_map_base_link` of a camera's pose: `base_link` is the camera turned to x forward."""
    T_camera_base = np.eye(4)
    T_camera_base[:3, :3] = R_BODY_OPTICAL.T
    return Pose(MAP, BASE_LINK, T_world_camera @ T_camera_base)


def _first_size(pairs: Sequence[DepthPair], limits: Limits) -> tuple[int, int]:
    error: PseudolidarError | None = None
    for pair in pairs[:PICTURES_TRIED]:
        try:
            return read_size(pair.picture, limits=limits)
        except PseudolidarError as fault:
            error = error or fault
    assert error is not None
    raise error


def _times(layout: DepthLayout, rate_hz: float) -> FrameTimes:
    stamps = [pair.time_ns for pair in layout.pairs]
    known = tuple(stamp for stamp in stamps if stamp is not None)
    if len(known) < len(stamps):
        return synthetic_times(range(len(stamps)), rate_hz)
    return FrameTimes(known)


def _summary(
    path: str,
    layout: DepthLayout,
    camera: Camera,
    poses: Sequence[Pose | None],
    notes: tuple[str, ...],
) -> SourceSummary:
    size = f"{camera.width_px}x{camera.height_px} px"
    posed = ", poses" if any(pose is not None for pose in poses) else ""
    words = {"K": camera.K.tolist(), "size_px": camera.size_px}
    return SourceSummary(
        kind="tum-depth",
        path=path,
        line=f"pictures with depth: {len(layout.pairs)} by {layout.rule}, {size}, "
        f"f {camera.focal_px:g} px{posed}",
        notes=notes,
        camera=json.dumps(words),
    )
