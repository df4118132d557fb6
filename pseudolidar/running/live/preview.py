"""`live.jpg`: what a live run sees and makes at the moment, renewed about once a second.

Drawing has a thread of its own, so that no frame waits for it; what is newer than the last picture
gives way to what is newer still. Image viewers that look at the file again show a film.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from pseudolidar.errors import PseudolidarError, printable
from pseudolidar.evaluation.captions import write_on
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.pictures.image import encode_jpeg
from pseudolidar.geometry.grey import rgb_of
from pseudolidar.running.live.newest import Newest
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.products.preview import JPEG_QUALITY, PreviewArtist, Scales
from pseudolidar.sources.capture.eyes import Eyes
from pseudolidar.sources.capture.live_pairs import Wanted
from pseudolidar.sources.capture.shots import ShotPair
from pseudolidar.sources.video.packing import halved_px
from pseudolidar.structures.arrays import Image, UInt8

_log = logging.getLogger(__name__)
Shown = TypeVar("Shown")
LIVE_NAME = "live.jpg"
# Between two pictures. Drawing one takes 31 ms of a core.
PAUSE_S = 1.0
# Width of an eye where pairs are only saved; height of the bar with words below both, px.
EYE_PX, BAR_PX = 640, 30
WORDS_PX, WORDS_SIZE = (8, 20), 0.4


class LivePreview(Newest[Shown]):
    """Draws the newest of what it is shown into a file.

    Args:
        path: of the picture.
        draw: to the bytes of the file.
        pause_s: between two pictures.
    """

    def __init__(
        self, path: Path, draw: Callable[[Shown], bytes], *, pause_s: float = PAUSE_S
    ) -> None:
        super().__init__("preview", self._write, idle_s=pause_s / 10)
        self._path, self._draw, self._pause_s = path, draw, pause_s

    def _write(self, what: Shown) -> float | None:
        try:
            write_atomic(self._path, self._draw(what))
        except PseudolidarError as error:  # a run is worth more than its preview
            _log.warning("no more previews: %s", printable(str(error)))
            return None
        return self._pause_s


class CloudPicture:
    """Draws a frame as the preview of `convert` does: photo, disparity, and the cloud from above.

    Scales are those of the first frame, so that colours and lengths mean the same in all.
    """

    def __init__(self) -> None:
        self._artist: PreviewArtist | None = None

    def __call__(self, converted: Converted) -> bytes:
        """The picture as a JPEG."""
        if self._artist is None:
            self._artist = PreviewArtist(Scales.of(converted), "photo")
        return self._artist.draw(converted)


@dataclass(frozen=True)
class PairPicture:
    """Draws a pair as the cameras take it, both eyes side by side, with words below.

    Args:
        eyes: how left and right are found.
        words: what there is to say at the moment.
    """

    eyes: Eyes
    words: Callable[[], str] | None = None

    def __call__(self, shots: ShotPair) -> bytes:
        """The picture as a JPEG."""
        whole_px, layout = shots.shots[0].size_px, self.eyes.layout
        wide_px, _ = whole_px if layout is None else halved_px(whole_px, layout)
        small = replace(self.eyes, scale=min(1.0, EYE_PX / wide_px))
        left, right, _ = small.pair(shots)
        eyes = [_labelled(pixels, name) for pixels, name in ((left, "left"), (right, "right"))]
        height = max(len(eye) for eye in eyes)
        row = np.hstack([np.pad(eye, ((0, height - len(eye)), (0, 0), (0, 0))) for eye in eyes])
        bar = np.zeros((BAR_PX, row.shape[1], 3), np.uint8)
        if self.words is not None:
            write_on(bar, self.words(), WORDS_PX, WORDS_SIZE)
        return encode_jpeg(np.vstack([row, bar]), JPEG_QUALITY)


@dataclass(frozen=True)
class ShownWhenAsked:
    """Shows each pair that it is asked about.

    Args:
        wanted: which pairs are saved.
        preview: where all of them are shown.
    """

    wanted: Wanted
    preview: LivePreview[ShotPair]

    def __call__(self, shots: ShotPair) -> bool:
        """Whether to save it."""
        wanted = self.wanted(shots)
        self.preview.show(shots.time_ns, shots)
        return wanted


def _labelled(pixels: Image, name: str) -> UInt8:
    """A copy in colours of 8 bits, with its name in the corner."""
    eight = np.asarray(pixels if pixels.dtype == np.uint8 else pixels >> 8, np.uint8)
    labelled = rgb_of(eight).copy()
    write_on(labelled, name, (8, 18))
    return labelled
