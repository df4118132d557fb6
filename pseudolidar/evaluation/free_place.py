"""Places for labels in a picture, so that none covers another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

Rectangle = tuple[int, int, int, int]  # left, top, right, bottom, px; right and bottom beyond it

# A label is moved by this share of its height at a time, up to so many times.
STEP, MOST_STEPS = 0.5, 12
GAP_PX = 2


class Places:
    """Gives labels their places one after the other; those that come first choose first.

    Args:
        size_px: (width, height) of the picture.
        spared: what they had better not cover, as long as there is room elsewhere.
    """

    def __init__(self, size_px: tuple[int, int], spared: Sequence[Rectangle] = ()) -> None:
        self._width, self._height = size_px
        self._spared = tuple(spared)
        self._taken: list[Rectangle] = []

    def take(self, size_px: tuple[int, int], beside: Rectangle) -> tuple[int, int] | None:
        """Upper left corner of a label of that size near something, or None if all is taken.

        Args:
            size_px: (width, height) of the label.
            beside: what it belongs to.
        """
        for others in ((*self._taken, *self._spared), self._taken):
            for left, top in self._candidates(size_px, beside):
                mine = left, top, left + size_px[0], top + size_px[1]
                if not any(_overlap(mine, other) for other in others):
                    self._taken.append(mine)
                    return left, top
        return None

    def _candidates(self, size_px: tuple[int, int], beside: Rectangle) -> Iterator[tuple[int, int]]:
        """Above, below, right and left of it; then farther and farther above and below."""
        width, height = size_px
        left, top, right, bottom = beside
        middle = (left + right - width) // 2
        places = [(left, top - height - GAP_PX), (left, bottom + GAP_PX)]
        places += [(right + GAP_PX, top), (left - width - GAP_PX, top)]
        for step in range(1, MOST_STEPS + 1):
            far = round(step * STEP * height)
            for x in (left, middle, right - width // 2, left - width // 2):
                places += [(x, top - height - GAP_PX - far), (x, bottom + GAP_PX + far)]
        for x, y in places:
            at_x = min(max(x, 0), self._width - width)
            at_y = min(max(y, 0), self._height - height)
            if at_x >= 0 and at_y >= 0:
                yield at_x, at_y


def _overlap(a: Rectangle, b: Rectangle) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
