"""Play, pause, step, scrub, and how fast."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from pseudolidar.errors import printable
from pseudolidar.viewer.controls import set_value
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.timeline import SPEEDS
from pseudolidar.viewer.view import View

if TYPE_CHECKING:
    from viser._messages import HotkeyKey

NORMAL = "1x"


class TimePanel:
    """Controls of the timeline, and which frame is shown.

    Args:
        view: what is looked at.
    """

    def __init__(self, view: View) -> None:
        self._view, gui = view, view.gui
        last = view.timeline.last
        self._frame = gui.add_slider(
            "Frame", min=0, max=max(last, 1), step=1, initial_value=0, disabled=last == 0
        )
        self._buttons = gui.add_button_group("", ("|<", "<", "Play", ">", ">|"))
        self._speed = gui.add_dropdown(
            "Speed", tuple(_named(speed) for speed in SPEEDS), initial_value=NORMAL
        )
        self._loop = gui.add_checkbox("Loop", initial_value=True)
        self._text = gui.add_markdown("*The first frame is made ready ...*")
        self._frame.on_update(lambda _: self._scrub())
        self._buttons.on_click(lambda _: self._press(self._buttons.value))
        self._speed.on_update(lambda _: view.set_speed(float(self._speed.value.rstrip("x"))))
        self._loop.on_update(lambda _: self._set_loop())
        self._hotkeys()
        view.on_shown(self._show)

    def _hotkeys(self) -> None:
        keys: tuple[tuple[str, HotkeyKey, str], ...] = (
            ("Play or pause", "K", "Play"),
            ("Next frame", "L", ">"),
            ("Frame before", "J", "<"),
            ("First frame", "H", "|<"),
            ("Last frame", "E", ">|"),
        )
        for label, key, pressed in keys:
            self._view.gui.add_command(label, hotkey=key).on_trigger(self._pressing(pressed))

    def _pressing(self, button: str) -> Callable[[object], None]:
        return lambda _event: self._press(button)

    def _press(self, button: str) -> None:
        view = self._view
        match button:
            case "Play":
                view.play(playing=not view.timeline.playing)
            case "<":
                view.step(-1)
            case ">":
                view.step(1)
            case "|<":
                view.jump(0)
            case ">|":
                view.jump(view.timeline.last)

    def _scrub(self) -> None:
        if self._frame.value != self._view.timeline.index:
            self._view.jump(int(self._frame.value))

    def _set_loop(self) -> None:
        self._view.timeline.loop = self._loop.value

    def _show(self, moment: Moment) -> None:
        timeline = self._view.timeline
        set_value(self._frame, moment.index)
        seconds = timeline.times_s[moment.index]
        said = (
            f"**{moment.index + 1} / {len(timeline)}** &nbsp; {escaped(moment.id)} &nbsp; "
            f"{seconds:.2f} s"
        )
        points = sum(map(len, moment.clouds.values()))
        fault = f"\n\n{escaped(moment.fault)}" if moment.fault else ""
        self._text.content = f"{said} &nbsp; {points:,} points{fault}"


def _named(speed: float) -> str:
    return f"{speed:g}x"


def escaped(text: str) -> str:
    """Text of files and users as Markdown that means nothing but itself."""
    marks = str.maketrans({mark: f"\\{mark}" for mark in "\\`*_{}[]()#+-.!|~$^"})
    plain = printable(" ".join(text.split())).translate(marks)
    return plain.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
