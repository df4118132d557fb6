"""Objects in the pictures of a film: boxes, arrows and corridor as lines, and words beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from pseudolidar.evaluation.captions import write_on
from pseudolidar.evaluation.cloud_views import Eye
from pseudolidar.evaluation.free_place import Places, Rectangle
from pseudolidar.evaluation.lines_and_labels import draw_label, draw_lines
from pseudolidar.geometry.lines_in_view import in_front
from pseudolidar.structures.arrays import Float32, Float64, UInt8
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.objects.lines import dashed, edges_of
from pseudolidar.viewer.objects.scene import ObjectScene, Parts
from pseudolidar.viewer.objects.shown import TRUTH_COLOUR, Colour

# Widths of lines of what is sure, and of what is not, px.
SURE_PX, UNSURE_PX = 2, 1
# An arrow's head is as long as this share of it, and half as wide to each side.
HEAD = 0.2
WORDS_SIZE, CAPTION_SIZE, CAPTION_AT_PX = 0.48, 0.6, (14, 16)


@dataclass(frozen=True, eq=False)
class FilmedObjects:
    """Objects of the frames of a film.

    Args:
        scenes: frames in their order to what is drawn of them.
        parts: what of that is drawn.
    """

    scenes: Callable[[Moment], ObjectScene]
    parts: Parts = field(default_factory=Parts)


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines of one colour.

    Args:
        ends_m: (N, 2, 3).
        colour: red, green, blue.
        width_px: of each.
    """

    ends_m: Float32 | Float64
    colour: Colour
    width_px: int = SURE_PX


@dataclass(frozen=True, eq=False)
class Words:
    """What is written beside a box.

    Args:
        lines: of text.
        corners_m: (8, 3) of the box.
        colour: of it.
    """

    lines: tuple[str, ...]
    corners_m: Float64
    colour: Colour


@dataclass(frozen=True, eq=False)
class Outlines:
    """All that is drawn over the points of a picture: the far first.

    Args:
        lines: of boxes and of all else.
        words: the nearest first, which choose their place first.
        caption: at the lower edge.
    """

    lines: tuple[Lines, ...] = ()
    words: tuple[Words, ...] = ()
    caption: str = ""

    @classmethod
    def of(cls, scene: ObjectScene, parts: Parts, T_film_forward: Float64) -> Outlines:
        """The objects of a frame.

        Args:
            scene: in the frame of its clouds.
            parts: what of it is drawn.
            T_film_forward: (4, 4) where that frame is in the film.
        """
        T, drawn = T_film_forward, scene.only(parts)
        local = (*_corridor(drawn), *_truths(drawn), *_boxes(drawn))
        lines = (replace(one, ends_m=_moved(one.ends_m, T)) for one in local)
        words = (
            Words(tuple(plain(one.text).split("\n")), _moved(one.corners_m, T), one.colour)
            for one in scene.words(parts)[: parts.labels]
        )
        caption = "" if scene.corridor is None else scene.corridor.text
        return cls(tuple(lines), tuple(words), plain(caption))

    def draw(self, picture: UInt8, eye: Eye) -> None:
        """Draw all into a picture.

        Args:
            picture: (H, W, 3) RGB, changed.
            eye: that it is seen from.
        """
        for one in self.lines:
            draw_lines(picture, projected(one.ends_m, eye), one.colour, one.width_px)
        beside = [(words, _around(words.corners_m, eye, picture)) for words in self.words]
        seen = [(words, around) for words, around in beside if around is not None]
        places = Places((eye.width_px, eye.height_px), [around for _, around in seen])
        for words, around in seen:
            draw_label(picture, places, words.lines, around, words.colour, size=WORDS_SIZE)
        if self.caption:
            right, up = CAPTION_AT_PX
            write_on(picture, self.caption, (right, eye.height_px - up), CAPTION_SIZE)


NO_OUTLINES = Outlines()


def points_of(scene: ObjectScene, parts: Parts) -> PointCloud | None:
    """Points of the objects in their colours, in the frame of the clouds; None where not drawn."""
    drawn = scene.only(parts)
    return PointCloud(drawn.xyz, "film", rgb=drawn.colours) if len(drawn.xyz) else None


def projected(ends_m: Float32 | Float64, eye: Eye) -> list[tuple[Float64, Float64]]:
    """Both ends (2,), px, of what of lines (N, 2, 3) is in front of an eye."""
    seen = in_front((ends_m - np.asarray(eye.at_m)) @ eye.axes().T)
    return list(zip(_pixels(seen[:, 0], eye), _pixels(seen[:, 1], eye), strict=True))


def plain(text: str) -> str:
    """Words as the font of pictures has them."""
    return text.replace("±", "+-")


def _pixels(seen: Float64, eye: Eye) -> Float64:
    """(N, 2) pixels of (N, 3) places before an eye, along its axes."""
    middle = np.array([eye.width_px, eye.height_px]) / 2
    return np.asarray(middle + seen[:, :2] * (eye.focal_px / seen[:, 2:]) - 0.5)


def _moved(places: Float32 | Float64, T: Float64) -> Float64:
    return np.asarray(places @ T[:3, :3].T + T[:3, 3], np.float64)


def _boxes(scene: ObjectScene) -> Iterator[Lines]:
    for one in reversed(scene.objects):
        edges = edges_of([one.corners_m])
        yield Lines(
            edges if one.sure else dashed(edges), one.colour, SURE_PX if one.sure else UNSURE_PX
        )
        if one.arrow_m is not None:
            yield Lines(_arrow(one.arrow_m), one.colour)


def _truths(scene: ObjectScene) -> Iterator[Lines]:
    if scene.truths:
        edges = edges_of([one.corners_m for one in scene.truths])
        yield Lines(edges, TRUTH_COLOUR, UNSURE_PX)


def _corridor(scene: ObjectScene) -> Iterator[Lines]:
    if scene.corridor is not None:
        yield Lines(scene.corridor.lines(), scene.corridor.colour)


def _arrow(ends_m: Float64) -> Float32:
    """(3, 2, 3) shaft and head, level."""
    begin, end = ends_m
    along = end - begin
    aside = np.array([-along[1], along[0], 0.0])
    head = end - HEAD * along
    heads = [[end, head + side * 0.5 * HEAD * aside] for side in (-1, 1)]
    return np.asarray([[begin, end], *heads], np.float32)


def _around(corners_m: Float64, eye: Eye, picture: UInt8) -> Rectangle | None:
    """What of a box is in the picture; None where nothing is."""
    ends = projected(edges_of([corners_m]), eye)
    if not ends:
        return None
    places = np.concatenate([np.stack(pair) for pair in ends])
    (left, top), (right, bottom) = places.min(axis=0), places.max(axis=0)
    height, width = picture.shape[:2]
    if right < 0 or bottom < 0 or left >= width or top >= height:
        return None
    left, right = np.clip((left, right), 0, width)
    top, bottom = np.clip((top, bottom), 0, height)
    return int(left), int(top), int(np.ceil(right)), int(np.ceil(bottom))
