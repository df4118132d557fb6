"""What a value of a browser's message can be: of a kind, finite, no longer than it has to be."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

# The longest text.
TEXT_LENGTH = 4096
# Coordinates and sizes beyond are no view of anything.
LARGEST = 1e12
# Lengths below point nowhere; the square of a quaternion's length is this near to 1.
SMALLEST, TURN_OFF = 1e-9, 0.05
# Pixels of a page, each way.
MOST_PX = 65_535
# How a PNG begins: signature, length and name of its header; then width and height.
# Source: PNG specification, third edition, sections 5.2 and 11.2.1.
PNG_START, PNG_SIZES = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", slice(16, 24)

Check = Callable[[Any], bool]


def is_text(value: Any) -> bool:
    """Text of a length that somebody types."""
    return isinstance(value, str) and len(value) <= TEXT_LENGTH


def is_number(value: Any) -> bool:
    """A finite number; true and false are none."""
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) <= LARGEST  # which NaN is not
    )


def is_count(value: Any) -> bool:
    """A whole number, not negative."""
    return is_number(value) and isinstance(value, int) and value >= 0


def is_pixels(value: Any) -> bool:
    """A number of pixels."""
    return is_count(value) and value <= MOST_PX


def vector(length: int) -> Check:
    """So many finite numbers."""
    return lambda value: (
        isinstance(value, list | tuple) and len(value) == length and all(map(is_number, value))
    )


def only(check: Check) -> Check:
    """A list of one such thing."""
    return lambda value: isinstance(value, list | tuple) and len(value) == 1 and check(value[0])


_is_vector3, _is_vector4 = vector(3), vector(4)


def is_direction(value: Any) -> bool:
    """A vector that points somewhere."""
    return _is_vector3(value) and any(abs(each) > SMALLEST for each in value)


def is_turn(value: Any) -> bool:
    """A quaternion of length 1, but for what rounding leaves."""
    return _is_vector4(value) and abs(sum(each * each for each in value) - 1) < TURN_OFF


def is_png_within(most_px: int) -> Check:
    """The bytes of a PNG whose header promises at most so many pixels; it is not decoded."""

    def check(value: Any) -> bool:
        if not isinstance(value, bytes) or not value.startswith(PNG_START):
            return False
        sizes = value[PNG_SIZES].ljust(8, b"\0")
        width, height = int.from_bytes(sizes[:4], "big"), int.from_bytes(sizes[4:], "big")
        return 0 < width * height <= most_px

    return check


def within(least: float, most: float) -> Check:
    """A number between these."""
    return lambda value: is_number(value) and least <= value <= most


def one_of(*choices: str) -> Check:
    """One of these words."""
    return lambda value: isinstance(value, str) and value in choices


def or_none(check: Check) -> Check:
    """That, or nothing."""
    return lambda value: value is None or check(value)
