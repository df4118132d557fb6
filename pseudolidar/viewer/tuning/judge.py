"""What the shown frame is worth, and how it differs from what was kept: told in the background."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pseudolidar.evaluation.pictures import disparity_picture, turbo
from pseudolidar.evaluation.preview_picture import Panel, labelled, resized
from pseudolidar.running.products.converted import Converted
from pseudolidar.structures.arrays import Float32, Image, UInt8
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.viewer.latest import Latest
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.tuning.figures import FrameFigures, Reference, figures_of

# Disparity that is red, as `pictures.RED_SHARE`, and a change that is red, px.
RED_SHARE, RED_CHANGE_PX = 0.98, 3.0
# Colours of pixels that only the present and only the kept settings have.
GAINED, LOST = (120, 230, 120), (230, 90, 230)
# Width of the pictures on the page, px.
WIDE_PX = 480


@dataclass(frozen=True, eq=False)
class Judged:
    """What there is to be said of a moment.

    Args:
        moment: which.
        rows: name and figures, of the kept settings too where these are compared; none of a frame
            that cannot be matched.
        picture: both disparities and their difference; None where nothing is compared.
    """

    moment: Moment
    rows: tuple[tuple[str, FrameFigures], ...]
    picture: UInt8 | None = None


class Judge:
    """Judges the latest of the moments that it is handed.

    Args:
        told: is told, by a thread of its own.
        makes_way: whether frames follow one another, of which it is enough to judge some.
    """

    def __init__(
        self, told: Callable[[Judged], None], *, makes_way: Callable[[], bool] = bool
    ) -> None:
        self._told = told
        self._latest: Latest[Moment] = Latest(
            self._judge, name="viewer-figures", makes_way=makes_way
        )
        self._known: tuple[Image, Reference | None] | None = None
        self.ask, self.close = self._latest.ask, self._latest.close

    def _judge(self, moment: Moment, _overtaken: Callable[[], bool]) -> None:
        converted = moment.converted
        if converted is None or converted.disparity is None:
            self._told(Judged(moment, ()))
            return
        frame = converted.frame
        assert isinstance(frame, StereoFrame)
        reference = self._reference(frame)
        if moment.compared is None:
            self._told(Judged(moment, (("now", figures_of(converted, reference)),)))
            return
        kept, now = moment.compared
        rows = tuple((name, figures_of(one, reference)) for name, one in (("A", kept), ("B", now)))
        self._told(Judged(moment, rows, compared_picture(kept, now)))

    def _reference(self, frame: StereoFrame) -> Reference | None:
        """What the frame is compared with; of the last one it is known already."""
        if self._known is None or self._known[0] is not frame.left:
            self._known = frame.left, Reference.of(frame)
        return self._known[1]


def compared_picture(kept: Converted, now: Converted) -> UInt8:
    """(H, W, 3) RGB: both disparities one over the other, and where they differ."""
    assert kept.disparity is not None
    assert now.disparity is not None
    a, b = kept.disparity.values, now.disparity.values
    known = np.concatenate([values[np.isfinite(values)] for values in (a, b)])
    red_px = float(np.quantile(known, RED_SHARE)) if len(known) else 1.0
    pictures = (
        ("A, kept", disparity_picture(a, red_px)),
        ("B, now", disparity_picture(b, red_px)),
        ("B - A: green gained, pink lost, red 3 px", difference_picture(a, b)),
    )
    return np.vstack([labelled(_narrow(pixels), name) for name, pixels in pictures])


def difference_picture(kept: Float32, now: Float32) -> UInt8:
    """(H, W, 3) RGB: blue where both agree, red where they are 3 px apart.

    What only one of them has is green where it was gained, and pink where it was lost.
    """
    picture = turbo(np.abs(now - kept), 0.0, RED_CHANGE_PX)
    has_kept, has_now = np.isfinite(kept), np.isfinite(now)
    picture[has_now & ~has_kept] = GAINED
    picture[has_kept & ~has_now] = LOST
    return picture


def _narrow(picture: UInt8) -> UInt8:
    height, width = picture.shape[:2]
    return resized(Panel(picture, "", exact=True), (WIDE_PX, round(height * WIDE_PX / width)))
