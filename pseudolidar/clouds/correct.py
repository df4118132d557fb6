"""`--guide scan`: the metres of a stereo cloud corrected by the few beams of a LiDAR."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, Self

import numpy as np

from pseudolidar.clouds.correct_points import MeasuredPoints
from pseudolidar.errors import CalibrationField, ScanMissing, StereoConfig, StructureError
from pseudolidar.geometry.lasers import BeamPattern, scan_of_beams
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DepthMap
from pseudolidar.structures.frame import StereoFrame

# Column that says how much the beams tell about each point, 0-1.
GUIDED = "guided"
# Figures of a frame: points of the beams in view, those on a point of the cloud, mean of the column
# `guided`, and by how much disparities were changed, px (median).
BEAM_POINTS, ANCHORED = "guide_beam_points", "guide_anchors"
GUIDED_SHARE, MOVED_PX = "guide_share", "guide_moved_px"
# Fewer anchors than this say too little.
LEAST_ANCHORS = 30
# A frame with its scan moved to one moment. Which laser measured a point is told by the order of
# the points as they were taken, so beams are chosen first.
PutRight = Callable[[StereoFrame], StereoFrame]


@dataclass(frozen=True)
class Scan:
    """Correct clouds by the LiDAR scan of each frame: rig and surfaces, where beams tell of them.

    Args:
        beams: lasers of the scan that are used, 64 for all; the others simulate cheaper sensors.
        pattern: which lasers: `even` from top to bottom, `level` 0.8 degrees apart from the horizon
            down.
        neighbours: of each small surface, that it must agree with.
    """

    beams: Literal[64, 32, 16, 8, 4] = 64
    pattern: BeamPattern = "even"
    neighbours: int = 8

    def __post_init__(self) -> None:
        if self.neighbours < 2:
            raise StereoConfig(
                f"neighbours = {self.neighbours}", want="2 or more", where="neighbours"
            )

    def load(self, rig: StereoRig | None = None, *, put_right: PutRight | None = None) -> Guide:
        """The corrector, for frames of a rig.

        Args:
            rig: of the frames, where it is known.
            put_right: what is done to the beams before they are used; nothing by default.

        Raises:
            CalibrationField: the rig does not know where the LiDAR is.
        """
        if rig is not None:
            check_place(rig)
        return Guide(self, put_right)


class Guided(NamedTuple):
    """What the scan of a frame made of it.

    Args:
        cloud: corrected.
        depth: the same metres for the pixels that have a point.
        figures: counts and measures by name, for the report.
    """

    cloud: PointCloud
    depth: DepthMap
    figures: Mapping[str, float]


@dataclass(frozen=True)
class Guide:
    """Corrects clouds by scans; picklable, callable from several threads.

    Args:
        settings: which beams, and how; None leaves everything as it is.
        put_right: what is done to the beams before; None for nothing.
    """

    settings: Scan | None
    put_right: PutRight | None = None

    @classmethod
    def unused(cls) -> Self:
        """One that leaves everything as it is."""
        return cls(None)

    def check(self, frame: StereoFrame) -> None:
        """Refuse a frame that has nothing to be guided by, before it costs anything.

        Raises:
            ScanMissing: it has no scan.
            CalibrationField: its rig does not know where the LiDAR is.
        """
        if self.settings is None:
            return
        if frame.scan is None:
            raise ScanMissing(
                "no LiDAR scan of the same moment",
                want="one, as --guide asks for",
                fix="Leave the frame out with --exclude, or convert without --guide.",
                where=f"frame {frame.id}",
            )
        check_place(frame.rig)

    def __call__(self, frame: StereoFrame, cloud: PointCloud, depth: DepthMap) -> Guided:
        """Cloud and depth map of a frame, corrected as `corrected` does.

        Raises:
            ScanMissing, CalibrationField: as `check`.
        """
        if self.settings is None:
            return Guided(cloud, depth, {})
        self.check(frame)
        moved, figures = corrected(cloud, frame, self.settings, put_right=self.put_right)
        return Guided(moved, guided_depth(depth, moved), figures)


def corrected(
    cloud: PointCloud,
    frame: StereoFrame,
    settings: Scan,
    *,
    put_right: PutRight | None = None,
) -> tuple[PointCloud, Mapping[str, float]]:
    """Move the points along their rays to where beams and stereo together say that they are.

    Corrected is the disparity of each point, by the sum of two parts: the rig's error, smooth over
    the image (8 coefficients, fitted to the beams of this frame alone), and on each surface what
    the beams that meet it leave, as `SurfaceGraph` spreads it. Far from all beams the second fades
    to nothing. Column `guided` is 1 where beams tell all of it, 0 where only the rig's error could
    be told; `sigma_m` follows. No point is added or removed, and none is replaced by a LiDAR's: the
    noise from pixel to pixel stays. With fewer than 30 points of the scan on the cloud it is left
    as it is.

    Args:
        cloud: of this frame, in the left camera's frame, with `uv`.
        frame: with a scan, and a rig that knows where the LiDAR is.
        settings: which beams, and how.
        put_right: what is done to the beams first; None for nothing.

    Returns:
        The cloud, and counts and measures by name.

    Raises:
        ScanMissing, CalibrationField: as `Guide.check`.
        StructureError: the cloud is in another frame, or does not know its pixels.

    Source: after You et al., Pseudo-LiDAR++, ICLR 2020, section 4.2.
    """
    Guide(settings).check(frame)
    assert frame.scan is not None
    if cloud.uv is None or cloud.frame != frame.rig.left.frame:
        raise StructureError(
            f"a cloud in {cloud.frame!r}, {'without' if cloud.uv is None else 'with'} pixels",
            want=f"one in {frame.rig.left.frame!r} with uv",
            where="corrected",
        )
    points = MeasuredPoints.of(cloud, frame.rig)
    beams = scan_of_beams(frame.scan, settings.beams, pattern=settings.pattern)
    few = replace(frame, scan=beams)
    known, seen = points.known(few if put_right is None else put_right(few))
    figures = {BEAM_POINTS: float(seen), ANCHORED: float(len(known.point))}
    share = np.zeros(len(cloud), np.float32)
    figures |= {GUIDED_SHARE: 0.0, MOVED_PX: 0.0}
    if len(known.point) >= LEAST_ANCHORS:
        change, found, left_px = points.corrected(known, settings.neighbours)
        share[points.row] = found
        figures |= {GUIDED_SHARE: float(found.mean()), MOVED_PX: float(np.median(np.abs(change)))}
        cloud = points.moved(cloud, change, left_px)
    return replace(cloud, extra={**cloud.extra, GUIDED: share}), figures


def check_place(rig: StereoRig) -> None:
    """Refuse a rig that does not say where its LiDAR is.

    Raises:
        CalibrationField: it does not.
        CalibrationUnits: its lengths are no metres.
    """
    rig.check_metric()
    if rig.T_left_velodyne is None:
        raise CalibrationField(
            "a rig without the place of its LiDAR",
            want="T_left_velodyne in the calibration, as --guide asks for",
            fix="Convert without --guide, or give a rig.json with it by --rig.",
        )


def guided_depth(depth: DepthMap, cloud: PointCloud) -> DepthMap:
    """A depth map with the depths of the points of a cloud in the left camera's frame.

    Pixels without a point keep theirs.
    """
    assert cloud.uv is not None
    row = np.flatnonzero(cloud.valid)
    u, v = np.rint(cloud.uv[row]).astype(np.intp).T
    values = depth.values.copy()
    values[v, u] = cloud.xyz[row, 2]
    return DepthMap(values)
