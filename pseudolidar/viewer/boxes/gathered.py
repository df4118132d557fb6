"""All points that a box may hold, of everything that is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pseudolidar.geometry.twists import inverted
from pseudolidar.structures.arrays import Float64
from pseudolidar.viewer.boxes.figures import BoxFigures, Found
from pseudolidar.viewer.boxes.region import Region
from pseudolidar.viewer.drawn_octrees import DrawnOctrees
from pseudolidar.viewer.moment import STEREO, Moment
from pseudolidar.viewer.view import View


@dataclass(frozen=True)
class Gatherer:
    """Finds what lies in boxes.

    Args:
        view: what is looked at.
        octrees: large clouds in it.
    """

    view: View
    octrees: DrawnOctrees

    def figures(self, region: Region) -> Mapping[str, BoxFigures]:
        """Figures of each cloud that is drawn and has points in the box, by name."""
        told = {name: BoxFigures.of(region, one) for name, one in self._found(region).items()}
        return {name: one for name, one in told.items() if one is not None}

    def _found(self, region: Region) -> Mapping[str, Found]:
        stage, moment = self.view.stage, self.view.moment
        T_local_scene = inverted(stage.placement.T_scene_local)
        whole = {} if moment is None else moment.clouds  # of which the stage draws some
        found = {
            name: Found(whole.get(name, drawn), T_local_scene @ T, _eye_of(moment, name))
            for name, (drawn, T) in stage.pickable().items()
        }
        for name, (cloud, T_local_map, left_out) in self.octrees.within(region.sides).items():
            found[name] = Found(cloud, T_local_map, whole=len(cloud) + left_out if left_out else 0)
        return found


def _eye_of(moment: Moment | None, name: str) -> Float64 | None:
    """Where the points of a frame's own cloud were seen from."""
    if moment is None or moment.sight is None or name != STEREO:
        return None
    return moment.sight.T_forward_camera[:3, 3]
