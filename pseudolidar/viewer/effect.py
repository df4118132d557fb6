"""Which flags of `view` nothing of what was opened takes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pseudolidar.running.settings_schema import settings_fields
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import DepthFrame
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.reel import Reel, SourceReel

# Settings of `view` by what takes them: frames of any source, those with depth, pairs, objects.
OF_FRAMES = ("frames", "outliers")
OF_DEPTHS = ("reproject", "rig", "rig_unit")
OF_PAIRS = ("matcher", "rows", "balance", "temporal", "smooth", "fill")
OF_EVERY_PAIR = ("clean",)  # also of pairs that a run saw, whose other settings are the run's
OF_OBJECTS = ("detector", "corridor")


def without_effect(job: Any, opened: Opened) -> tuple[str, ...]:
    """The flags that were given although nothing of what was opened takes them.

    Files of clouds, meshes and paths take none of them: they are shown as they are.

    Args:
        job: the settings of `view`, of which those that are named here are looked at.
        opened: what the paths were.
    """
    taken = {name for reel in opened.reels for name in _taken(reel)}
    first = opened.first_source
    if first is not None and first.sighted is not None:
        taken |= {*OF_OBJECTS}
    known = {*OF_FRAMES, *OF_DEPTHS, *OF_PAIRS, *OF_EVERY_PAIR, *OF_OBJECTS}
    return tuple(
        f"--{field.flag}"
        for field in settings_fields(type(job))
        if field.name in known - taken and getattr(job, field.name) != field.default
    )


def _taken(reel: Reel) -> Iterator[str]:
    """Names of the settings that a sequence takes; one without origin is of a run, as that was."""
    if not isinstance(reel, SourceReel):
        return
    pairs = reel.source.yields in (StereoFrame, BodyFrame)
    if pairs:
        yield from OF_EVERY_PAIR
    if reel.origin is None:
        return
    yield from OF_FRAMES
    if pairs or reel.source.yields is DepthFrame:
        yield from OF_DEPTHS
    if pairs:
        yield from OF_PAIRS
