"""Of large clouds the points that a comparison is made of, and what is left out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.comparing.errors import AROUND_M, MOST_NEIGHBOURS
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.octree.pieces import Near, near
from pseudolidar.viewer.octree.tree import Octree


def compared_stills(
    moment: Moment,
    stills: Mapping[str, PointCloud],
    trees: Mapping[str, Octree],
    names: Iterable[str],
) -> tuple[dict[str, PointCloud], list[str]]:
    """What lies still by name, of large clouds the points around the rig; and what is left out.

    Where nobody knows the place of the rig, of the whole cloud; and of too many the coarsest,
    which are evenly apart.

    Args:
        moment: a frame.
        stills: clouds that are compared as they are.
        trees: large clouds.
        names: of what is compared.

    Returns:
        The clouds, and a line for each of which points are left out.
    """
    found, left_out = dict(stills), []
    place_m = None if moment.T_map_forward is None else moment.T_map_forward[:3, 3]
    for name in names:
        if name in trees:
            some = near(trees[name], place_m, AROUND_M, most=MOST_NEIGHBOURS)
            found[name] = some.cloud
            if some.there > len(some.cloud):
                left_out.append(_words(name, some))
    return found, left_out


def _words(name: str, some: Near) -> str:
    return (
        f"{name}: {len(some.cloud):,} of {some.there:,} points, evenly apart: distances to it are "
        "as large as the gaps between them at least."
    )
