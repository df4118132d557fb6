"""Several clouds as one, in one frame: at once, or one after the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import AnyArray
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

# So many points wait at least before cubes are thinned anew.
LEAST_WAITING = 1_000_000


def merged(clouds: Sequence[PointCloud], poses: Sequence[Pose] | None = None) -> PointCloud:
    """All points of `clouds`, in order, with the union of their columns.

    A column that some clouds lack is NaN there; one of whole numbers becomes float64 then (exact
    to 2^53), as there is no number that means "unknown". Colour and pixels have no NaN that all
    readers know: they stay only where all clouds have them. Points without coordinates are left
    out.

    Args:
        clouds: at least one.
        poses: `T_common_frame` of each cloud, all to one frame; without them the clouds must be in
            one frame already.

    Returns:
        A cloud in the common frame, with the time of the first; not organised.

    Raises:
        StructureError: no cloud, other frames, or a column that is a number in one cloud and
            something else in another.
    """
    if not clouds:
        raise StructureError("no cloud", want="one or more", where="merged")
    if poses is not None:
        clouds = [cloud.transformed(pose) for cloud, pose in zip(clouds, poses, strict=True)]
    frames = sorted({cloud.frame for cloud in clouds})
    if len(frames) > 1:
        raise StructureError(
            f"clouds in {', '.join(frames)}", want="one frame, or poses to one", where="merged"
        )
    parts = [cloud if cloud.shape is None else cloud[cloud.valid] for cloud in clouds]
    names = dict.fromkeys(name for part in parts for name in part.extra)

    def joined(columns: list[AnyArray | None]) -> AnyArray | None:
        """All of them one after the other, NaN where one is not there; None if none is."""
        known = [column for column in columns if column is not None]
        if not known:
            return None
        if len(known) == len(columns):
            return np.concatenate(known)
        floats = [c if c.dtype.kind == "f" else c.astype(np.float64) for c in known]
        dtype = np.result_type(*floats)
        return np.concatenate(
            [
                np.full(len(part), np.nan, dtype) if column is None else column.astype(dtype)
                for part, column in zip(parts, columns, strict=True)
            ]
        )

    def shared(columns: list[AnyArray | None]) -> AnyArray | None:
        known = [column for column in columns if column is not None]
        return np.concatenate(known) if len(known) == len(parts) else None

    return PointCloud(
        xyz=np.concatenate([part.xyz for part in parts]),
        frame=frames[0],
        timestamp_ns=parts[0].timestamp_ns,
        rgb=shared([part.rgb for part in parts]),
        intensity=joined([part.intensity for part in parts]),
        sigma_m=joined([part.sigma_m for part in parts]),
        uv=shared([part.uv for part in parts]),
        extra={
            name: column
            for name in names
            if (column := joined([part.extra.get(name) for part in parts])) is not None
        },
    )


class Joined:
    """A cloud that grows frame by frame; with cubes it holds one point of each, the surest.

    Cubes are thinned each time that as many points wait as are kept: memory is twice what is kept,
    and the time for a point does not grow with the cloud. The points are those that thinning once
    at the end would leave.

    Args:
        voxel_m: edge of the cubes, None to keep every point.
    """

    def __init__(self, voxel_m: float | None = None) -> None:
        self._voxel_m = voxel_m
        self._parts: list[PointCloud] = []
        self._kept = 0
        self._seen: dict[str, None] = {}

    def __len__(self) -> int:
        """Points held; with cubes some of them may still go."""
        return sum(map(len, self._parts))

    @property
    def nbytes(self) -> int:
        """Memory of all columns held."""
        return sum(_nbytes(part) for part in self._parts)

    def add(self, cloud: PointCloud) -> None:
        """Take the points of a cloud, which must be in the frame of the first.

        Raises:
            StructureError: it is in another frame.
        """
        self._parts.append(cloud)
        self._seen |= dict.fromkeys(column_names(cloud))
        waiting = len(self) - self._kept
        if self._voxel_m is not None and waiting > max(self._kept, LEAST_WAITING):
            self._thin(self._voxel_m)

    def taken(self) -> tuple[PointCloud, tuple[str, ...]]:
        """The cloud, which this object then no longer holds, and columns that it had to leave out.

        Raises:
            StructureError: nothing was added, or clouds that do not go together.
        """
        if self._voxel_m is not None:
            self._thin(self._voxel_m)
        cloud = merged(self._parts)
        self._parts, self._kept = [], 0
        kept = column_names(cloud)
        return cloud, tuple(name for name in self._seen if name not in kept)

    def _thin(self, voxel_m: float) -> None:
        from pseudolidar.geometry.voxels import best_of_voxel

        cloud = merged(self._parts)
        cloud = cloud[best_of_voxel(cloud.xyz, cloud.sigma_m, voxel_m=voxel_m)]
        self._parts, self._kept = [cloud], len(cloud)


def column_names(cloud: PointCloud) -> tuple[str, ...]:
    """Names of all columns that a cloud has."""
    return tuple(_columns(cloud))


def _columns(cloud: PointCloud) -> dict[str, AnyArray]:
    own = ("xyz", "rgb", "intensity", "sigma_m", "uv")
    known = {name: column for name in own if (column := getattr(cloud, name)) is not None}
    return {**known, **cloud.extra}


def _nbytes(cloud: PointCloud) -> int:
    return sum(column.nbytes for column in _columns(cloud).values())
