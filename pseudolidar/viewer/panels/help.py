"""What is open, which keys there are, and what to do where nothing is open."""

from __future__ import annotations

from pseudolidar.viewer.live_reel import LiveReel
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.panels.time import escaped
from pseudolidar.viewer.reel import Reel
from pseudolidar.viewer.view import View

KEYS = """
| key | what it does |
|:---|:---|
"""
TIME_KEYS = """| K | play, pause |
| J, L | frame before, next frame |
| H, E | first, last frame |
"""
OTHER_KEYS = """| F | follow the rig, or stay with the map |
| B | show only one of the compared clouds, the next one |

Drag to turn, right-drag to move, scroll to come nearer. In the pictures: point at a pixel for its
depth, drag a box to measure what is in it, click on the box of an obstacle to choose it. Click a
point of the scene to know it; tab Points sets a box about it and tells how large and how flat what
it holds is.
"""
EMPTY = """
**Nothing is open.** End this (Ctrl-C in its terminal) and give it something to look at. A click
copies a line:
"""
EXAMPLES = {
    "pseudolidar view synthetic:street": "a rendered drive: no data are needed",
    "pseudolidar view KITTI/2011_09_26/2011_09_26_drive_0002_sync": "pairs of cameras",
    "pseudolidar view left.mp4": "a video, with right.mp4 beside it",
    "pseudolidar view out": "what a command wrote",
    "pseudolidar view out/map.ply out/trajectory.tum": "a map and the path through it",
    "pseudolidar view out/mesh.ply": "the surface that map --mesh makes",
}
# One click marks the line, and copies it where the browser lets a page do so.
LINE = """<div style="margin:4px 12px"><code title="click to copy" style="user-select:all;
cursor:copy;display:block;padding:4px 6px;border-radius:4px;background:#8882;font-size:0.85em;
overflow-wrap:anywhere" onclick="navigator.clipboard && navigator.clipboard.writeText(
this.textContent).then(() => this.title = 'copied')">{command}</code>
<small style="opacity:0.7">{what}</small></div>"""


class HelpPanel:
    """What to do.

    Args:
        view: what is looked at.
        opened: what that is.
    """

    def __init__(self, view: View, opened: Opened) -> None:
        view.gui.add_markdown(EMPTY if opened.is_empty else f"{listed(opened)}\n{keys(opened)}")
        if opened.is_empty:
            view.gui.add_html(examples())


def examples() -> str:
    """Commands to copy, with what they show."""
    return "".join(LINE.format(command=command, what=what) for command, what in EXAMPLES.items())


def keys(opened: Opened) -> str:
    """Keys and what they do; those of a time line where there is one."""
    has_time = bool(opened.reels) and not isinstance(opened.reels[0], LiveReel)
    return KEYS + (TIME_KEYS if has_time else "") + OTHER_KEYS


def listed(opened: Opened) -> str:
    """What is open, a line each."""
    lines = [f"- {escaped(reel.name)}{_frames_of(reel)}" for reel in opened.reels]
    for still in opened.stills:
        lines.append(f"- {escaped(still.name)}: {still.amount}")
    return "\n".join(lines)


def _frames_of(reel: Reel) -> str:
    """How many frames there are; nothing where nobody knows."""
    count = reel.frames if isinstance(reel, LiveReel) else len(reel.ids)
    return "" if count is None else f": {count} frames"
