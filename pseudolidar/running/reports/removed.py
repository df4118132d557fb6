"""What cleaning removed, in words and in colours."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from pseudolidar.running.reports.samples import FrameSample
from pseudolidar.structures.arrays import UInt8

# Figures of a frame that count removed pixels begin so.
REMOVED = "pixels_removed_"
# Pixels that cleaning kept.
KEPT = "pixels_kept_by_cleaning"
# By reason, in the order of `stereo.filters.clean.REASONS`: words, and the colour in pictures.
WORDS = {
    "sky": "sky",
    "near_noise": "near-lens noise",
    "flying": "flying pixels",
    "far_ghosts": "far ghosts",
    "speckle": "speckle",
    "isolated": "isolated points",
}
COLOURS: Mapping[str, tuple[str, tuple[int, int, int]]] = {
    "sky": ("cyan", (0, 200, 255)),
    "near_noise": ("magenta", (255, 0, 255)),
    "flying": ("orange", (255, 140, 0)),
    "far_ghosts": ("yellow", (255, 255, 0)),
    "speckle": ("green", (0, 230, 0)),
    "isolated": ("white", (255, 255, 255)),
}
# Photos are darkened under the colours.
DARKENED = 0.6


def removed_lines(figures: Mapping[str, Mapping[str, float]]) -> list[str]:
    """`removed: 1.2 % flying pixels, ...` of the matched pixels, or nothing where all were kept.

    Args:
        figures: mean, least and largest value of each figure of the frames.
    """
    shares = removed_shares({name: figure["mean"] for name, figure in figures.items()})
    parts = [f"{share:.2%} {what}" for what, share in shares.items()]
    return [f"removed: {', '.join(parts)}"] if parts else []


def removed_shares(counts: Mapping[str, float]) -> dict[str, float]:
    """Share of the matched pixels by the reason in words; empty where cleaning was not counted."""
    removed = {name: counts[REMOVED + name] for name in WORDS if REMOVED + name in counts}
    if not removed or KEPT not in counts:
        return {}
    matched = max(counts[KEPT] + sum(removed.values()), 1.0)
    return {WORDS[name]: count / matched for name, count in removed.items()}


def removed_picture(photo: UInt8, removed: UInt8) -> UInt8:
    """(h, w, 3) RGB: the photo darkened, with removed pixels in the colour of their reason."""
    coloured = np.stack([photo] * 3, axis=-1) if photo.ndim == 2 else photo
    palette = np.array([(0, 0, 0), *(colour for _, colour in COLOURS.values())], np.uint8)
    dark = (DARKENED * coloured).astype(np.uint8)
    return np.where((removed > 0)[..., None], palette[removed], dark)


def colours_text(samples: Iterable[FrameSample]) -> str:
    """What the colours of `removed_picture` mean, with a space at the end; empty without any."""
    if not any(sample.removed.any() for sample in samples):
        return ""
    named = ", ".join(f"{WORDS[name]} {colour}" for name, (colour, _) in COLOURS.items())
    return f"Removed pixels by reason: {named}. "
