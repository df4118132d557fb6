"""How well rows of rectified pairs meet: a picture to look at, and words."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.running.preflight import SourceCheck
from pseudolidar.running.products.rectified_pairs import folder_of_view, pairs_in
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.recorded import Frame


def draw_rows(path: Path, source: FrameSequence[Frame], looked: SourceCheck) -> None:
    """Draw the pairs that were looked at, all views of each, with rows drawn through both eyes.

    Args:
        path: the picture; none is written where no pair could be looked at.
        source: of rectified pairs, or of several views.
        looked: pairs and their matches.

    Raises:
        OutputError: the picture cannot be written.
    """
    from pseudolidar.evaluation.rows_picture import rows_picture

    panels = []
    for pair in looked.pairs:
        views = pairs_in(source.load(source.ids.index(pair.id)))
        for number, view in enumerate(views):
            title = f"{pair.id} {folder_of_view(number, len(views)).strip('/')}"
            if len(views) == 1:
                title += f": {row_text(pair.matches.row_difference_px[pair.inliers])}"
            panels.append(rows_picture(view.left, view.right, title=title, mask=view.mask))
    if panels:
        write_atomic(path, encode_png(np.vstack(panels)))


def row_text(rows_px: Float64) -> str:
    """How far rows are off, in words.

    Args:
        rows_px: (N,) row differences of matches.
    """
    if not len(rows_px):
        return "no matches"
    median, wide = np.median(np.abs(rows_px)), np.quantile(np.abs(rows_px), 0.95)
    return f"rows differ by {median:.2f} px (median), {wide:.2f} px (95 %), {len(rows_px)} matches"
