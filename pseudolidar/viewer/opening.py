"""What the paths are that somebody wants to look at."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.errors import PseudolidarError, SourceEmpty, SourceUnknown, printable
from pseudolidar.formats.obstacle_json import read_obstacles
from pseudolidar.formats.points.cloud_file import is_cloud_file
from pseudolidar.formats.trajectory_file import (
    KITTI_VERTICAL,
    POSE_SUFFIXES,
    PoseRecord,
    read_trajectory,
    trajectory_form,
)
from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.running.mapped.mesh_outputs import MESH_NAME
from pseudolidar.sources.cloud_files import CloudFiles
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.viewer.large import MOST_WHOLE, StillClouds
from pseudolidar.viewer.meshes import is_mesh_file, read_still_mesh
from pseudolidar.viewer.reel import Reel, SourceReel
from pseudolidar.viewer.stills import TRUTH_COLOUR, Still, StillOctree, StillPath

if TYPE_CHECKING:
    from pseudolidar.sources.recording.paths import RecordedPath

_log = logging.getLogger(__name__)

RUN_FILE = "run.json"
# What `map` leaves, and the path in it: the map's own form of it, not the camera's.
MAP_STEM, PATH_NAME = "map", "trajectory.tum"
# What the path is called that the rig really took.
TRUTH_NAME = "ground truth"
# What `obstacles` leaves.
OBJECTS_NAME = "obstacles.jsonl"
# Folders of clouds that `convert` writes, the one that keeps most first.
CLOUD_FOLDERS = ("npz", "pcd", "ply", "bin")
# The squares of a map, as `map` names them.
TILE_FOLDER, TILE_STEM = "tiles", re.compile(r"-?[0-9]+_-?[0-9]+")


@dataclass(frozen=True)
class Opened:
    """What there is to look at.

    Args:
        reels: sequences.
        stills: what does not change.
        objects: what a run found, by frame.
    """

    reels: tuple[Reel, ...] = ()
    stills: tuple[Still, ...] = ()
    objects: Mapping[str, tuple[Obstacle, ...]] = field(default_factory=dict)

    @property
    def is_empty(self) -> bool:
        """Nothing at all."""
        return not self.reels and not self.stills

    @property
    def first_source(self) -> SourceReel | None:
        """The first sequence, which objects are looked for in; None unless it is of a source."""
        first = self.reels[0] if self.reels else None
        return first if isinstance(first, SourceReel) else None

    def in_one_file(self) -> Opened:
        """What goes into a file that cannot ask for more: of large clouds the coarsest points."""
        octrees = (s.coarse(MOST_WHOLE) if isinstance(s, StillOctree) else s for s in self.stills)
        return replace(self, stills=tuple(octrees))


@dataclass
class Opening:
    """Opens path by path.

    Args:
        reel_of: a source to its sequence.
        reel_of_run: folder of a run to the sequence that it looked at; None where that is gone.
        truth_of_run: folder of a run and the path that it found to where the rig really was, (N, 3)
            as that path is; None where nobody knows.
        clouds: reads clouds.
    """

    reel_of: Callable[[Source], Reel]
    reel_of_run: Callable[[Path], Reel | None] = lambda _folder: None
    truth_of_run: Callable[[Path, PoseRecord], Float64 | None] = lambda _folder, _found: None
    clouds: StillClouds = field(default_factory=StillClouds)
    _reels: list[Reel] = field(default_factory=list)
    _stills: list[Still] = field(default_factory=list)
    _objects: dict[str, tuple[Obstacle, ...]] = field(default_factory=dict)

    def all_of(self, paths: Sequence[str]) -> Opened:
        """Everything that the paths hold.

        Raises:
            SourceUnknown: one of them is nothing that can be looked at.
            PseudolidarError: a file that cannot be read.
        """
        for path in paths:
            self._open(path)
        return Opened(tuple(self._reels), tuple(self._stills), self._objects)

    def _open(self, path: str) -> None:
        place = Path(path)
        if place.is_dir() and (place / RUN_FILE).is_file():
            self._open_run(place)
        elif place.is_dir() and (tiles := _tiles(place)):
            self._stills.append(self.clouds.read(self._name(place), tiles))
        elif place.is_file() and is_mesh_file(place):
            self._stills.append(read_still_mesh(self._name(place), place))
        elif place.is_file() and is_cloud_file(place):
            self._stills.append(self.clouds.read(self._name(place), [place]))
        elif place.is_file() and _is_path(place):
            self._stills.append(_path_of(place, self._name(place)))
        else:
            self._open_source(recognise(path))

    def _open_source(self, source: Source) -> None:
        """Lay down its frames; of a recording of poses alone, the paths that these make."""
        try:
            self._reels.append(self.reel_of(source))
        except SourceEmpty:
            from pseudolidar.sources.recording.paths import paths_alone

            paths = paths_alone(source) if isinstance(source, Recording) else ()
            if not paths:
                raise
            self._lay_paths(Path(source.path), paths)

    def _lay_paths(self, recording: Path, paths: Sequence[RecordedPath]) -> None:
        """Lay down the longest path, and others of its frame; nobody knows where the rest lies."""
        frame = paths[0].frame
        for one in paths:
            if one.frame == frame:
                name = f"{recording.name} {one.topic.strip('/').replace('/', '.')}"
                self._stills.append(StillPath(self._name(Path(name)), one.places_m))
            else:
                _log.warning(
                    "%s is not shown: it is in %s, and not in %s", one.topic, one.frame, frame
                )

    def _open_run(self, folder: Path) -> None:
        found_objects = (folder / OBJECTS_NAME).is_file()
        if found_objects:
            self._objects |= read_obstacles(folder / OBJECTS_NAME)
        found = list(_of_run(folder))
        # Objects are better seen in frames with their pictures than in clouds alone; of runs that
        # left maps of disparity or depth alone there is nothing but the frames.
        if found_objects or not found:
            reel = self.reel_of_run(folder)
            if reel is not None:
                self._reels.append(reel)
                return
        if not found:
            raise SourceUnknown(
                "the folder of a run that left nothing to look at",
                want="clouds, a recording, or a map in it, or the source of the run where it was",
                path=folder,
            )
        for part in found:
            self._open(str(part))
        if (folder / PATH_NAME) in found:
            self._add_truth(folder)

    def _add_truth(self, folder: Path) -> None:
        """Lay the true path beside the one that a run found."""
        places = self.truth_of_run(folder, read_trajectory(folder / PATH_NAME))
        if places is not None:
            name = self._name(Path(TRUTH_NAME))
            self._stills.append(StillPath(name, places, TRUTH_COLOUR))

    def _name(self, place: Path) -> str:
        """What a file is called here: no two alike."""
        taken = {still.name for still in self._stills}
        name = printable(place.name)
        names = (name if n == 1 else f"{name} ({n})" for n in count(1))
        return next(each for each in names if each not in taken)


def _of_run(folder: Path) -> Iterator[Path]:
    """What is to be looked at of a run's folder: map, mesh, path; or its clouds or recording."""
    maps = [file for file in sorted(folder.glob(f"{MAP_STEM}.*")) if is_cloud_file(file)]
    yield from maps[:1] or ([folder / TILE_FOLDER] if _tiles(folder / TILE_FOLDER) else [])
    yield from [file for file in sorted(folder.glob(f"{MESH_NAME}.*")) if is_mesh_file(file)][-1:]
    if (folder / PATH_NAME).is_file():
        yield folder / PATH_NAME
    clouds = [folder / name for name in CLOUD_FOLDERS if CloudFiles.looks_like(folder / name)]
    recordings = [file for file in sorted(folder.iterdir()) if Recording.looks_like(file)]
    yield from (clouds or recordings)[:1]


def _tiles(folder: Path) -> list[Path]:
    """The squares of a map in one format, if a folder holds nothing else."""
    files = sorted(folder.iterdir()) if folder.is_dir() else []
    if not files or not all(TILE_STEM.fullmatch(file.stem) for file in files):
        return []
    kinds = [[f for f in files if f.suffix.lower() == f".{kind}"] for kind in CLOUD_FOLDERS]
    return next((kind for kind in kinds if kind), [])


def _is_path(place: Path) -> bool:
    if place.suffix.lower() not in POSE_SUFFIXES:
        return False
    try:
        return trajectory_form(place) is not None
    except PseudolidarError:
        return False


def _path_of(place: Path, name: str) -> StillPath:
    """Places of a file of poses; KITTI's are turned from a camera's axes to x forward, z up."""
    record = read_trajectory(place)
    places = record.T_world_body[:, :3, 3]
    if record.vertical == KITTI_VERTICAL:
        places = places @ R_BODY_OPTICAL.T
    return StillPath(name, np.ascontiguousarray(places))
