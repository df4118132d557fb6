"""What the points of a box tell: how many, how large, how flat."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.geometry.plane_fit import FittedPlane, fit_plane, principal
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.boxes.region import Region
from pseudolidar.viewer.placement import moved

UP = np.array([0.0, 0.0, 1.0])
# Fewer points tell nothing of what they lie on: three are always flat.
LEAST_POINTS = 10
# Of the points of a plane, the share that lies within the distance which is told.
MOST_SHARE = 0.95


@dataclass(frozen=True, eq=False)
class Found:
    """A cloud that may have points in a box.

    Args:
        cloud: in its own frame.
        T_local_cloud: (4, 4) where that is in the map relative to the origin of the scene.
        eye_m: (3,) in its own frame, from where it was taken; None where nobody knows.
        whole: points that it stands for, of which it has some; None where it has all.
    """

    cloud: PointCloud
    T_local_cloud: Float64
    eye_m: Float64 | None = None
    whole: int | None = None


@dataclass(frozen=True, eq=False)
class Flatness:
    """The plane that most points of a box lie on.

    Args:
        normal: (3,) of length 1 in the map, up, or towards where the points were seen from.
        middle_m: (3,) of the points on it, in the map relative to the origin of the scene.
        own_middle_m: (3,) the same in the frame of the cloud.
        share: of the points, that lie on it.
        rms_m: of their distances to it.
        most_m: that 95 % of them are nearer than.
        expected_m: RMS of these distances as the sigmas of the points have it; where nobody knows
            from where they were seen, of the sigmas themselves. None without sigmas.
        seen: whether that is known.
        per_m2: points on it on a square metre; None where they cover none.
    """

    normal: Float64
    middle_m: Float64
    own_middle_m: Float64
    share: float
    rms_m: float
    most_m: float
    expected_m: float | None
    seen: bool
    per_m2: float | None

    @property
    def tilt_deg(self) -> float:
        """Of the plane: 0 is level, 90 upright."""
        return float(np.degrees(np.arccos(min(abs(float(self.normal @ UP)), 1.0))))


@dataclass(frozen=True, eq=False)
class BoxFigures:
    """What one cloud has in a box.

    Args:
        points: those of the box, in the frame of the cloud with all their columns.
        middle_m: (3,) their mean there.
        along_m: (3,) how far they reach along the axes of the box.
        own_m: (3,) and along their own: the longest, the next, the shortest.
        flatness: None where they tell no plane.
        whole: points of the clouds in nodes about the box, of which `points` are some; None where
            they are all.
    """

    points: PointCloud
    middle_m: Float64
    along_m: Float64
    own_m: Float64
    flatness: Flatness | None
    whole: int | None = None

    @classmethod
    def of(cls, region: Region, found: Found) -> Self | None:
        """Figures of the points of a cloud in a box; None where it has none there."""
        places = region.places(found.cloud.xyz, found.T_local_cloud)
        inside = region.holds(places)
        if not inside.any():
            return None
        places, points = places[inside], found.cloud[inside]
        _, axes, _ = principal(places)
        return cls(
            points,
            points.xyz.mean(axis=0, dtype=np.float64),
            np.ptp(places, axis=0),
            np.ptp(places @ axes, axis=0),
            _flatness(region, places, points, found),
            found.whole,
        )


def _flatness(region: Region, places: Float64, points: PointCloud, found: Found) -> Flatness | None:
    plane = fit_plane(places) if len(places) >= LEAST_POINTS else None
    if plane is None:
        return None
    T = region.T_local_box
    eye = None
    if found.eye_m is not None:
        eye = region.places(found.eye_m[None], found.T_local_cloud)[0]
    away = np.abs(plane.distances[plane.on])
    normal = plane.normal * (1.0 if _faces(plane, T, eye) else -1.0)
    return Flatness(
        T[:3, :3] @ normal,
        moved(T, plane.middle),
        points.xyz[plane.on].mean(axis=0, dtype=np.float64),
        float(plane.on.mean()),
        float(np.sqrt(np.mean(away**2))),
        float(np.quantile(away, MOST_SHARE)),
        _expected_m(points, places, plane, eye),
        eye is not None,
        _per_m2(places, plane),
    )


def _faces(plane: FittedPlane, T_local_box: Float64, eye: Float64 | None) -> bool:
    """Whether the normal of a plane looks the way that is told."""
    if eye is not None:
        return bool(plane.normal @ (eye - plane.middle) >= 0)
    return bool(T_local_box[2, :3] @ plane.normal >= 0)


def _expected_m(
    points: PointCloud, places: Float64, plane: FittedPlane, eye: Float64 | None
) -> float | None:
    """Sigma of a point is along its ray: across the plane it is as much less as the ray slants."""
    on: Bool = plane.on
    if points.sigma_m is None or not (known := np.isfinite(points.sigma_m[on])).any():
        return None
    across = points.sigma_m[on].astype(np.float64)
    if eye is not None:
        rays = places[on] - eye
        lengths = np.linalg.norm(rays, axis=1)
        across = across * np.abs(rays @ plane.normal) / np.where(lengths > 0, lengths, 1)
    return float(np.sqrt(np.mean(across[known] ** 2)))


def _per_m2(places: Float64, plane: FittedPlane) -> float | None:
    """Points on a plane over the area of the smallest outline about them."""
    from scipy.spatial import ConvexHull, QhullError

    on = places[plane.on]
    try:
        flat = ConvexHull((on - plane.middle) @ plane.axes[:, :2])
        area_m2 = float(flat.volume)  # of a flat hull its area
    except QhullError:
        return None
    return len(on) / area_m2 if area_m2 > 0 else None
