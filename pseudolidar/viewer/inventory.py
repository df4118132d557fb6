"""What was opened, for programs: names, kinds, amounts."""

from __future__ import annotations

from typing import Any

from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.stills import Still, StillCloud, StillMesh, StillOctree


def inventory(opened: Opened) -> list[dict[str, Any]]:
    """One JSON object for each thing: its `name`, its `kind`, and how much there is of it.

    A `sequence` has `frames`, and if a run found objects in it the number of frames `with_objects`;
    a `cloud` has `points`, a `mesh` `triangles`, a `path` `poses` and `length_m`.
    """
    sequences = [
        {"name": reel.name, "kind": "sequence", "frames": len(reel.ids)} for reel in opened.reels
    ]
    if sequences and opened.objects:  # they are of the first one
        sequences[0]["with_objects"] = sum(map(bool, opened.objects.values()))
    return [*sequences, *({"name": still.name, **_amount(still)} for still in opened.stills)]


def _amount(still: Still) -> dict[str, Any]:
    match still:
        case StillCloud():
            return {"kind": "cloud", "points": len(still.cloud)}
        case StillOctree():
            return {"kind": "cloud", "points": len(still.tree)}
        case StillMesh():
            return {"kind": "mesh", "triangles": len(still.mesh)}
    return {"kind": "path", "poses": len(still.places_m), "length_m": still.length_m}
