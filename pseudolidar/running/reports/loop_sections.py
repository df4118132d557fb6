"""Loops in the report of a map: two pictures of each, with the points that agree, and residuals."""

from __future__ import annotations

import numpy as np

from pseudolidar.evaluation.page import Picture, PictureRow, Section
from pseudolidar.geometry.grey import rgb_of
from pseudolidar.mapping.tracks_drawn import RIGHT_RGB
from pseudolidar.running.mapped.walked import Walked
from pseudolidar.running.reports.numbers import counted, percent
from pseudolidar.running.reports.samples import photo_of
from pseudolidar.sources.source import FrameSource
from pseudolidar.structures.arrays import Float32, UInt8
from pseudolidar.structures.loop import LoopClosure

# Loops that are shown in pictures, evenly over all; the table has every one.
MOST_PICTURED = 8
RADIUS_PX = 4
HEADER = (
    "frames", "points", "of matches", "residual, px", "overlap", "both ways, m", "both ways, deg",
    "path corrected, m", "path corrected, deg",
)  # fmt: skip


def loop_sections(walked: Walked, source: FrameSource) -> list[Section]:
    """Every loop with its numbers, some with their pictures; none where there are none.

    Args:
        walked: the path with its loops.
        source: the frames.

    Raises:
        PseudolidarError: a picture cannot be read again.
    """
    every = [*walked.loops, *walked.dropped]
    if not every and not walked.refused:
        return []
    refused = ", ".join(f"{n} {why.replace('_', ' ')}" for why, n in sorted(walked.refused.items()))
    text = f"{counted(len(walked.loops), 'loop')} closed, {len(walked.dropped)} dropped by the rest"
    rows = [_row(loop, walked) for loop in walked.loops]
    rows += [_row(loop, walked, " (dropped)") for loop in walked.dropped]
    step = max(1, -(-len(every) // MOST_PICTURED))
    pictures = [_pictures(loop, walked, source) for loop in every[::step]]
    text += f"; candidates refused: {refused}." if refused else "."
    return [Section("Loops", text, rows, pictures=pictures, header=HEADER)]


def _row(loop: LoopClosure, walked: Walked, said: str = "") -> tuple[str, ...]:
    first, last = (walked.names[end.index] for end in (loop.earlier, loop.later))
    return (
        f"{first} - {last}{said}",
        str(loop.inliers),
        str(loop.matches),
        f"{loop.residual_px:.2f}",
        percent(loop.overlap),
        f"{loop.both_ways_m:.3f}",
        f"{loop.both_ways_deg:.2f}",
        f"{loop.correction_m:.2f}",
        f"{loop.correction_deg:.2f}",
    )


def _pictures(loop: LoopClosure, walked: Walked, source: FrameSource) -> PictureRow:
    ends = ((loop.earlier, loop.uv_earlier), (loop.later, loop.uv_later))
    names = [walked.names[end.index] for end, _ in ends]
    return PictureRow(
        tuple(
            Picture.photo(
                _marked(photo_of(source.load(source.ids.index(name))), uv),
                f"{name}: {len(uv)} points agree",
            )
            for name, (_, uv) in zip(names, ends, strict=True)
        )
    )


def _marked(photo: UInt8, uv: Float32) -> UInt8:
    import cv2

    picture = np.ascontiguousarray(rgb_of(photo))
    for u, v in np.rint(uv).astype(int).tolist():
        cv2.circle(picture, (u, v), RADIUS_PX, RIGHT_RGB.tolist(), 1, cv2.LINE_AA)
    return picture
