"""What can be taken away: the shown clouds as files, the scene as a page of its own."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping
from http import HTTPStatus
from urllib.parse import urlencode

from pseudolidar.running.products.converted import Converted
from pseudolidar.running.products.encoders import ENCODERS
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.recorded import RecordedCloud
from pseudolidar.viewer.answers import Answer
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.view import View

KINDS = {"ply": "application/octet-stream", "pcd": "application/octet-stream"}
PAGE_NAME = "scene.html"
# What a file is not called.
ODD = re.compile(r"[^\w.-]+")


class ExportPanel:
    """Links to files that are made when they are asked for.

    Args:
        view: what is looked at.
    """

    def __init__(self, view: View) -> None:
        self._view = view
        self._names: tuple[str, ...] = ()
        view.server.pages |= {"/export/cloud": self._cloud, "/export/scene": self._scene}
        self._links = view.gui.add_html(_links(()))
        view.on_shown(self._show)

    def _show(self, _moment: Moment) -> None:
        names = tuple(self._clouds())
        if names != self._names:
            self._names = names
            self._links.content = _links(names)

    def _clouds(self) -> dict[str, PointCloud]:
        moment = self._view.moment
        shown = {} if moment is None else dict(moment.clouds)
        return shown | dict(self._view.stage.whole_stills)

    def _cloud(self, query: Mapping[str, str]) -> Answer:
        cloud, kind = self._clouds().get(query.get("name", "")), query.get("kind", "")
        if cloud is None or kind not in KINDS:
            return Answer(b"", "text/plain", HTTPStatus.NOT_FOUND)
        frame = RecordedCloud(cloud, "shown", 0, cloud.timestamp_ns)
        moment = self._view.moment
        stem = ODD.sub("_", f"{moment.id if moment else ''}_{query['name']}").strip("_.")
        return Answer(
            ENCODERS[kind](Converted(frame, cloud)), KINDS[kind], download=f"{stem}.{kind}"
        )

    def _scene(self, _query: Mapping[str, str]) -> Answer:
        page = self._view.server.viser.scene.as_html(dark_mode=self._view.dark)
        return Answer(page.encode(), "text/html; charset=utf-8", download=PAGE_NAME)


def _links(names: tuple[str, ...]) -> str:
    rows = [
        f"{html.escape(name)}: {', '.join(_link(name, kind) for kind in KINDS)}" for name in names
    ]
    rows.append('<a href="/export/scene" download>this scene, a page that needs no server</a>')
    style = "font-size:0.85em;margin:2px 10px;line-height:1.9"
    return f'<div style="{style}">{"<br>".join(rows)}</div>'


def _link(name: str, kind: str) -> str:
    address = f"/export/cloud?{urlencode({'name': name, 'kind': kind})}"
    return f'<a href="{html.escape(address)}" download>{kind.upper()}</a>'
