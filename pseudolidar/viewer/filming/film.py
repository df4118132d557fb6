"""A film of what is looked at: round clouds that lie still, along a path, behind a rig."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pseudolidar.evaluation.cloud_views import Eye
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.video.mp4 import TICKS_PER_S, write_mp4
from pseudolidar.structures.arrays import Float64, UInt8
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.filming.flights import RATE_HZ, along, sized, turntable
from pseudolidar.viewer.filming.moving import moving_shots, pictures_of
from pseudolidar.viewer.filming.outlined import FilmedObjects
from pseudolidar.viewer.filming.painted import Painter, joined, nothing_seen
from pseudolidar.viewer.filming.shot import Shot
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.stage import Look
from pseudolidar.viewer.stills import Still, StillCloud, StillMesh, StillOctree, StillPath, middle_m

FILM_PX, PICTURE_PX = (1280, 720), (1920, 1080)
# Side of a point, as a share of the distance to its neighbours.
SPACING_SHARE = 0.9


@dataclass(frozen=True, eq=False)
class Film:
    """A film that is not drawn yet.

    Args:
        count: how many pictures it has.
        shots: its pictures in order, each made when it is asked for.
    """

    count: int
    shots: Iterator[Shot]

    @classmethod
    def of(
        cls,
        opened: Opened,
        looks: Mapping[str, Look] | None = None,
        size_px: tuple[int, int] = FILM_PX,
        load: Callable[[int], Moment] | None = None,
        objects: FilmedObjects | None = None,
    ) -> Film:
        """A film of what was opened: through its first sequence, along its path, or round it.

        Args:
            opened: what is looked at.
            looks: how clouds look, by name; of others what suits them.
            size_px: of its pictures.
            load: makes the frames of that sequence; None to make them as the sequence does.
            objects: of its frames; None for none.

        Raises:
            CloudEmpty: there is nothing to be seen; of a sequence the film itself raises it, in
                place of its end.
        """
        looks = looks or {}
        if opened.reels:
            pictures = pictures_of(opened.reels[0])
            load = load or opened.reels[0].load
            shots = moving_shots(load, pictures, opened.stills, looks, size_px, objects)
            return cls(sum(pictures), shots)
        origin = middle_m(opened.stills[0]) if opened.stills else np.zeros(3)
        painter = Painter(looks, origin)
        cloud = joined([painter.still(one) for one in opened.stills if painter.visible(one.name)])
        if not len(cloud):
            raise nothing_seen()
        eyes = _eyes(cloud, opened.stills, origin, size_px)
        point_m = spacing_m(cloud)
        return cls(len(eyes), (Shot(cloud, eye, point_m) for eye in eyes))


def spacing_m(cloud: PointCloud) -> float:
    """Side of a point with which a cloud looks closed, as if it were a surface."""
    low, high = np.quantile(cloud.xyz, (0.02, 0.98), axis=0)
    size_m = float(np.linalg.norm(high - low))
    return max(SPACING_SHARE * size_m / float(np.sqrt(len(cloud))), 1e-6)


def write_film(film: Film, path: Path, told: Callable[[], None]) -> None:
    """Write a film as MP4, whole or not at all.

    Args:
        film: not begun.
        path: of the file.
        told: called with each picture.

    Raises:
        CloudEmpty: there is nothing to be seen.
        OutputError: the disk is full or gone.
    """
    tick = TICKS_PER_S // RATE_HZ

    def pictures() -> Iterator[UInt8]:
        for shot in film.shots:
            yield shot.drawn()
            told()

    write_mp4(path, pictures(), [tick * i for i in range(film.count)], last_ticks=tick)


def write_picture(film: Film, path: Path) -> None:
    """Write the first picture of a film that has points in it as PNG.

    Raises:
        CloudEmpty: there is nothing to be seen.
        OutputError: the disk is full or gone.
    """
    first = next(shot for shot in film.shots if len(shot.cloud))
    write_atomic(path, encode_png(first.drawn()))


def _eyes(
    cloud: PointCloud, stills: tuple[Still, ...], origin: Float64, size_px: tuple[int, int]
) -> list[Eye]:
    """Along the first path, where there is anything beside paths; else round everything."""
    if any(isinstance(still, StillCloud | StillOctree | StillMesh) for still in stills):
        for path in stills:
            if isinstance(path, StillPath) and path.length_m > 0:
                return [sized(eye, size_px) for eye in along(path.places_m - origin)]
    return [sized(eye, size_px) for eye in turntable(np.asarray(cloud.xyz, np.float32))]
