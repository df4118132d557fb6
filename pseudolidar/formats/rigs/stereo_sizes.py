"""The sizes of the pictures of both eyes, as calibration files say them."""

from __future__ import annotations

from pseudolidar.errors import CalibrationSyntax
from pseudolidar.formats.rigs.placed import Node
from pseudolidar.formats.rigs.stereo_fields import StereoFields

Sizes = tuple[tuple[int, int], tuple[int, int]]


def sizes_of(fields: StereoFields, size_px: tuple[int, int] | None) -> Sizes:
    """(width, height) of each eye that the files say, else those of the pictures.

    Raises:
        CalibrationField: nobody knows.
    """
    left, right = (_own_size(fields, eye) for eye in (0, 1))
    common = left or right or _common_size(fields) or size_px
    if common is None:
        raise fields.lacks("image size", "image_width and image_height")
    return left or common, right or common


def _own_size(fields: StereoFields, eye: int | None) -> tuple[int, int] | None:
    width, height = (fields.node(side, eye) for side in ("width", "height"))
    return None if width is None or height is None else (_whole(width), _whole(height))


def _common_size(fields: StereoFields) -> tuple[int, int] | None:
    both = fields.node("size")
    if both is not None and isinstance(both.value, tuple) and len(both.value) == 2:
        width, height = (_whole(side) for side in both.value)
        return width, height
    return _own_size(fields, None)


def _whole(node: Node) -> int:
    if isinstance(node.value, bool) or not isinstance(node.value, int) or node.value < 1:
        raise CalibrationSyntax(
            f"{node.value!r}"[:40],
            want="a whole number of pixels, 1 or more",
            path=node.path,
            where=node.where,
        )
    return node.value
