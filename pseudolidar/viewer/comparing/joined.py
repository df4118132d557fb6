"""Sequences that join the first one in its scene, each in a colour of its own."""

from __future__ import annotations

from collections.abc import Sequence

from pseudolidar.viewer.colouring import Colouring
from pseudolidar.viewer.comparing.companions import Companion, Companions, label_of
from pseudolidar.viewer.comparing.range_plot import colour_of
from pseudolidar.viewer.moment import POINTS, STEREO, VELODYNE
from pseudolidar.viewer.reel import Reel
from pseudolidar.viewer.stage import Look
from pseudolidar.viewer.view import View

JOINING = "companions"


def joined(view: View, reels: Sequence[Reel]) -> Companions:
    """Show all but the first of some sequences beside it.

    Args:
        view: of the first.
        reels: all of them.
    """
    companions = Companions()
    view.finishing[JOINING] = companions
    for reel in reels[1:]:
        label = label_of(reel, [one.label for one in companions.every])
        join(view, companions, Companion.of(label, reel, reels[0]))
    return companions


def join(
    view: View, companions: Companions, companion: Companion, look: Look | None = None
) -> None:
    """Show a sequence beside the first one from now on.

    Args:
        view: of the first.
        companions: that are shown already.
        companion: the new one.
        look: of its clouds; by default plain, in the colour that drawings have for it.
    """
    companions.add(companion)
    labels = [one.label for one in companions.every]
    for cloud in (STEREO, VELODYNE, POINTS):
        name = companion.name(cloud)
        plain = Colouring("plain", colour=_rgb(colour_of(name, labels)))
        view.stage.looks.setdefault(name, look or Look(plain))
    view.remake()


def _rgb(text: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(text.removeprefix("#"))
    return red, green, blue
