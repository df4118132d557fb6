"""Pages as PDF 1.4: vectors, so that a printer's own resolution is the only limit."""

from __future__ import annotations

import itertools

import numpy as np

from pseudolidar.formats.drawing.page import Page, Text

POINTS_PER_MM = 72 / 25.4
# Handles of the four curves that look like a circle. Source: Riskus, Approximation of a cubic
# Bezier curve by circular arcs, 2006: off by 0.03 % of the radius.
KAPPA = 0.5522847498
# Mean width of Helvetica's characters, in sizes of the type: to centre short texts.
WIDTH_OF_CHARACTER = 0.52


def pdf_bytes(page: Page) -> bytes:
    """The page as a PDF file; the same page gives the same bytes."""
    width, height = page.width_mm * POINTS_PER_MM, page.height_mm * POINTS_PER_MM
    content = _content(page).encode("ascii")
    title = _escaped(page.title)
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] /Contents 4 0 R "
        "/Resources << /Font << /F1 5 0 R >> >> >>".encode("ascii"),
        f"<< /Length {len(content)} >>\nstream\n".encode("ascii") + content + b"\nendstream",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
        f"<< /Title ({title}) >>".encode("ascii"),
    ]
    return _file(objects)


def _content(page: Page) -> str:
    """Drawing commands, in millimetres with y down."""
    parts = [
        f"{POINTS_PER_MM:.9f} 0 0 {-POINTS_PER_MM:.9f} 0 {page.height_mm * POINTS_PER_MM:.6f} cm"
    ]
    # One path: shapes that touch leave no hairline between them.
    parts += [" ".join(f"{value:.5f}" for value in box) + " re" for box in page.rectangles_mm]
    parts += [_circle(*circle) for circle in page.circles_mm.tolist()]
    if len(page.rectangles_mm) or len(page.circles_mm):
        parts.append("f")
    parts += [_text(text) for text in page.texts]
    return "\n".join(parts)


def _circle(x: float, y: float, radius: float) -> str:
    """Four curves, from the right around."""
    turns = np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 0]], float)
    parts = [f"{x + radius:.5f} {y:.5f} m"]
    for begin, end in itertools.pairwise(turns):
        handles = [begin + KAPPA * end, end + KAPPA * begin, end]
        numbers = [f"{x + radius * u:.5f} {y + radius * v:.5f}" for u, v in handles]
        parts.append(" ".join(numbers) + " c")
    return " ".join(parts) + " h"


def _text(text: Text) -> str:
    width = WIDTH_OF_CHARACTER * text.size_mm * len(text.words)
    x = text.x_mm - width / 2 if text.centred else text.x_mm
    return (
        f"BT /F1 {text.size_mm:.3f} Tf 1 0 0 -1 {x:.4f} {text.y_mm:.4f} Tm "
        f"({_escaped(text.words)}) Tj ET"
    )


def _escaped(words: str) -> str:
    plain = words.encode("ascii", "replace").decode()
    return plain.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")


def _file(objects: list[bytes]) -> bytes:
    """Objects with the table of where each is."""
    data, places = b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n", []
    for number, body in enumerate(objects, 1):
        places.append(len(data))
        data += f"{number} 0 obj\n".encode() + body + b"\nendobj\n"
    table = "".join(f"{place:010d} 00000 n \n" for place in places)
    count = len(objects) + 1
    return data + (
        f"xref\n0 {count}\n0000000000 65535 f \n{table}trailer\n<< /Size {count} /Root 1 0 R "
        f"/Info {len(objects)} 0 R >>\nstartxref\n{len(data)}\n%%EOF\n"
    ).encode("ascii")
