"""The surfaces that a LiDAR scan saw: its points, and triangles between neighbouring beams."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.errors import CalibrationField, ReferenceMissing
from pseudolidar.geometry.open3d_library import load_open3d
from pseudolidar.geometry.projection import ProjectedScan, project, project_scan
from pseudolidar.structures.arrays import AnyArray, Bool, Float64, Int64
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.frame import LidarScan, StereoFrame

# Pixels this close to a beam's pixel are commonly seen: beams of an HDL-64 are 5 to 6.5 rows and
# 1 to 2 columns apart in a KITTI image, so a surface that sends them back leaves no pixel out.
SEEN_ROWS_PX, SEEN_COLUMNS_PX = 6, 4
# At the edge of an object, scan and picture are off by up to so much: they are taken some 10 ms
# apart (at 20 m/s), from places 6 cm aside of each other.
EDGE_M = 0.25
# Neighbouring beams are at most this far apart; farther ones have lost those between them.
MAX_GAP_RAD = np.deg2rad(1.2)
# A triangle belongs to one surface where its vertices differ in range by no more than this, m ...
SMOOTH_M = 0.2
# ... or than so many times its width across the beams (11 degrees between surface and beam) ...
STEEPEST = 5.0
# ... or where it goes on in the plane of the triangle beside it: ground far away. Sine of the angle
# between them.
IN_PLANE = 0.1
# The scan is used this far beyond the borders of the image, px: surfaces do not end there.
BORDER_PX = 30


@dataclass(frozen=True, eq=False)
class ScanSurface:
    """Surfaces of one scan, in the left camera's frame.

    Beams are 0.4 degrees apart from row to row, so that a point of a wall or of the road may be far
    from the nearest beam and yet on what it saw: neighbouring beams (Delaunay triangles over their
    directions) are joined to surfaces, but not across a jump in range. A jump is told from a
    surface at a grazing angle by whether the surface beside it goes on in the same plane.

    Args:
        points: (N, 3) float64 m, all points of the scan in view.
        triangles: (M, 3) int64 rows of `points`.
        uv: (N, 2) float64 px, where the left camera has them.
        camera: the left one.
        seen: (H, W) pixels of the left image with beams around them that the camera sees, too.
    """

    points: Float64
    triangles: Int64
    uv: Float64
    camera: Camera
    seen: Bool

    @classmethod
    def of(cls, frame: StereoFrame) -> ScanSurface:
        """Surfaces of the scan of a frame.

        Raises:
            ReferenceMissing: the frame has no scan.
            CalibrationField: the rig does not know where the LiDAR is.
        """
        if frame.scan is None:
            raise ReferenceMissing(f"frame {frame.id} has no LiDAR scan", want="a scan")
        points, uv, origin_m = _in_view(frame.scan, frame.rig)
        seen = seen_area(project_scan(frame.scan, frame.rig), frame.size_px)
        return cls(points, _triangles(points - origin_m), uv, frame.rig.left, seen)

    def along_ray_m(self, range_m: Float64) -> Float64:
        """How far each pixel's range is from the nearest one that the LiDAR has there.

        That of the surface at the pixel, or that of any beam nearby: at the edge of an object both
        what is before and what is behind it is right.

        Args:
            range_m: (H, W) from the left camera, NaN = none.

        Returns:
            (H, W) m, NaN where the pixel has no range; inf where there is no beam nearby.
        """
        height, width = range_m.shape
        off_m = np.abs(range_m - self.range_m())
        off_m = np.where(np.isfinite(off_m) | np.isnan(range_m), off_m, np.inf)
        column, row = np.rint(self.uv).astype(np.intp).T
        beam_m = np.linalg.norm(self.points, axis=1)
        reach = np.maximum(SEEN_COLUMNS_PX, self.camera.focal_px * EDGE_M / self.points[:, 2])
        for du in range(-int(reach.max()), int(reach.max()) + 1):
            u = column + du
            mine = np.flatnonzero((abs(du) <= reach) & (u >= 0) & (u < width))
            for dv in range(-SEEN_ROWS_PX, SEEN_ROWS_PX + 1):
                v = row[mine] + dv
                inside = (v >= 0) & (v < height)
                at = v[inside], u[mine][inside]
                np.fmin.at(off_m, at, np.abs(range_m[at] - beam_m[mine][inside]))
        return off_m

    def depth_m(self) -> Float64:
        """(H, W) depth Z at which the ray of each pixel meets a surface; inf where it meets none.

        Between beams this is what they say of the surface there, and beside its edges nothing.
        """
        longer = np.linalg.norm(pixel_rays(self.camera), axis=1)  # by as much as a ray is longer
        return np.asarray(self.range_m() / longer.reshape(self.seen.shape))

    def range_m(self) -> Float64:
        """(H, W) range at which the ray of each pixel meets a surface; inf where it meets none."""
        width, height = self.camera.size_px
        if not len(self.triangles):
            return np.full((height, width), np.inf)
        scene, tensor = _scene(self.points, self.triangles)
        directions = pixel_rays(self.camera)
        rays = np.zeros((len(directions), 6), np.float32)
        rays[:, 3:] = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        hit = scene.cast_rays(tensor(rays), nthreads=1)["t_hit"].numpy()
        return np.asarray(hit, np.float64).reshape(height, width)

    def distance_m(self, xyz: AnyArray) -> Float64:
        """(K,) distance of each point (K, 3) to the nearest surface or beam; inf without any."""
        from scipy.spatial import cKDTree

        if not len(self.points):
            return np.full(len(xyz), np.inf)
        distance: Float64 = np.asarray(cKDTree(self.points).query(xyz)[0], np.float64)
        if len(self.triangles):
            scene, tensor = _scene(self.points, self.triangles)
            to_surface = scene.compute_distance(tensor(xyz.astype(np.float32)), nthreads=1)
            distance = np.minimum(distance, to_surface.numpy())
        return distance


def pixel_rays(camera: Camera) -> Float64:
    """(H * W, 3) direction that each pixel looks in, with z 1, row by row."""
    width, height = camera.size_px
    v, u = np.indices((height, width)).reshape(2, -1)
    return np.asarray(np.stack([u, v, np.ones_like(u)], axis=1) @ np.linalg.inv(camera.K).T)


def _scene(points: Float64, triangles: Int64) -> tuple[Any, Any]:
    open3d = load_open3d()
    tensor = open3d.core.Tensor.from_numpy
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        tensor(points.astype(np.float32)), tensor(np.ascontiguousarray(triangles, np.uint32))
    )
    return scene, tensor


def seen_area(beams: ProjectedScan, size_px: tuple[int, int]) -> Bool:
    """(H, W) pixels that LiDAR and left camera both see: with beams around them that came back.

    Args:
        beams: those that the camera sees, too.
        size_px: (width, height) of the image.
    """
    width, height = size_px
    seen = np.zeros((height, width), np.bool_)
    column, row = np.rint(beams.uv).astype(np.intp).T
    seen[row, column] = True
    return _enclosed(seen)


def _enclosed(beams: Bool) -> Bool:
    """(H, W) pixels that have a beam within the window on the left, right, above and below."""
    from scipy.ndimage import maximum_filter

    sides = []
    for axis, reach in enumerate((SEEN_ROWS_PX, SEEN_COLUMNS_PX)):
        across = [2 * SEEN_ROWS_PX + 1, 2 * SEEN_COLUMNS_PX + 1]
        across[axis] = reach + 1
        for sign in (-1, 1):  # the half before the pixel, and the half behind it
            origin = [0, 0]
            origin[axis] = sign * (reach // 2)
            sides.append(maximum_filter(beams, size=across, origin=origin, mode="constant"))
    return np.asarray(np.all(sides, axis=0), np.bool_)


def _in_view(scan: LidarScan, rig: StereoRig) -> tuple[Float64, Float64, Float64]:
    """Points of the scan near the image, their pixels, and where the LiDAR stands."""
    xyz, origin_m = scan.xyz.astype(np.float64), np.zeros(3)
    if scan.frame != rig.left.frame:
        if rig.T_left_velodyne is None:
            raise CalibrationField(
                f"a scan in frame {scan.frame!r} without its place relative to the camera",
                want="T_left_velodyne in the calibration",
            )
        xyz, origin_m = rig.T_left_velodyne.apply(xyz), rig.T_left_velodyne.translation_m
    uv, _ = project(xyz, rig.P_left)
    size = np.array(rig.left.size_px)
    inside = ((uv >= -BORDER_PX) & (uv < size + BORDER_PX)).all(axis=1)  # False behind the camera
    return xyz[inside], uv[inside], origin_m


def _triangles(rays: Float64) -> Int64:
    """(M, 3) triangles between neighbouring beams that lie on one surface.

    Args:
        rays: (N, 3) m, points relative to the LiDAR, in axes x right, y down, z forward.
    """
    from scipy.spatial import Delaunay, QhullError

    ranges = np.linalg.norm(rays, axis=1)
    angles = np.stack(
        [np.arctan2(rays[:, 0], rays[:, 2]), np.arcsin(rays[:, 1] / np.maximum(ranges, 1e-9))],
        axis=1,
    )
    try:
        mesh = Delaunay(angles)
    except (QhullError, ValueError):  # all in one line, or fewer than four
        return np.empty((0, 3), np.int64)
    corners, beside = mesh.simplices.astype(np.int64), mesh.neighbors
    # Edge k is opposite corner k, as is neighbour k.
    first, second = corners[:, [1, 2, 0]], corners[:, [2, 0, 1]]
    width_rad = np.linalg.norm(angles[first] - angles[second], axis=2)
    step_m = np.abs(ranges[first] - ranges[second])
    spread_m = step_m.max(axis=1)
    across_m = width_rad.max(axis=1) * ranges[corners].min(axis=1)
    near = width_rad.max(axis=1) <= MAX_GAP_RAD
    smooth = spread_m <= np.maximum(SMOOTH_M, STEEPEST * across_m)
    goes_on = _goes_on(rays, corners, beside, step_m.argmin(axis=1))
    kept: Int64 = corners[near & (smooth | goes_on)]
    return kept


def _goes_on(rays: Float64, corners: Int64, beside: AnyArray, edge: Int64) -> Bool:
    """(M,) triangles in whose plane the triangle across their flattest edge lies, too."""
    rows = np.arange(len(corners))
    other = beside[rows, edge]
    opposite = corners[other].sum(axis=1) - (corners.sum(axis=1) - corners[rows, edge])
    exists = (other >= 0) & (opposite >= 0) & (opposite < len(rays))
    opposite = np.where(exists, opposite, 0)
    a, b, c = (rays[corners[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    middle = 0.5 * (rays[corners[rows, (edge + 1) % 3]] + rays[corners[rows, (edge + 2) % 3]])
    onward = rays[opposite] - middle
    sine = np.abs((normal * onward).sum(axis=1)) / np.maximum(np.linalg.norm(onward, axis=1), 1e-12)
    return np.asarray(exists & (sine <= IN_PLANE), np.bool_)
