"""What tells the picture of a search from any other PNG: it may be drawn anew, others not."""

from __future__ import annotations

# Of the PNG's text chunk `Title`, which lies before the pixels.
TITLE = "pseudolidar tune: trials"


def is_picture_of_trials(head: bytes) -> bool:
    """Whether a file that begins so is one."""
    return head.startswith(b"\x89PNG") and TITLE.encode() in head
