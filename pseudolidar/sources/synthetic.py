"""Rendered worlds as a source: pictures with exact truth, of any length."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np

from pseudolidar.errors import PseudolidarError, SourceUnknown, UsageError
from pseudolidar.geometry.beams import HDL64_AZIMUTH_STEP_DEG, hdl64
from pseudolidar.geometry.frames import BASE_LINK, MAP
from pseudolidar.sources.source import SourceSummary
from pseudolidar.sources.stamps import FrameTimes, synthetic_times
from pseudolidar.sources.worlds.block import Block
from pseudolidar.sources.worlds.flight import Flight
from pseudolidar.sources.worlds.labelling import labels_of
from pseudolidar.sources.worlds.photometry import Photometry
from pseudolidar.sources.worlds.render import View, render
from pseudolidar.sources.worlds.room import Room
from pseudolidar.sources.worlds.scan import ScanNoise, scan
from pseudolidar.sources.worlds.scene import Scene, scene_at
from pseudolidar.sources.worlds.street import Street
from pseudolidar.sources.worlds.world import World
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DepthMap, DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose, Trajectory

WorldName = Literal["street", "block", "room", "flight"]
WORLDS: dict[str, type[Street] | type[Block] | type[Room] | type[Flight]] = {
    "street": Street,
    "block": Block,
    "room": Room,
    "flight": Flight,
}
SYNTHETIC = "synthetic:"
# Smaller images hold nothing that a matcher could work on.
SMALLEST_PX = (64, 32)
# Random numbers of a frame: one stream each.
LEFT_EYE, RIGHT_EYE, LIDAR = 0, 1, 2


@dataclass(frozen=True)
class Synthetic:
    """A rendered world: `street`, `block` (driven round and round), `room` or `flight`.

    Args:
        path: which world: `street`, `synthetic:street`, or with a number of frames `street:40`.
        frames: how many frames; the world has no end.
        seed: which street, which noise: other seeds are other worlds.
        width_px: image width; the world's own by default (street: 1242).
        height_px: image height; by default in proportion to the width.
        rate_hz: frames per second.
        photometry: the sensors and how they differ.
        scan: errors of the LiDAR.
    """

    path: str = "street"
    frames: int = 20
    seed: int = 0
    width_px: int | None = None
    height_px: int | None = None
    rate_hz: float = 10.0
    photometry: Photometry = field(default_factory=Photometry)
    scan: ScanNoise = field(default_factory=ScanNoise)

    def open(self) -> SyntheticSource:
        """Check the settings; nothing is rendered yet.

        Raises:
            SourceUnknown: no world of that name.
            UsageError: no frame, an impossible rate, or images too small.
        """
        name, frames = world_and_frames(self.path)
        if frames is not None:
            return replace(self, path=name, frames=frames).open()
        if name not in WORLDS:
            raise SourceUnknown(
                f"a synthetic world called {name!r}",
                want=", ".join(WORLDS),
                fix="Write for example `synthetic:street`.",
                path=self.path,
            )
        width, height = self._size_px(name)
        if self.frames < 1 or not self.rate_hz > 0:
            raise UsageError(
                f"{self.frames} frames at {self.rate_hz:g} Hz", want="at least 1, at a rate over 0"
            )
        if width < SMALLEST_PX[0] or height < SMALLEST_PX[1]:
            raise UsageError(
                f"images of {width}x{height} px", want=f"at least {SMALLEST_PX[0]}x{SMALLEST_PX[1]}"
            )
        return SyntheticSource(self, name, width, height)

    def _size_px(self, name: str) -> tuple[int, int]:
        design = WORLDS[name]().design
        width = self.width_px or design.width_px
        return width, self.height_px or round(design.height_px * width / design.width_px)


def world_and_frames(path: str) -> tuple[str, int | None]:
    """Name of a world, and how many frames `synthetic:street:40` or `street:40` asks for.

    Raises:
        UsageError: a number of frames that is none.
    """
    name, colon, frames = path.removeprefix(SYNTHETIC).partition(":")
    if not colon:
        return name or "street", None
    if not (frames.isascii() and frames.isdecimal() and int(frames) > 0):
        raise UsageError(f"{frames!r} frames in {path!r}", want="such as synthetic:street:40")
    return name or "street", int(frames)


@dataclass(frozen=True)
class Truth:
    """What is exactly known of a frame, in both eyes.

    Args:
        left: disparity of the left image (x_left - x_right, px); NaN for the sky.
        right: disparity of the right image's pixels, positive as well.
        depth_left: Z in the left camera, metres.
        depth_right: Z in the right camera, metres.
        occluded: (H, W) pixels of the left image that the right eye does not see: hidden, or
            outside its image. The sky counts as seen.
    """

    left: DisparityMap
    right: DisparityMap
    depth_left: DepthMap
    depth_right: DepthMap
    occluded: Bool


@dataclass(frozen=True)
class SyntheticSource:
    """An opened world; cheap to pickle, every frame a pure function of settings and index.

    Args:
        settings: what was asked for.
        name: which world.
        width_px: image width.
        height_px: image height.
    """

    settings: Synthetic
    name: str
    width_px: int
    height_px: int
    yields: ClassVar = StereoFrame

    @functools.cached_property
    def world(self) -> World:
        """The world itself."""
        return WORLDS[self.name](seed=self.settings.seed)

    @functools.cached_property
    def rig(self) -> StereoRig:
        """The same rig for all frames."""
        origin = f"synthetic:{self.name}"
        return self.world.design.rig(self.width_px, self.height_px, origin=origin)

    @property
    def summary(self) -> SourceSummary:
        """What it is."""
        line = (
            f"synthetic {self.name}, seed {self.settings.seed}: {self.settings.frames} rendered "
            f"frames of {self.width_px}x{self.height_px} with exact truth"
        )
        return SourceSummary("synthetic", f"synthetic:{self.name}", line, notes=self._times.notes)

    @property
    def ids(self) -> tuple[str, ...]:
        """000000, 000001, ..."""
        return tuple(f"{i:06d}" for i in range(self.settings.frames))

    @property
    def timestamps_ns(self) -> tuple[int, ...]:
        """One second, then by the rate."""
        return self._times.timestamps_ns

    @property
    def refused(self) -> tuple[tuple[str, PseudolidarError], ...]:
        """Nothing ever is."""
        return ()

    @property
    def trajectory(self) -> Trajectory:
        """Exact poses `T_map_base_link` of all frames."""
        poses = [self.pose(i).matrix for i in range(self.settings.frames)]
        return Trajectory(np.array(self.timestamps_ns, dtype=np.int64), np.stack(poses))

    def pose(self, index: int) -> Pose:
        """`T_map_base_link`; `map` is `base_link` (the Velodyne) of frame 0."""
        T_world_map = self.world.T_world_base(0.0)
        matrix = np.linalg.inv(T_world_map) @ self.world.T_world_base(self._time_s(index))
        return Pose(MAP, BASE_LINK, matrix) if index else Pose.identity(MAP, BASE_LINK)

    def load(self, index: int) -> StereoFrame:
        """Render frame `index`: pictures, scan, labels, pose and exact disparity."""
        scene = scene_at(self.world, self._time_s(index))
        left, right = self._views(scene, index)
        picture = self.settings.photometry
        return StereoFrame(
            left=picture.expose(left.light, right=False, rng=self._rng(index, LEFT_EYE)),
            right=picture.expose(right.light, right=True, rng=self._rng(index, RIGHT_EYE)),
            rig=self.rig,
            id=self.ids[index],
            index=index,
            timestamp_ns=self.timestamps_ns[index],
            scan=scan(
                scene,
                self.world.T_world_base(self._time_s(index)),
                hdl64(self._azimuth_step_deg),
                self.settings.scan,
                timestamp_ns=self.timestamps_ns[index],
                rng=self._rng(index, LIDAR),
            ),
            labels=labels_of(scene, left, self.rig.left, self._T_world_eye(index, right=False)),
            pose=self.pose(index),
            truth=self._disparity(left),
        )

    def truth_pair(self, index: int) -> Truth:
        """Exact disparity and depth of both eyes, and what the right eye cannot see."""
        scene = scene_at(self.world, self._time_s(index))
        left, right = self._views(scene, index)
        return Truth(
            left=self._disparity(left),
            right=self._disparity(right),
            depth_left=DepthMap(left.depth.astype(np.float32)),
            depth_right=DepthMap(right.depth.astype(np.float32)),
            occluded=self._hidden(scene, index, left),
        )

    def _views(self, scene: Scene, index: int) -> tuple[View, View]:
        left = render(scene, self.rig.left, self._T_world_eye(index, right=False))
        right = render(scene, self.rig.right, self._T_world_eye(index, right=True))
        return left, right

    def _disparity(self, view: View) -> DisparityMap:
        disparity = self.rig.fB_px_m / view.depth - self.rig.doffs_px
        return DisparityMap(disparity.astype(np.float32))

    def _hidden(self, scene: Scene, index: int, left: View) -> Bool:
        T_world_left = self._T_world_eye(index, right=False)
        v, u = np.nonzero(np.isfinite(left.depth))
        z = left.depth[v, u][:, None]
        pixels = np.stack([u, v, np.ones(len(u))], axis=1).astype(np.float64)
        rays = pixels @ (T_world_left[:3, :3] @ np.linalg.inv(self.rig.left.K)).T
        points = rays * z + (T_world_left[:3, 3] - scene.origin_m)
        eye = self._T_world_eye(index, right=True)[:3, 3] - scene.origin_m
        x_right = u - (self.rig.fB_px_m / z[:, 0] - self.rig.doffs_px)
        hidden = np.zeros(left.depth.shape, dtype=np.bool_)
        hidden[v, u] = scene.between(points, eye) | (x_right < -0.5)
        return hidden

    def _T_world_eye(self, index: int, *, right: bool) -> Float64:
        """(4, 4) pose of an eye in the world."""
        T_left_velodyne = self.world.design.T_left_velodyne.matrix
        T = self.world.T_world_base(self._time_s(index)) @ np.linalg.inv(T_left_velodyne)
        return T @ self.rig.T_right_left.inverse().matrix if right else T

    @property
    def _azimuth_step_deg(self) -> float:
        """The HDL-64's, coarser in proportion where images are smaller than the world's own."""
        return HDL64_AZIMUTH_STEP_DEG * max(1.0, self.world.design.width_px / self.width_px)

    def _time_s(self, index: int) -> float:
        return index / self.settings.rate_hz

    @functools.cached_property
    def _times(self) -> FrameTimes:
        return synthetic_times(range(self.settings.frames), self.settings.rate_hz)

    def _rng(self, index: int, stream: int) -> np.random.Generator:
        return np.random.default_rng([self.settings.seed, index, stream])
