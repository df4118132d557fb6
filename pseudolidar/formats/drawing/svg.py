"""Pages as SVG, with their size in millimetres."""

from __future__ import annotations

from xml.sax.saxutils import escape

from pseudolidar.formats.drawing.page import Page


def svg_bytes(page: Page) -> bytes:
    """The page as an SVG file."""
    size = f"{page.width_mm:g} {page.height_mm:g}"
    boxes = [f"M{x:.5f} {y:.5f}h{w:.5f}v{h:.5f}h{-w:.5f}z" for x, y, w, h in page.rectangles_mm]
    circles = [f'<circle cx="{x:.5f}" cy="{y:.5f}" r="{r:.5f}"/>' for x, y, r in page.circles_mm]
    texts = [
        f'<text x="{text.x_mm:g}" y="{text.y_mm:g}" font-size="{text.size_mm:g}" '
        f'text-anchor="{"middle" if text.centred else "start"}">{escape(text.words)}</text>'
        for text in page.texts
    ]
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{page.width_mm:g}mm" '
            f'height="{page.height_mm:g}mm" viewBox="0 0 {size}" font-family="Helvetica, Arial">',
            f"<title>{escape(page.title)}</title>",
            '<rect width="100%" height="100%" fill="white"/>',
            f'<path d="{"".join(boxes)}"/>',
            *circles,
            *texts,
            "</svg>\n",
        ]
    ).encode("ascii", "xmlcharrefreplace")
