"""Large clouds as files: all of their points, or those that a browser has before it."""

from __future__ import annotations

import html
import threading
from collections.abc import Callable, Generator, Iterable, Mapping
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from pseudolidar.formats.points.pcd import encode_pcd_pieces
from pseudolidar.formats.points.ply import encode_ply_pieces
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.answers import Answer
from pseudolidar.viewer.drawn_octrees import DrawnOctrees
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.octree.pieces import in_pieces
from pseudolidar.viewer.octree.tree import Octree
from pseudolidar.viewer.panels.export import BYTES, file_name, styled
from pseudolidar.viewer.thinned import thinned
from pseudolidar.viewer.view import View

# Points in one file of what is seen; a browser that is told to draws more.
MOST_SEEN = 2_000_000
ENCODERS: Mapping[str, Callable[[Iterable[PointCloud], int], Generator[bytes]]] = {
    "ply": encode_ply_pieces,
    "pcd": encode_pcd_pieces,
}
PLACE = "/export/large"
NOT_WHILE = "this browser has not taken yet what it was sent"
NOTHING_SEEN = "none of the large clouds is shown"
HINT = "The points of large clouds that this browser has on its page, as finely as it draws them"


class LargeExport:
    """Links to whole clouds, and buttons for what is seen of them; nothing without large clouds.

    Args:
        view: what is looked at.
        octrees: draws the clouds.
    """

    def __init__(self, view: View, octrees: DrawnOctrees) -> None:
        self._view, self._octrees = view, octrees
        self._names: tuple[str, ...] = ()
        self._busy = threading.Lock()
        gui = view.gui
        self._links = gui.add_html("", visible=False)
        self._seen = gui.add_button_group(
            "Seen here", tuple(map(str.upper, ENCODERS)), visible=False, hint=HINT
        )
        self._told = gui.add_html("", visible=False)
        view.server.pages[PLACE] = self._whole
        self._seen.on_click(lambda event: self._send(event.client, self._seen.value.lower()))
        view.on_shown(self._show)

    @property
    def _trees(self) -> dict[str, Octree]:
        return self._view.stage.trees

    def _show(self, _moment: Moment) -> None:
        trees = self._trees
        if tuple(trees) != self._names:
            self._names = tuple(trees)
            self._links.content = styled("<br>".join(_links(n, t) for n, t in trees.items()))
            self._links.visible = self._seen.visible = bool(trees)

    def _whole(self, query: Mapping[str, str]) -> Answer:
        """All points of a cloud, made while they are sent."""
        tree, kind = self._trees.get(query.get("name", "")), query.get("kind", "")
        if tree is None or kind not in ENCODERS:
            return Answer(b"", "text/plain", HTTPStatus.NOT_FOUND)
        return Answer(
            b"",
            BYTES,
            download=_name_of(query["name"], "all", kind),
            pieces=ENCODERS[kind](in_pieces(tree), len(tree)),
            length=_length(tree, kind),
        )

    def _send(self, client: Any, kind: str) -> None:
        """What a browser has before it, of one browser at a time."""
        if client is None or not self._busy.acquire(blocking=False):
            return
        try:
            if not self._octrees.has_room(client):
                self._tell(NOT_WHILE)
                return
            seen = self._octrees.seen(client)
            for name, cloud in seen.items():
                some = thinned(cloud, MOST_SEEN)
                data = b"".join(ENCODERS[kind]([some], len(some)))
                client.send_file_download(_name_of(name, "seen", kind), data, save_immediately=True)
            told = [f"{name}, {_share(cloud)}" for name, cloud in seen.items()]
            self._tell(f"Sent: {'; '.join(told)}" if told else NOTHING_SEEN)
        finally:
            self._busy.release()

    def _tell(self, said: str) -> None:
        self._told.content, self._told.visible = styled(html.escape(said)), bool(said)


def _name_of(cloud: str, which: str, kind: str) -> str:
    return file_name(f"{Path(cloud).stem}_{which}", kind)


def _length(tree: Octree, kind: str) -> int:
    """Bytes of the file of all points: all of them take the same."""
    first = next(in_pieces(tree))
    head, body = ENCODERS[kind]([first], len(tree))
    return len(head) + len(body) // len(first) * len(tree)


def _share(cloud: PointCloud) -> str:
    if len(cloud) <= MOST_SEEN:
        return f"{len(cloud):,} points"
    return f"{MOST_SEEN:,} of {len(cloud):,} points, evenly taken"


def _links(name: str, tree: Octree) -> str:
    def link(kind: str) -> str:
        address = f"{PLACE}?{urlencode({'name': name, 'kind': kind})}"
        return f'<a href="{html.escape(address)}" download>{kind.upper()}</a>'

    return f"{html.escape(name)}, all {len(tree):,} points: {', '.join(map(link, ENCODERS))}"
