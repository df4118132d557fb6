"""`--guide scan`: the metres of a stereo cloud corrected by the few beams of a LiDAR."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, Self

import numpy as np

from pseudolidar.clouds.correct_graph import Known, SurfaceGraph
from pseudolidar.clouds.correct_rig import rig_error
from pseudolidar.errors import CalibrationField, ScanMissing, StereoConfig, StructureError
from pseudolidar.geometry.lasers import BeamPattern, scan_of_beams
from pseudolidar.geometry.projection import project_scan
from pseudolidar.geometry.triangulation import (
    depth_from_disparity,
    depth_per_disparity,
    disparity_from_depth,
)
from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.camera import DisparityCorrection, StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DepthMap
from pseudolidar.structures.frame import StereoFrame

# Column that says how much the beams tell about each point, 0-1.
GUIDED = "guided"
# Figures of a frame: points of the beams in view, those on a point of the cloud, mean of the column
# `guided`, and by how much disparities were changed, px (median).
BEAM_POINTS, ANCHORED = "guide_beam_points", "guide_anchors"
GUIDED_SHARE, MOVED_PX = "guide_share", "guide_moved_px"
# LiDAR and stereo disagree by more than this where they see different surfaces, px.
SAME_SURFACE_PX = 8.0
# How well a projected LiDAR point is known in disparity, px: 2 cm along the beam, and calibration
# and motion that put it some pixels aside. 0.1 and 0.5 change KITTI errors by 0.05 %.
LIDAR_PX = 0.25
# Matching error where the cloud does not state one, px (68 %, median of KITTI).
UNSTATED_PX = 0.3
# Systematic error that is left where beams are near, px (68 %): sigma then holds as many errors as
# on a refined rig (KITTI: 80-90 % within it, 97-99 % within its 95 % radius).
LEFT_PX = 0.1
# Fewer anchors than this say too little.
LEAST_ANCHORS = 30


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

    def load(self, rig: StereoRig | None = None) -> Guide:
        """The corrector, for frames of a rig.

        Raises:
            CalibrationField: the rig does not know where the LiDAR is.
        """
        if rig is not None:
            check_place(rig)
        return Guide(self)


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
    """

    settings: Scan | None

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
        moved, figures = corrected(cloud, frame, self.settings)
        return Guided(moved, guided_depth(depth, moved), figures)


def corrected(
    cloud: PointCloud, frame: StereoFrame, settings: Scan
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
    points = _Points.of(cloud, frame.rig)
    beams = scan_of_beams(frame.scan, settings.beams, pattern=settings.pattern)
    known, seen = points.known(replace(frame, scan=beams))
    figures = {BEAM_POINTS: float(seen), ANCHORED: float(len(known.point))}
    share = np.zeros(len(cloud))
    if len(known.point) < LEAST_ANCHORS:
        still = replace(cloud, extra={**cloud.extra, GUIDED: share.astype(np.float32)})
        return still, {**figures, GUIDED_SHARE: 0.0, MOVED_PX: 0.0}
    change, found, left_px = points.corrected(known, settings.neighbours)
    share[points.row] = found
    figures[GUIDED_SHARE] = float(found.mean())
    figures[MOVED_PX] = float(np.median(np.abs(change)))
    return points.moved(cloud, change, left_px, share), figures


def check_place(rig: StereoRig) -> None:
    """Refuse a rig that does not say where its LiDAR is.

    Raises:
        CalibrationField: it does not.
    """
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


@dataclass(frozen=True, eq=False)
class _Points:
    """The points of a cloud that are there, as the rig measures them.

    Args:
        rig: of the frame.
        row: (N,) int64 in the cloud.
        u: (N,) column, px.
        v: (N,) row, px.
        d: (N,) disparity, corrected as far as the rig knows its error, px.
        sigma: (N,) px, of matching alone.
    """

    rig: StereoRig
    row: Int64
    u: Float64
    v: Float64
    d: Float64
    sigma: Float64

    @classmethod
    def of(cls, cloud: PointCloud, rig: StereoRig) -> _Points:
        assert cloud.uv is not None
        row = np.flatnonzero(cloud.valid & (cloud.xyz[:, 2] > 0))
        u, v = cloud.uv[row].astype(np.float64).T
        depth_m = cloud.xyz[row, 2].astype(np.float64)
        d = disparity_from_depth(depth_m, u, rig)
        if cloud.sigma_m is None:
            return cls(rig, row, u, v, d, np.full(len(row), UNSTATED_PX))
        along = np.linalg.norm(cloud.xyz[row].astype(np.float64), axis=1) / depth_m
        total = cloud.sigma_m[row] / (along * depth_per_disparity(d, depth_m, rig))
        matching = np.sqrt(np.maximum(total**2 - rig.systematic_sigma_px**2, 0.0))
        return cls(rig, row, u, v, d, np.where(np.isfinite(matching), matching, UNSTATED_PX))

    def known(self, frame: StereoFrame) -> tuple[Known, int]:
        """What the scan calls for at the pixels that have a point, and its points in view."""
        assert frame.scan is not None
        scan = project_scan(frame.scan, self.rig)
        width, height = frame.size_px
        at_pixel = np.full((height, width), -1, np.int64)
        column, row = np.rint(np.stack([self.u, self.v])).astype(np.intp)
        at_pixel[row, column] = np.arange(len(self.row))
        column, row = np.rint(scan.uv).astype(np.intp).T
        point = at_pixel[row, column]
        both = point >= 0
        point = point[both]
        wanted = disparity_from_depth(scan.depth_m[both], self.u[point], self.rig)
        change = wanted - self.d[point]
        same = np.abs(change) < SAME_SURFACE_PX
        point, change = point[same], change[same]
        known = Known(point, change, np.hypot(self.sigma[point], LIDAR_PX))
        return known, len(scan.index)

    def corrected(self, known: Known, neighbours: int) -> tuple[Float64, Float64, Float64]:
        """(N,) change of the disparity, px; how far beams tell it; systematic error left, px."""
        features = DisparityCorrection.features(self.d, self.u, self.v, self.rig.left.size_px)
        systematic_px = self.rig.systematic_sigma_px
        error = rig_error(
            features[known.point], known.value, known.sigma, systematic_px=systematic_px
        )
        smooth, smooth_px = error.at(features)
        d = self.d + smooth
        graph = SurfaceGraph.of(
            self.u, self.v, d, width_px=self.rig.left.width_px, neighbours=neighbours
        )
        rest = replace(known, value=known.value - smooth[known.point])
        local, share = graph.spread(rest)
        least = min(LEFT_PX, systematic_px)
        alone = np.clip(smooth_px, least, max(least, systematic_px))
        return smooth + local, share, np.hypot((1 - share) * alone, share * least)

    def moved(
        self, cloud: PointCloud, change: Float64, left_px: Float64, share: Float64
    ) -> PointCloud:
        """The cloud with its points along their rays at the changed disparities.

        Where a disparity would pass infinity the point stays where it was.
        """
        d = self.d + change
        depth_m = depth_from_disparity(d, self.u, self.rig)
        before_m = cloud.xyz[self.row, 2].astype(np.float64)
        lost = ~(depth_m > 0)
        depth_m[lost], d[lost] = before_m[lost], self.d[lost]
        xyz = cloud.xyz.copy()
        xyz[self.row] *= (depth_m / before_m)[:, None].astype(xyz.dtype)
        extra = {**cloud.extra, GUIDED: share.astype(np.float32)}
        if cloud.sigma_m is None:
            return replace(cloud, xyz=xyz, extra=extra)
        along = np.linalg.norm(xyz[self.row].astype(np.float64), axis=1) / depth_m
        total = np.hypot(self.sigma, left_px) * along
        sigma_m = cloud.sigma_m.copy()
        sigma_m[self.row] = total * depth_per_disparity(d, depth_m, self.rig)
        return replace(cloud, xyz=xyz, sigma_m=sigma_m, extra=extra)
