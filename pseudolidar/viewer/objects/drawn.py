"""Nodes of viser for objects: few, changed in place."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.structures.arrays import Float32, Float64, UInt8
from pseudolidar.viewer.objects.lines import coloured, dashed, edges_of
from pseudolidar.viewer.objects.scene import ObjectScene, Parts, ShownWords
from pseudolidar.viewer.objects.shown import TRUTH_COLOUR, Colour
from pseudolidar.viewer.stage import RIG

if TYPE_CHECKING:
    from viser import ViserServer

NODE = f"{RIG}/objects"
CHOSEN_COLOUR = (255, 255, 255)
# Widths of lines, px.
SURE_PX, UNSURE_PX, CHOSEN_PX = 2.5, 1.2, 5.0
# Points of objects are drawn over those of the cloud, m.
POINT_M = 0.055
# Words that would cover those of a nearer thing are left out, as seen from where one looks at
# first: so far apart they are, degrees across and upwards.
EYE_M, APART_DEG = (-8.0, 0.0, 5.0), (6.5, 3.0)


class DrawnObjects:
    """Objects in the scene of a server.

    Args:
        server: draws.
    """

    def __init__(self, server: ViserServer) -> None:
        self._server, self._scene = server, server.scene
        self._nodes: dict[str, Any] = {}
        self._labels: list[Any] = []

    def show(self, scene: ObjectScene, parts: Parts) -> None:
        """Draw the objects of a frame in place of those before."""
        words, scene = scene.words(parts), scene.only(parts)
        sure = [one for one in scene.objects if one.sure]
        unsure = [one for one in scene.objects if not one.sure]
        chosen = [one.corners_m for one in scene.objects if one.key == scene.chosen]
        truths = [one.corners_m for one in scene.truths]
        with self._server.atomic():
            self._boxes("sure", [one.corners_m for one in sure], [o.colour for o in sure], SURE_PX)
            self._boxes(
                "unsure", [o.corners_m for o in unsure], [o.colour for o in unsure], UNSURE_PX,
                dashes=True,
            )  # fmt: skip
            self._boxes("chosen", chosen, [CHOSEN_COLOUR] * len(chosen), CHOSEN_PX)
            self._boxes("truth", truths, [TRUTH_COLOUR] * len(truths), UNSURE_PX)
            self._arrows(scene)
            self._corridor(scene)
            self._points(scene)
            self._words(apart(words)[: parts.labels])

    def _boxes(
        self,
        name: str,
        boxes: list[Float64],
        colours: list[Colour],
        width_px: float,
        *,
        dashes: bool = False,
    ) -> None:
        edges = edges_of(boxes)
        drawn = dashed(edges) if dashes else edges
        each = len(drawn) // len(boxes) if boxes else 0
        self._lines(name, drawn, coloured(colours, each), width_px)

    def _lines(self, name: str, lines: Float32, colours: UInt8, width_px: float) -> None:
        add = partial(self._scene.add_line_segments, thickness=width_px, thickness_units="screen")
        self._put(name, add, lines, colours)

    def _put(self, name: str, add: Callable[..., Any], points: Float32, colours: UInt8) -> None:
        """Draw points in place of those before, with the node that `add` makes; none: hide it."""
        node = self._nodes.get(name)
        if node is not None:
            node.visible = len(points) > 0
        if not len(points):
            return
        if node is None:
            self._nodes[name] = add(f"{NODE}/{name}", points, colours)
            return
        node.points, node.colors = points, colours

    def _arrows(self, scene: ObjectScene) -> None:
        moving = [one for one in scene.objects if one.arrow_m is not None]
        add = partial(self._scene.add_arrows, shaft_radius=0.06, head_radius=0.18, head_length=0.4)
        points = np.asarray([one.arrow_m for one in moving], np.float32)
        self._put("arrows", add, points, np.array([one.colour for one in moving], np.uint8))

    def _corridor(self, scene: ObjectScene) -> None:
        corridor = scene.corridor
        lines = edges_of([]) if corridor is None else corridor.lines()
        colours = [] if corridor is None else [corridor.colour]
        self._lines("corridor", lines, coloured(colours, len(lines)), SURE_PX)

    def _points(self, scene: ObjectScene) -> None:
        add = partial(
            self._scene.add_point_cloud, point_size=POINT_M, point_shape="rounded",
            point_shading="flat", precision="float32",
        )  # fmt: skip
        self._put("points", add, scene.xyz, scene.colours)

    def _words(self, said: Sequence[ShownWords]) -> None:
        while len(self._labels) < len(said):
            name = f"{NODE}/label_{len(self._labels)}"
            label = self._scene.add_label(name, "", anchor="bottom-center", font_screen_scale=0.9)
            self._labels.append(label)
        for label, words in zip(self._labels, said, strict=False):
            label.text, label.position, label.visible = words.text, _above(words.corners_m), True
        for label in self._labels[len(said) :]:
            label.visible = False


def apart(said: Sequence[ShownWords]) -> list[ShownWords]:
    """Words without those that would cover earlier ones."""
    kept: list[ShownWords] = []
    taken: list[Float64] = []
    for words in said:
        x, y, z = _above(words.corners_m) - EYE_M
        at = np.degrees([math.atan2(y, x), math.atan2(z, math.hypot(x, y))])
        if not any(bool((np.abs(at - other) < APART_DEG).all()) for other in taken):
            kept.append(words)
            taken.append(at)
    return kept


def _above(corners_m: Float64) -> Float64:
    """(3,) over the middle of a box."""
    return np.append(corners_m[:, :2].mean(axis=0), corners_m[:, 2].max() + 0.1)
