"""What can be taken away: the shown clouds as files, the scene as a page of its own."""

from __future__ import annotations

import html
import math
import re
import threading
from collections.abc import Callable, Mapping
from http import HTTPStatus
from typing import Any
from urllib.parse import urlencode

import numpy as np

from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.products.encoders import ENCODERS
from pseudolidar.structures.arrays import UInt8
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.recorded import RecordedCloud
from pseudolidar.viewer.answers import Answer
from pseudolidar.viewer.filming.film import Film
from pseudolidar.viewer.filming.maker import FilmMaker
from pseudolidar.viewer.filming.outlined import FilmedObjects
from pseudolidar.viewer.inbound import MOST_PICTURE_PX
from pseudolidar.viewer.live_reel import LiveReel
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.reel import NoFrames
from pseudolidar.viewer.view import View

BYTES = "application/octet-stream"
KINDS = {"ply": BYTES, "pcd": BYTES}
PAGE_NAME, PICTURE_NAME = "scene.html", "view.png"
# Colours of the page behind its scene, and how long a browser may take for a picture, s.
DARK, LIGHT, PATIENCE_S = (20, 20, 20), (255, 255, 255), 20.0
# What a file is not called.
ODD = re.compile(r"[^\w.-]+")


class ExportPanel:
    """Links to files that are made when they are asked for.

    Args:
        view: what is looked at.
        objects: of its frames, from the first one on, as they are drawn now; None for none.
    """

    def __init__(self, view: View, objects: Callable[[], FilmedObjects] | None = None) -> None:
        self._view, self._objects = view, objects
        self._selection: Callable[[], Mapping[str, PointCloud]] = dict
        self._names: tuple[str, ...] = ()
        self._asked, self._lock = set[int](), threading.Lock()
        view.server.pages |= {"/export/cloud": self._cloud, "/export/scene": self._scene}
        self._links = view.gui.add_html(_links(()))
        picture = view.gui.add_button("This view as PNG")
        film = view.gui.add_button("Film (MP4)")
        self._told = view.gui.add_html("")
        self._maker = FilmMaker(self._film_of_shown, self._tell)
        view.on_stop(self._maker.stop)
        view.server.pages["/export/film"] = self._film
        picture.on_click(self._send_picture)
        film.on_click(self._make_film)
        view.on_shown(self._show)

    def _show(self, _moment: Moment) -> None:
        self.list_clouds()

    def offer(self, selection: Callable[[], Mapping[str, PointCloud]]) -> None:
        """Have files of clouds that somebody chose points of as well.

        Args:
            selection: tells them, by name.
        """
        self._selection = selection

    def list_clouds(self) -> None:
        """Links to all that there is."""
        names = tuple(self._clouds())
        if names != self._names:
            self._names = names
            self._links.content = _links(names)

    def _clouds(self) -> dict[str, PointCloud]:
        moment = self._view.moment
        shown = {} if moment is None else dict(moment.clouds)
        return shown | dict(self._view.stage.whole_stills) | dict(self._selection())

    def _cloud(self, query: Mapping[str, str]) -> Answer:
        cloud, kind = self._clouds().get(query.get("name", "")), query.get("kind", "")
        if cloud is None or kind not in KINDS:
            return Answer(b"", "text/plain", HTTPStatus.NOT_FOUND)
        frame = RecordedCloud(cloud, "shown", 0, cloud.timestamp_ns)
        moment = self._view.moment
        name = file_name(f"{moment.id if moment else ''}_{query['name']}", kind)
        return Answer(ENCODERS[kind](Converted(frame, cloud)), KINDS[kind], download=name)

    def _film_of_shown(self) -> Film:
        view, reel = self._view, self._view.reel
        opened = Opened(
            () if isinstance(reel, NoFrames | LiveReel) else (reel,), tuple(view.stage.every_still)
        )
        return Film.of(
            opened,
            dict(view.stage.looks),
            load=lambda index: view.finished(reel.load(index)),
            objects=None if self._objects is None else self._objects(),
        )

    def _make_film(self, _event: object) -> None:
        self._maker.ask()

    def _film(self, _query: Mapping[str, str]) -> Answer:
        made = self._maker.made
        if made is None:
            return Answer(b"", "text/plain", HTTPStatus.NOT_FOUND)
        return Answer(made, "video/mp4", download="film.mp4")

    def _tell(self, said: str) -> None:
        link = '<a href="/export/film" download>film.mp4</a>' if self._maker.made else ""
        self._told.content = styled(html.escape(said) or link)

    def _send_picture(self, event: Any) -> None:
        """What the browser that asks has before it; one picture of a browser at a time."""
        client = event.client
        if client is None:
            return
        with self._lock:  # who waits holds a thread that others are heard in
            if client.client_id in self._asked:
                return
            self._asked.add(client.client_id)
        try:
            pixels = _picture_of(client)
        finally:
            with self._lock:
                self._asked.discard(client.client_id)
        if pixels is None:
            self._told.content = styled("this browser sends no picture")
            return
        png = encode_png(flattened(pixels, DARK if self._view.dark else LIGHT))
        client.send_file_download(PICTURE_NAME, png, save_immediately=True)

    def _scene(self, _query: Mapping[str, str]) -> Answer:
        page = self._view.server.viser.scene.as_html(dark_mode=self._view.dark)
        return Answer(page.encode(), "text/html; charset=utf-8", download=PAGE_NAME)


def _picture_of(client: Any) -> UInt8 | None:
    """(H, W, 4) RGBA of what a browser has before it; None where it sends none of its size."""
    height, width = client.camera.image_height, client.camera.image_width
    share = min(1.0, math.sqrt(MOST_PICTURE_PX / max(height * width, 1)))
    size = int(share * height), int(share * width)
    try:
        pixels = client.get_render(*size, transport_format="png", timeout=PATIENCE_S)
    except (TimeoutError, RuntimeError):  # it is hidden, or has gone away
        return None
    return pixels if pixels.shape == (*size, 4) and pixels.dtype == np.uint8 else None


def file_name(name: str, kind: str) -> str:
    """What the file of something is called."""
    return f"{ODD.sub('_', name).strip('_.')}.{kind}"


def _links(names: tuple[str, ...]) -> str:
    rows = [
        f"{html.escape(name)}: {', '.join(_link(name, kind) for kind in KINDS)}" for name in names
    ]
    rows.append('<a href="/export/scene" download>this scene, a page that needs no server</a>')
    return styled("<br>".join(rows))


def styled(content: str) -> str:
    """Lines of a panel."""
    return f'<div style="font-size:0.85em;margin:2px 10px;line-height:1.9">{content}</div>'


def flattened(pixels: UInt8, behind: tuple[int, int, int]) -> UInt8:
    """(H, W, 3) RGB of a picture (H, W, 4) with alpha, over one colour."""
    share = pixels[:, :, 3:] / np.float32(255)
    mixed = share * pixels[:, :, :3] + (1 - share) * np.asarray(behind, np.float32)
    return np.asarray(np.rint(mixed), np.uint8)


def _link(name: str, kind: str) -> str:
    address = f"/export/cloud?{urlencode({'name': name, 'kind': kind})}"
    return f'<a href="{html.escape(address)}" download>{kind.upper()}</a>'
