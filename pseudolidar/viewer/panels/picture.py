"""The pictures of the shown frame: point at a pixel, drag a box to measure what is in it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from http import HTTPStatus
from pathlib import Path

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.formats.pictures.image import encode_jpeg, encode_png
from pseudolidar.geometry.box_in_view import across_m
from pseudolidar.obstacles.measure import measured
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.sighting import Seen
from pseudolidar.structures.box import Detection
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.recorded import Frame
from pseudolidar.viewer.answers import Answer
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.pictures import Layer, camera_of, kinds, pixel_of
from pseudolidar.viewer.remembered import RememberedSights
from pseudolidar.viewer.view import View

PAGE = Path(__file__).parent.parent / "pages" / "picture.html"
# Pictures whose colours mean values; the others are photos.
EXACT = ("disparity", "depth", "sigma", "error")
# Room for them: their width on the page, names and what is told of a pixel, px.
WIDE_PX, WORDS_PX, MOST_PX = 364, 140, 420
# What an unnamed thing in a box is called.
THING = "thing"


class PicturePanel:
    """A page of our own within viser's, that asks for what it shows.

    Args:
        view: what is looked at.
        sights: what things in frames are measured by; None where they cannot be.
    """

    def __init__(self, view: View, sights: RememberedSights | None) -> None:
        self._view, self._sights = view, sights
        self._layers: dict[str, Layer] = {}
        self._pickers: list[Callable[[float, float], None]] = []
        self._boxes: Callable[[], str] | None = None
        page = PAGE.read_bytes()
        view.server.pages |= {
            "/picture": lambda _query: Answer(page, "text/html; charset=utf-8"),
            "/picture/state": self._state,
            "/picture/view": self._picture,
            "/picture/pixel": self._pixel,
            "/picture/measure": self._measure,
        }
        # Clouds that nobody took pictures of leave its room to the rest of the page.
        self._folder = view.gui.add_folder("Pictures", visible=False)
        with self._folder:
            self._frame = view.gui.add_html(framed(MOST_PX))
        view.on_shown(self._fit)

    def add_layer(self, name: str, layer: Layer) -> None:
        """Offer another picture, of the same size as the left one."""
        self._layers[name] = layer

    def show_boxes(self, version: Callable[[], str]) -> None:
        """Ask `/picture/boxes` for boxes over the pictures whenever this version changes."""
        self._boxes = version

    def on_pick(self, picker: Callable[[float, float], None]) -> None:
        """Call this with the place (x, y), px, of every click into the picture."""
        self._pickers.append(picker)

    def measure_by(self, sighted: Callable[[Frame], Seen]) -> None:
        """Measure by other settings from now on."""
        if self._sights is not None:
            self._sights.change(sighted)

    def seen(self, moment: Moment) -> Seen | None:
        """What is seen in a frame; None where nothing can be measured.

        Raises:
            PseudolidarError: there is nothing to be seen.
        """
        if moment.converted is None or self._sights is None:
            return None
        return self._sights(moment.converted.frame)

    def _fit(self, moment: Moment) -> None:
        """Show the page with the first pictures, as high as those of this shape need."""
        if moment.converted is None or not kinds(moment.converted):
            return
        if not self._folder.visible:
            self._folder.visible = True
        camera = camera_of(moment.converted.frame)
        picture_px = round(WIDE_PX * camera.height_px / camera.width_px)
        page = framed(min(picture_px + WORDS_PX, MOST_PX))
        if self._frame.content != page:
            self._frame.content = page

    def _state(self, _query: Mapping[str, str]) -> Answer:
        converted = self._converted
        state = {"version": self._view.version, "dark": self._view.dark, "kinds": []}
        if self._boxes is not None:
            state["boxes"] = self._boxes()
        if converted is not None and (found := kinds(converted)):
            camera = camera_of(converted.frame)
            names = [*found, *self._layers_of(self._view.moment)]
            state |= {"kinds": names, "width": camera.width_px, "height": camera.height_px}
        return _json(state)

    def _picture(self, query: Mapping[str, str]) -> Answer:
        converted, kind = self._converted, query.get("kind", "")
        found = {} if converted is None else kinds(converted)
        layers = self._layers_of(moment := self._view.moment)
        if moment is not None and kind in layers:
            return Answer(encode_png(np.ascontiguousarray(layers[kind].draw(moment))), "image/png")
        if converted is None or kind not in found:
            return Answer(b"", "text/plain", HTTPStatus.NOT_FOUND)
        pixels = np.ascontiguousarray(found[kind](converted))
        if kind in EXACT:
            return Answer(encode_png(pixels), "image/png")
        return Answer(encode_jpeg(pixels), "image/jpeg")

    def _pixel(self, query: Mapping[str, str]) -> Answer:
        moment, place = self._view.moment, _numbers(query, "x", "y")
        converted = None if moment is None else moment.converted
        if converted is None or place is None or not kinds(converted):
            return _json({"text": ""})
        pixel = pixel_of(converted, *place)
        if "mark" in query:
            known = np.isfinite(pixel.depth_m)
            if self._view.moment is moment:
                self._view.marks.show_place(
                    self._view.stage.of_camera(pixel.xyz_m) if known else None
                )
            for picker in self._pickers:
                picker(*place)
        return _json({"text": pixel.text})

    def _measure(self, query: Mapping[str, str]) -> Answer:
        box = _numbers(query, "left", "top", "right", "bottom")
        moment = self._view.moment
        if self._sights is None or box is None or moment is None or moment.converted is None:
            return _json({"text": "nothing can be measured here"})
        left, top, right, bottom = box
        if not (left <= right and top <= bottom):
            return Answer(b"", "text/plain", HTTPStatus.BAD_REQUEST)
        try:
            sight = self._sights(moment.converted.frame).sight
            (obstacle,) = measured(sight, [Detection(THING, (left, top, right, bottom))])
        except PseudolidarError as error:
            return _json({"text": str(error)})
        if self._view.moment is moment:  # else the box is of a frame that is seen no more
            self._view.marks.show_box(obstacle.box)
        return _json({"text": _said(obstacle), "distance_m": obstacle.distance_m})

    def _layers_of(self, moment: Moment | None) -> dict[str, Layer]:
        """The other pictures that there are of a frame."""
        if moment is None or moment.converted is None:
            return {}
        return {name: one for name, one in self._layers.items() if one.there(moment)}

    @property
    def _converted(self) -> Converted | None:
        moment = self._view.moment
        return None if moment is None else moment.converted


def framed(height_px: int) -> str:
    """The page of the pictures within viser's."""
    return (
        f'<iframe src="/picture" title="Pictures" style="width:100%;height:{height_px}px;'
        'border:0;display:block"></iframe>'
    )


def _said(obstacle: Obstacle) -> str:
    if obstacle.measured_by == "size":
        return "nothing in it was matched (sky, no texture, or too small): it is not measured"
    box = obstacle.box
    assert box.sigma_m is not None  # an Obstacle has it
    return (
        f"distance {obstacle.distance_m:.2f} ± {obstacle.sigma_distance_m:.2f} m\n"
        f"{across_m(box):.2f} m across, {box.height_m:.2f} ± {box.sigma_m[5]:.2f} m high\n"
        f"{obstacle.points} points, confidence {obstacle.confidence:.2f}"
    )


def _numbers(query: Mapping[str, str], *names: str) -> tuple[float, ...] | None:
    """Finite numbers of a query; None where one is missing or is none."""
    try:
        found = tuple(float(query[name]) for name in names)
    except (KeyError, ValueError):
        return None
    return found if all(map(math.isfinite, found)) else None


def _json(value: object) -> Answer:
    return Answer(json.dumps(value).encode())
