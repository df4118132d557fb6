"""`odometry.mp4`: what odometry looked at, frame by frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.evaluation.captions import write_on
from pseudolidar.evaluation.pictures import NOTHING, disparity_picture
from pseudolidar.evaluation.preview_picture import CAPTION_PX, Panel, even, labelled, resized
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.pictures.image import encode_jpeg, read_image
from pseudolidar.mapping.registered import Registered
from pseudolidar.mapping.tracks_drawn import tracks_drawn
from pseudolidar.running.folder import inside
from pseudolidar.running.mapped.stored import WORK_FOLDER, MatchedFrame, read_stored
from pseudolidar.running.products.preview import JPEG_QUALITY, write_film
from pseudolidar.running.run import Run
from pseudolidar.sources.source import FrameSource
from pseudolidar.structures.arrays import UInt8

ODOMETRY_FILM = "odometry.mp4"
# Wider pictures are made smaller, px.
WIDEST_PX = 1280


class OdometryFilm:
    """Draws frames as odometry goes along them; the film is made of the drawings at the end.

    Args:
        folder: output folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._near_px: float | None = None

    def add(self, matched: MatchedFrame, registered: Registered, first: str) -> None:
        """Draw the next frame.

        Args:
            matched: the frame.
            registered: what odometry told of it.
            first: id of the first frame of all, whose disparities are stored.

        Raises:
            OutputError: the disk is full or gone.
            ImageUnreadable: somebody changed the file of disparities.
        """
        if self._near_px is None:
            self._near_px = self._scale(first)
        picture = odometry_picture(matched, registered, near_px=self._near_px)
        path = inside(self._folder, drawing_name(matched.frame.id))
        write_atomic(path, encode_jpeg(picture, JPEG_QUALITY))

    def _scale(self, first: str) -> float:
        """One for all, in a run that goes on too: of the first frame."""
        disparity = read_stored(self._folder, first)
        known = disparity.values[disparity.valid]
        return float(np.quantile(known, 0.99)) if len(known) else 1.0

    def finish(self, run: Run, source: FrameSource) -> Path:
        """Put the drawings together, at the pace of the frames.

        Raises:
            OutputError: the disk is full or gone; then there is no film.
        """

        def picture(name: str) -> UInt8:
            path = inside(run.folder, drawing_name(name))
            return np.asarray(read_image(path).pixels, np.uint8)

        write_film(run, source, ODOMETRY_FILM, picture)
        return run.folder / ODOMETRY_FILM


def drawing_name(frame_id: str) -> str:
    """Name of the drawing of a frame in the output folder."""
    return f"{WORK_FOLDER}/{frame_id}.tracks.jpg"


def odometry_picture(matched: MatchedFrame, registered: Registered, *, near_px: float) -> UInt8:
    """(H, W, 3) RGB of even size: points with their ways, above the disparities; a line in words.

    Args:
        matched: the frame.
        registered: what odometry told of it.
        near_px: disparities of this and more are red.
    """
    drawn = tracks_drawn(matched.frame, registered.state)
    height, width = drawn.shape[:2]
    wide = min(width, WIDEST_PX)
    size_px = (wide, max(1, round(height * wide / width)))
    disparity = Panel(disparity_picture(matched.disparity.values, near_px), "disparity", exact=True)
    bar = np.full((CAPTION_PX, wide, 3), NOTHING, np.uint8)
    write_on(bar, f"{matched.frame.id}   {checks_in_words(registered)}", (10, 23), 0.6)
    below = labelled(resized(disparity, size_px), disparity.label)
    return even(np.vstack([resized(Panel(drawn, ""), size_px), below, bar]))


def checks_in_words(registered: Registered) -> str:
    """Who was asked about the step, and what they said."""
    check = registered.check
    if registered.sensors == "scan" and check is None:
        return f"by the scan alone: {registered.state.why}".removesuffix(": ")
    if check is None or check.asked == "none":
        return "goes on as before" if registered.state.status == "ok" else registered.state.status
    if check.wrong:
        apart = f"{check.apart_m:.2f} m and {np.degrees(check.apart_rad):.2f} deg"
        return f"the step disagrees with the {check.asked}: another one is taken, {apart} from it"
    return f"the step agrees with the {check.asked}"
