"""Who rides what: a person and a bike that are one thing in space, and two in the picture."""

from __future__ import annotations

from pseudolidar.structures.box import Detection

RIDERS = frozenset(("person", "pedestrian"))
RIDDEN = frozenset(("bicycle", "motorcycle", "motorbike", "horse"))
# The boxes of both share this part of the narrower one's columns, and of the lower one's rows.
ACROSS, UPRIGHT = 0.6, 0.2


def ride(one: Detection, other: Detection) -> bool:
    """Whether one of both may sit on the other: above it, and into it, in the picture."""
    names = one.name.lower(), other.name.lower()
    if names[0] in RIDDEN and names[1] in RIDERS:
        return ride(other, one)
    if names[0] not in RIDERS or names[1] not in RIDDEN:
        return False
    (left, top, right, bottom), (left_b, top_b, right_b, bottom_b) = one.box_px, other.box_px
    across = min(right, right_b) - max(left, left_b)
    upright = min(bottom, bottom_b) - max(top, top_b)
    sits = top < top_b and bottom < bottom_b + UPRIGHT * (bottom_b - top_b)
    narrower = min(right - left, right_b - left_b)
    return sits and across > ACROSS * narrower and upright > UPRIGHT * (bottom_b - top_b)
