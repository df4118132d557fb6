"""The frames of a source by another rig: its own, or one that is refined while one looks."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pseudolidar.errors import PseudolidarError
from pseudolidar.running.rig_output import store_rig
from pseudolidar.sources.changed import ChangedSource
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.viewer.reel import Reel

RIG_FILE = "rig.json"
# Frames that a rig is fitted to, evenly taken: 22 of KITTI tell half a pixel to 0.05 px.
MOST_FRAMES = 40

# Is told of every frame that was read, with how many there are; raises to end the fit.
Seeing = Callable[[int], None]


@dataclass(frozen=True)
class Fit:
    """What a fit has come to.

    Args:
        rig: put right; None where there is nothing to be put right.
        lines: for people.
    """

    rig: StereoRig | None
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Refined:
    """A sequence by a refined rig.

    Args:
        reel: its frames; None where there was nothing to be put right.
        lines: how the rig was found, for people.
        file: the rig, as `refine` writes it.
    """

    reel: Reel | None
    lines: tuple[str, ...]
    file: bytes


@dataclass(frozen=True)
class RigShop:
    """Other rigs for the frames of a source.

    Args:
        by_rig: the frames by the rig in a file; None for the source's own.
        fit: refines the rig that they are looked at with.
        given: whether that is not the source's own.
    """

    by_rig: Callable[[Path | None], Reel]
    fit: Callable[[Seeing], Fit]
    given: bool = False

    def refined(self, seen: Seeing) -> Refined:
        """Fit, and see the frames by it as any command does that is given the file.

        Raises:
            PseudolidarError: no frame has a reference, or too little of one; or `seen` does.
        """
        found = self.fit(seen)
        if found.rig is None:
            return Refined(None, found.lines, b"")
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / RIG_FILE
            store_rig(place, found.rig)
            return Refined(self.by_rig(place), found.lines, place.read_bytes())


class Ended(PseudolidarError):
    """Nobody wants it any more."""


def some_frames(source: FrameSequence[StereoFrame], seen: Seeing) -> FrameSequence[StereoFrame]:
    """Frames to fit to, evenly taken of a source, each of which is told when it is read.

    Args:
        source: pairs.
        seen: is told how many there are.
    """
    step = -(-len(source.ids) // MOST_FRAMES)
    chosen = select(source, FrameSelection.parse(f"0::{max(step, 1)}"))
    return ChangedSource(chosen, "", partial(_told, seen=seen, frames=len(chosen.ids)))


def _told(frame: StereoFrame, *, seen: Seeing, frames: int) -> StereoFrame:
    seen(frames)
    return frame
