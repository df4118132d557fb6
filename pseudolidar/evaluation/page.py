"""Reports as one HTML file: text, tables, plots and pictures inside; only videos lie beside it."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Literal
from urllib.parse import quote

from pseudolidar.formats.pictures.image import encode_jpeg, encode_png
from pseudolidar.structures.arrays import UInt8

if TYPE_CHECKING:
    from jinja2 import Template
    from markupsafe import Markup
    from matplotlib.figure import Figure

JPEG_QUALITY, PAINTED_QUALITY = 85, 85

# A wide screen.
WIDTH_PX = 1500

_TEMPLATE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{{ title }}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
:root { color-scheme: light dark; --line: #8884; --soft: #888; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: {{ width_px }}px; margin: 2rem auto;
padding: 0 1rem }
h1 { font-size: 1.5rem; margin-bottom: .2rem } h2 { font-size: 1.15rem; margin-top: 2rem }
table { border-collapse: collapse } td, th { padding: .2rem .9rem .2rem 0; text-align: left;
border-bottom: 1px solid var(--line); vertical-align: top }
figure { margin: 0 } figcaption, .soft { color: var(--soft); font-size: .85rem }
.row { display: grid; gap: .6rem; margin: .6rem 0 1.4rem; align-items: start }
img, video { width: 100%; height: auto; display: block; border-radius: 3px }
.figures, .words { font-size: .9rem } .figures th, .figures td { text-align: right;
font-variant-numeric: tabular-nums } .figures tr > :first-child { text-align: left }
.figures td, .figures tbody th { white-space: nowrap }
.lead { font-size: 1.15rem; margin: 1rem 0 } .wide { overflow-x: auto }
.keys { display: grid; grid-template-columns: repeat(auto-fit, minmax(9.5rem, 1fr)); gap: .8rem }
.keys div { border: 1px solid var(--line); border-radius: 6px; padding: .6rem .8rem }
.keys b { display: block; font-size: 1.5rem; font-weight: 600 }
.plots { display: flex; flex-wrap: wrap; gap: 1rem } .plots img { background: #fff; width: auto;
max-width: 100% }
@media (max-width: 700px) { .row { grid-template-columns: 1fr !important } }
@media print { :root { color-scheme: light } body { font-size: 9.5pt; margin: 0; max-width: none }
@page { margin: 14mm } h2, h2 + p { break-after: avoid }
figure, tr, .figures, .keys div { break-inside: avoid } .wide { overflow: visible }
.keys { grid-template-columns: repeat(5, 1fr) } .keys b { font-size: 13pt }
.row { gap: .4rem; margin: .4rem 0 .8rem } .row img { max-height: 105mm; object-fit: contain } }
</style></head><body>
<h1>{{ title }}</h1><p class="soft">{{ subtitle }}</p>
{% if lead %}<p class="lead">{{ lead }}</p>{% endif %}
{% if keys %}<div class="keys">{% for key in keys %}<div><span class="soft">{{ key.name }}</span>
<b>{{ key.value }}</b><span class="soft">{{ key.note }}</span></div>{% endfor %}</div>{% endif %}
{% for section in sections %}<h2>{{ section.title }}</h2>
{% if section.text %}<p>{{ section.text }}</p>{% endif %}
{% if section.points %}<ul>{% for point in section.points %}<li>{{ point }}</li>{% endfor %}</ul>
{% endif %}
{% if section.table %}<div class="wide">
<table{% if section.header %} class="{{ section.cells }}"{% endif %}>
{% if section.header %}<thead><tr>{% for cell in section.header %}<th scope="col">{{ cell }}</th>
{% endfor %}</tr></thead>{% endif %}
{% for row in section.table %}<tr>{% for cell in row %}
{% if loop.first %}<th scope="row">{{ cell }}</th>{% else %}<td>{{ cell }}</td>{% endif %}
{% endfor %}</tr>{% endfor %}</table></div>{% endif %}
{% if section.video %}
<video controls loop muted playsinline preload="metadata" src="{{ section.video }}">
<a href="{{ section.video }}">{{ section.video }}</a></video>{% endif %}
{% if section.plots %}<div class="plots">{% for plot in section.plots %}
<figure><img alt="{{ plot.caption }}" src="{{ plot.uri }}"></figure>{% endfor %}</div>{% endif %}
{% for row in section.pictures %}
<div class="row" style="grid-template-columns: {{ row.columns }}">{% for picture in row.pictures %}
<figure><img alt="{{ picture.alt or picture.caption }}" src="{{ picture.uri }}">
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
        alt: what is to be seen, in words, for who does not see it; the caption by default.
    """

    uri: str
    caption: str
    width: float = 1.0
    alt: str = ""

    @classmethod
    def photo(cls, pixels: UInt8, caption: str, *, width: float = 1.0) -> Picture:
        """From (H, W) or (H, W, 3) RGB, compressed like a photo."""
        return cls(_uri("image/jpeg", encode_jpeg(pixels, JPEG_QUALITY)), caption, width)

    @classmethod
    def exact(cls, pixels: UInt8, caption: str, *, width: float = 1.0) -> Picture:
        """From (H, W, 3) RGB, without loss."""
        return cls(_uri("image/png", encode_png(pixels)), caption, width)

    @classmethod
    def plot(cls, figure: Figure, caption: str, *, width: float = 1.0, alt: str = "") -> Picture:
        """From a matplotlib figure, as vectors."""
        buffer = io.BytesIO()
        _lay_out(figure)
        figure.savefig(buffer, format="svg")
        return cls(_uri("image/svg+xml", buffer.getvalue()), caption, width, alt)

    @classmethod
    def painted(cls, figure: Figure, caption: str, *, alt: str = "") -> Picture:
        """From a matplotlib figure that shows a photo or many thousand points, as pixels."""
        buffer = io.BytesIO()
        quality = {"quality": PAINTED_QUALITY, "subsampling": 0}  # points are a few pixels wide
        _lay_out(figure)
        figure.savefig(buffer, format="jpeg", pil_kwargs=quality)
        return cls(_uri("image/jpeg", buffer.getvalue()), caption, alt=alt)


def _lay_out(figure: Figure) -> None:
    """Give the axes their places, if a layout does that.

    `savefig` would draw everything once more, to nowhere, for a figure that still has a layout.
    """
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
        figure.set_layout_engine(None)


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
        points: a list, before the table.
        header: names of the columns of the table.
        cells: what a table with a header holds: figures are set flush right.
    """

    title: str
    text: str = ""
    table: Sequence[Sequence[Any]] = ()
    plots: Sequence[Picture] = ()
    pictures: Sequence[PictureRow] = ()
    video: str = ""
    points: Sequence[str] = ()
    header: Sequence[str] = ()
    cells: Literal["figures", "words"] = "figures"


@dataclass(frozen=True)
class KeyFigure:
    """A number at the head of a page.

    Args:
        name: what it is.
        value: with its unit.
        note: what it means, or how sure it is.
    """

    name: str
    value: str
    note: str = ""


def link(text: str, address: str) -> Markup:
    """A cell that leads to another file: `address` is a relative path, as it is on disk."""
    from markupsafe import Markup

    return Markup('<a href="{}">{}</a>').format(quote(address), text)


def render_page(
    title: str,
    subtitle: str,
    sections: Sequence[Section],
    *,
    lead: str = "",
    keys: Sequence[KeyFigure] = (),
    width_px: int = WIDTH_PX,
) -> bytes:
    """The page as UTF-8 HTML; all text is escaped.

    Args:
        title: heading.
        subtitle: below it.
        sections: the body.
        lead: a sentence before everything else.
        keys: numbers after it.
        width_px: widest it becomes on a screen.
    """
    page = _template().render(
        title=title, subtitle=subtitle, sections=sections, lead=lead, keys=keys, width_px=width_px
    )
    return page.encode("utf-8", "surrogateescape")


@cache
def _template() -> Template:
    from jinja2 import Environment

    return Environment(autoescape=True, trim_blocks=True).from_string(_TEMPLATE)


def _uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
