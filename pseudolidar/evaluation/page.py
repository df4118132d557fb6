"""Reports as one HTML file: text, tables, plots and pictures inside; only videos lie beside it."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from pseudolidar.formats.pictures.image import encode_jpeg, encode_png
from pseudolidar.structures.arrays import UInt8

if TYPE_CHECKING:
    from jinja2 import Template
    from matplotlib.figure import Figure

JPEG_QUALITY = 85

_TEMPLATE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{{ title }}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
:root { color-scheme: light dark; --line: #8884; --soft: #888; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1500px; margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.5rem; margin-bottom: .2rem } h2 { font-size: 1.15rem; margin-top: 2rem }
table { border-collapse: collapse } td, th { padding: .2rem .9rem .2rem 0; text-align: left;
border-bottom: 1px solid var(--line); vertical-align: top }
figure { margin: 0 } figcaption, .soft { color: var(--soft); font-size: .85rem }
.row { display: grid; gap: .6rem; margin: .6rem 0 1.4rem; align-items: start }
img, video { width: 100%; height: auto; display: block; border-radius: 3px }
.plots { display: flex; flex-wrap: wrap; gap: 1rem } .plots img { background: #fff; width: auto;
max-width: 100% }
</style></head><body>
<h1>{{ title }}</h1><p class="soft">{{ subtitle }}</p>
{% for section in sections %}<h2>{{ section.title }}</h2>
{% if section.text %}<p>{{ section.text }}</p>{% endif %}
{% if section.table %}<table>{% for row in section.table %}<tr>{% for cell in row %}
{% if loop.first %}<th>{{ cell }}</th>{% else %}<td>{{ cell }}</td>{% endif %}
{% endfor %}</tr>{% endfor %}</table>{% endif %}
{% if section.video %}
<video controls loop muted playsinline preload="metadata" src="{{ section.video }}">
<a href="{{ section.video }}">{{ section.video }}</a></video>{% endif %}
{% if section.plots %}<div class="plots">{% for plot in section.plots %}
<figure><img alt="{{ plot.caption }}" src="{{ plot.uri }}"></figure>{% endfor %}</div>{% endif %}
{% for row in section.pictures %}
<div class="row" style="grid-template-columns: {{ row.columns }}">{% for picture in row.pictures %}
<figure><img alt="{{ picture.caption }}" src="{{ picture.uri }}">
<figcaption>{{ picture.caption }}</figcaption></figure>{% endfor %}</div>{% endfor %}
{% endfor %}</body></html>
"""


@dataclass(frozen=True)
class Picture:
    """An encoded picture.

    Args:
        uri: data URI.
        caption: what it shows.
        width: relative width in its row.
    """

    uri: str
    caption: str
    width: float = 1.0

    @classmethod
    def photo(cls, pixels: UInt8, caption: str, *, width: float = 1.0) -> Picture:
        """From (H, W) or (H, W, 3) RGB, compressed like a photo."""
        return cls(_uri("image/jpeg", encode_jpeg(pixels, JPEG_QUALITY)), caption, width)

    @classmethod
    def exact(cls, pixels: UInt8, caption: str, *, width: float = 1.0) -> Picture:
        """From (H, W, 3) RGB, without loss."""
        return cls(_uri("image/png", encode_png(pixels)), caption, width)

    @classmethod
    def plot(cls, figure: Figure, caption: str) -> Picture:
        """From a matplotlib figure, as vectors."""
        buffer = io.BytesIO()
        figure.savefig(buffer, format="svg", bbox_inches="tight")
        return cls(_uri("image/svg+xml", buffer.getvalue()), caption)


@dataclass(frozen=True)
class PictureRow:
    """Pictures side by side, as wide as their weights say."""

    pictures: tuple[Picture, ...]

    @property
    def columns(self) -> str:
        """CSS grid columns."""
        return " ".join(f"{picture.width:g}fr" for picture in self.pictures)


@dataclass(frozen=True)
class Section:
    """A part of a page; what is empty is left out.

    Args:
        title: its heading.
        text: a paragraph.
        table: rows of cells, the first of each is its name.
        plots: side by side.
        pictures: rows of pictures.
        video: address of a video, beside the page.
    """

    title: str
    text: str = ""
    table: Sequence[Sequence[Any]] = ()
    plots: Sequence[Picture] = ()
    pictures: Sequence[PictureRow] = ()
    video: str = ""


def render_page(title: str, subtitle: str, sections: Sequence[Section]) -> bytes:
    """The page as UTF-8 HTML; all text is escaped."""
    page = _template().render(title=title, subtitle=subtitle, sections=sections)
    return page.encode("utf-8", "surrogateescape")


@cache
def _template() -> Template:
    from jinja2 import Environment

    return Environment(autoescape=True, trim_blocks=True).from_string(_TEMPLATE)


def _uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
