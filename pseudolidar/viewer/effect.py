"""Which flags of `view` nothing of what was opened takes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from pseudolidar.running.settings_schema import settings_fields
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import DepthFrame
from pseudolidar.viewer.reel import Reel, SourceReel

# Settings of `view` by what takes them: frames of sources, those with depth, pairs, objects.
OF_FRAMES = ("frames", "outliers")
OF_DEPTHS = ("reproject", "rig", "rig_unit")
OF_PAIRS = ("matcher", "rows", "balance", "temporal", "smooth", "fill")
OF_EVERY_PAIR = ("clean",)  # also of those of a run, whose other settings stay
OF_OBJECTS = ("detector", "corridor")


def without_effect(job: Any, reels: Sequence[Reel]) -> tuple[str, ...]:
    """The flags that were given, and that no sequence takes: files and maps are as they are.

    Args:
        job: the settings of `view`.
        reels: what was opened; objects are of the first one.
    """
    taken = {name for reel in reels for name in _taken(reel)}
    if reels and isinstance(first := reels[0], SourceReel) and first.sighted is not None:
        taken |= {*OF_OBJECTS}
    known = {*OF_FRAMES, *OF_DEPTHS, *OF_PAIRS, *OF_EVERY_PAIR, *OF_OBJECTS}
    return tuple(
        f"--{field.flag}"
        for field in settings_fields(type(job))
        if field.name in known - taken and getattr(job, field.name) != field.default
    )


def _taken(reel: Reel) -> Iterator[str]:
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
