"""All points that a box may hold, of everything that is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.boxes.figures import BoxFigures, Found
from pseudolidar.viewer.boxes.region import Region
from pseudolidar.viewer.drawn_octrees import DrawnOctrees
from pseudolidar.viewer.moment import STEREO, Moment
from pseudolidar.viewer.view import View


@dataclass(frozen=True, eq=False)
class Asked:
    """What figures of clouds that lie still depend on.

    Args:
        region: the box.
        clouds: that are drawn, by name, with the (4, 4) poses of their frames.
        octrees: names of those that are drawn.
    """

    region: Region
    clouds: Mapping[str, tuple[PointCloud, Float64]]
    octrees: tuple[str, ...]

    def is_as(self, other: Asked) -> bool:
        """Whether the figures are the same."""
        return (
            self.region is other.region
            and self.octrees == other.octrees
            and self.clouds.keys() == other.clouds.keys()
            and all(
                cloud is other.clouds[name][0] and np.array_equal(T, other.clouds[name][1])
                for name, (cloud, T) in self.clouds.items()
            )
        )


@dataclass
class Gatherer:
    """Finds what lies in boxes, in one thread at a time.

    Figures of what lies still are kept, since frames go on many times a second.

    Args:
        view: what is looked at.
        octrees: large clouds in it.
    """

    view: View
    octrees: DrawnOctrees
    _kept: tuple[Asked, Mapping[str, BoxFigures]] | None = field(default=None, init=False)

    def figures(self, region: Region | None) -> Mapping[str, BoxFigures]:
        """Figures of each cloud that is drawn and has points in the box, by name."""
        if region is None:
            self._kept = None
            return {}
        return {**_told(region, self._of_frame()), **self._of_stills(region)}

    def _of_frame(self) -> Mapping[str, Found]:
        """All points of the shown frame's clouds, of which the stage may draw some.

        Where they are is asked of the frame, not of the stage, which may be on its way to it.
        """
        moment, stage = self.view.moment, self.view.stage
        if moment is None:
            return {}
        drawn = stage.drawn_of(moment.clouds, stage.placement.local(moment.T_map_forward))
        return {name: Found(cloud, T, _eye_of(moment, name)) for name, (cloud, T) in drawn.items()}

    def _of_stills(self, region: Region) -> Mapping[str, BoxFigures]:
        stage = self.view.stage
        clouds = stage.drawn_of(stage.whole_stills, stage.placement.T_local_map)
        asked = Asked(region, clouds, self.octrees.visible)
        if self._kept is None or not self._kept[0].is_as(asked):
            self._kept = asked, _told(region, self._found_of(asked))
        return self._kept[1]

    def _found_of(self, asked: Asked) -> Mapping[str, Found]:
        found = {name: Found(cloud, T) for name, (cloud, T) in asked.clouds.items()}
        for name, (cloud, T, left_out) in self.octrees.within(asked.region.sides).items():
            found[name] = Found(cloud, T, whole=len(cloud) + left_out if left_out else None)
        return found


def _told(region: Region, found: Mapping[str, Found]) -> Mapping[str, BoxFigures]:
    told = {name: BoxFigures.of(region, one) for name, one in found.items()}
    return {name: one for name, one in told.items() if one is not None}


def _eye_of(moment: Moment, name: str) -> Float64 | None:
    """Where the points of a frame's own cloud were seen from."""
    if moment.sight is None or name != STEREO:
        return None
    return moment.sight.T_forward_camera[:3, 3]
