"""The second pass: what the frames saw, put together where they were."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np

from pseudolidar.formats.atomic import output_error
from pseudolidar.geometry.frames import MAP, left_in_base_link
from pseudolidar.geometry.grey import rgb_of
from pseudolidar.mapping.free_space import FreeSpace
from pseudolidar.mapping.fusion import TemporalFusion
from pseudolidar.mapping.keyframe import movable_pixels
from pseudolidar.mapping.map_points import FramePoints, MapPoints
from pseudolidar.mapping.mesh import TsdfMesh
from pseudolidar.mapping.occupancy import Occupancy
from pseudolidar.mapping.tiles import MapTiles, TileStore
from pseudolidar.running.crew.attempt import Done
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.field_markers import AFTERWARDS
from pseudolidar.running.mapped.stored import WORK_FOLDER, read_stored
from pseudolidar.running.mapped.walked import Piece
from pseudolidar.running.one_cloud import write_cloud
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.reports.samples import photo_of
from pseudolidar.running.stream import stream
from pseudolidar.sources.source import FrameSource
from pseudolidar.structures.arrays import Float64, UInt8
from pseudolidar.structures.box import Detection
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose

FRAME_FOLDER = "frames"
SUMS_FOLDER, FREE_NAME = "sums", "free_space"


@dataclass(frozen=True)
class MapSettings:
    """How a map is made of frames.

    Args:
        fusion: how disparities of neighbouring frames become one.
        points: which pixels are sure enough.
        tiles: how points are averaged and kept.
        mesh: how a mesh is made.
        occupancy: how voxels and the flat map are made.
    """

    fusion: TemporalFusion = field(default_factory=TemporalFusion)
    points: MapPoints = field(default_factory=MapPoints)
    tiles: MapTiles = field(default_factory=MapTiles)
    mesh: Annotated[TsdfMesh, AFTERWARDS] = field(default_factory=TsdfMesh)
    occupancy: Annotated[Occupancy, AFTERWARDS] = field(default_factory=Occupancy)


@dataclass(frozen=True)
class Restored:
    """A frame with the disparities that the first pass has stored: picklable.

    Args:
        folder: output folder.
    """

    folder: Path

    def __call__(self, frame: StereoFrame) -> tuple[StereoFrame, DisparityMap]:
        """Read them.

        Raises:
            ImageUnreadable: somebody changed the file.
        """
        return frame, read_stored(self.folder, frame.id)


class MapBuilder:
    """Puts frames together, one after the other.

    Args:
        folder: output folder.
        rig: with the correction that motion told.
        settings: how.
        meshed: make a mesh, too.
        occupied: make voxels and a flat map, too.
    """

    def __init__(
        self,
        folder: Path,
        rig: StereoRig,
        settings: MapSettings,
        *,
        meshed: bool = False,
        occupied: bool = False,
    ) -> None:
        self._rig, self._settings = rig, settings
        self._T_base_left = left_in_base_link(rig).matrix
        self._work = work = folder / WORK_FOLDER
        sums = work / SUMS_FOLDER
        shutil.rmtree(sums, ignore_errors=True)
        sums.mkdir(parents=True)
        self._fusion = settings.fusion.start()
        self._tiles: TileStore = settings.tiles.start(sums, MAP)
        self._free = FreeSpace(work / FREE_NAME, rig)
        self.mesh = settings.mesh.start(rig) if meshed else None
        self.occupancy = settings.occupancy.start() if occupied else None

    def add(
        self,
        frame: StereoFrame,
        disparity: DisparityMap,
        T_odom_camera: Float64,
        movable: Sequence[Detection] = (),
    ) -> PointCloud:
        """A frame, where it was taken, without things that may move; its points in the map."""
        T_map_camera = self._T_base_left @ T_odom_camera
        masked = movable_pixels(movable, disparity.values.shape)
        fused = self._fusion.add(disparity, self._rig, T_map_camera, movable=masked)
        rgb = colours_of(frame)
        points = self._settings.points.of(fused, rgb)
        with self._disk_named():
            self._tiles.add(points, T_map_camera)
            self._free.add(fused.depth_m, T_map_camera)
        if self.mesh is not None:
            agreed = np.where(fused.counts >= self._settings.points.frames, fused.depth_m, np.nan)
            pose = Pose(MAP, self._rig.left.frame, T_map_camera)
            self.mesh.integrate(agreed.astype(np.float32), fused.sigma_m, rgb, pose)
        cloud = cloud_of(points, T_map_camera, frame.timestamp_ns)
        if self.occupancy is not None:
            self.occupancy.integrate(cloud, T_map_camera[:3, 3].copy())
        return cloud

    def clouds(self) -> Iterator[tuple[tuple[int, int], PointCloud]]:
        """The tiles of the map."""
        with self._disk_named():
            yield from self._tiles.merged(self._free)
            self._free.close()

    @contextlib.contextmanager
    def _disk_named(self) -> Iterator[None]:
        """A disk that is full or gone is told as everywhere, with the folder."""
        try:
            yield
        except OSError as error:
            raise output_error(self._work, error) from error


def built(
    folder: Path,
    source: FrameSource,
    piece: Piece,
    rig: StereoRig,
    settings: MapSettings,
    *,
    frame_kinds: Sequence[str] = (),
    meshed: bool = False,
    occupied: bool = False,
) -> MapBuilder:
    """All frames of a piece of path, put together.

    Args:
        folder: output folder, with the disparities of the first pass.
        source: the frames.
        piece: where they were taken; those of its frames that are extrapolated are left out.
        rig: with the correction that motion told.
        settings: how.
        frame_kinds: formats in which the points of each frame are written too, in the map.
        meshed: make a mesh, too.
        occupied: make voxels and a flat map, too.

    Raises:
        OutputError: the disk is full or gone.
        MemoryLimit: mesh or voxels do not fit.
    """
    builder = MapBuilder(folder, rig, settings, meshed=meshed, occupied=occupied)
    clouds_folder = folder / FRAME_FOLDER
    if frame_kinds:
        clouds_folder.mkdir(exist_ok=True)
    placed = zip(piece.frames, piece.T_odom_camera, strict=True)
    poses = {one.id: T for one, T in placed if one.measured}
    movable = {one.id: one.movable for one in piece.frames}
    others = frozenset(source.ids) - poses.keys()
    outcomes = stream(source, Restored(folder), crew=CrewPlan(1), skip=others)
    with FrameProgress(len(poses)) as progress:
        for outcome in outcomes:
            if isinstance(outcome, Done):
                cloud = builder.add(*outcome.value, poses[outcome.id], movable[outcome.id])
                for kind in frame_kinds if len(cloud) else ():
                    write_cloud(clouds_folder / f"{outcome.id}.{kind}", cloud)
            progress.advance()
    return builder


def cloud_of(points: FramePoints, T_map_camera: Float64, timestamp_ns: int) -> PointCloud:
    """A frame's points in the map."""
    places, normals = points.in_map(T_map_camera)
    nx, ny, nz = np.ascontiguousarray(normals.T)
    return PointCloud(
        places.astype(np.float32),
        MAP,
        timestamp_ns,
        rgb=points.rgb,
        sigma_m=points.sigma_m,
        extra={"nx": nx, "ny": ny, "nz": nz},
    )


def colours_of(frame: StereoFrame) -> UInt8:
    """(H, W, 3) RGB of the left picture."""
    return rgb_of(photo_of(frame))
