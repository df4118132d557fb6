"""The colour detector, set by a click on the thing: what it finds, how wide and how far that is."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from pseudolidar.errors import PseudolidarError
from pseudolidar.obstacles.colour import Colour
from pseudolidar.obstacles.hues import NAMED, Hues
from pseudolidar.running.reports.samples import photo_of
from pseudolidar.structures.arrays import UInt8
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.viewer.controls import set_value
from pseudolidar.viewer.latest import Latest
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.panels.picture import PicturePanel
from pseudolidar.viewer.panels.time import escaped
from pseudolidar.viewer.panels.tune_part import KnobControl
from pseudolidar.viewer.pictures import Layer
from pseudolidar.viewer.tuning.hue import Found, colour_at, flag_of, found_by, marked
from pseudolidar.viewer.tuning.knobs import Knob, knobs_of
from pseudolidar.viewer.view import View

LAYER = "colour"
OWN = "own"
HINT = "*Switch on, then click the thing in the left picture, or choose a colour.*"


class HuePanel:
    """Hues to choose, and the things that have them.

    Args:
        view: what is looked at.
        picture: is clicked into, and shows what is found.
    """

    def __init__(self, view: View, picture: PicturePanel) -> None:
        self._view, self._picture = view, picture
        self.colour = Colour(Hues(*NAMED["red"]))
        self._found: tuple[Moment, Found] | None = None
        self._lock, self._syncing = threading.RLock(), False
        self._latest: Latest[Colour] = Latest(self._look, name="viewer-hue")
        view.on_stop(self._latest.close)
        gui = view.gui
        with gui.add_folder("Colour detector", expand_by_default=False):
            self._on = gui.add_checkbox("Pick by a click", initial_value=False)
            self._text = gui.add_markdown(HINT)
            self._named = gui.add_dropdown("Colour", (OWN, *NAMED), initial_value="red")
            first, last = self.colour.hues.from_deg, self.colour.hues.to_deg
            self._ends = [
                gui.add_slider(label, 0.0, 360.0, 1.0, at)
                for label, at in (("from hue, °", first), ("to hue, °", last))
            ]
            self._knobs = [
                KnobControl(gui, knob, getattr(self.colour, knob.name), self._turn)
                for knob in knobs_of(Colour)
            ]
        self._on.on_update(lambda _: self._ask())
        self._named.on_update(lambda _: self._take_name())
        for end in self._ends:
            end.on_update(lambda _: self._take_ends())
        picture.on_pick(self.pick)
        picture.add_layer(LAYER, Layer(self._there, self._draw))
        self._sync()
        view.on_shown(self._shown)

    def pick(self, x: float, y: float) -> None:
        """Take the colour about a place in the left picture, px."""
        moment = self._view.moment
        if not self._on.value or moment is None or moment.converted is None:
            return
        frame = moment.converted.frame
        assert isinstance(frame, StereoFrame)  # others cannot be tuned
        colour = colour_at(frame.left, x, y)
        if colour is None:
            self._text.content = "No colour there: grey, or too dark."
            return
        self.set(
            replace(
                self.colour,
                hues=colour.hues,
                least_saturation=colour.least_saturation,
                least_value=colour.least_value,
            )
        )

    def set(self, colour: Colour) -> None:
        """Look for another colour."""
        with self._lock:
            self.colour = colour
            self._sync()
            self._ask()

    def _change(self, change: Callable[[], Colour]) -> None:
        with self._lock:
            if self._syncing:
                return
            try:
                colour = change()
            except PseudolidarError as refusal:
                self._text.content = escaped(str(refusal))
                return
            if colour != self.colour:
                self.set(colour)

    def _turn(self, knob: Knob, value: Any) -> None:
        self._change(lambda: replace(self.colour, **{knob.name: knob.taken(value)}))

    def _take_name(self) -> None:
        name = self._named.value
        if name != OWN:
            self._change(lambda: replace(self.colour, hues=Hues(*NAMED[name])))

    def _take_ends(self) -> None:
        low, high = (float(end.value) for end in self._ends)
        if low != high:
            self._change(lambda: replace(self.colour, hues=Hues(low, high)))

    def _sync(self) -> None:
        """Let the controls show the colour."""
        self._syncing = True
        try:
            hues = self.colour.hues
            for end, value in zip(self._ends, (hues.from_deg, hues.to_deg), strict=True):
                set_value(end, value)
            names = [name for name, ends in NAMED.items() if Hues(*ends) == hues]
            set_value(self._named, names[0] if names else OWN)
            for one in self._knobs:
                one.show(visible=True, value=getattr(self.colour, one.knob.name))
        finally:
            self._syncing = False

    def _ask(self) -> None:
        with self._lock:
            if self._on.value:
                self._latest.ask(self.colour)
                return
            self._found = None
            self._text.content = HINT
        self._view.redraw()

    def _shown(self, moment: Moment) -> None:
        """Look again in another frame, and in one that was matched anew."""
        new = self._found is None or self._found[0] is not moment
        if self._on.value and new and moment.matched_at == 1:
            self._latest.ask(self.colour)

    def _look(self, colour: Colour, _overtaken: Callable[[], bool]) -> None:
        moment, found = self._view.moment, None
        try:
            seen = None if moment is None else self._picture.seen(moment)
            found = None if seen is None else found_by(colour, seen.sight)
            told = "Nothing can be measured here." if found is None else _told(colour, found)
        except PseudolidarError as refusal:
            told = escaped(str(refusal))
        with self._lock:
            if not self._on.value:  # it was switched off meanwhile
                return
            self._text.content = told
            if moment is None or found is None:
                return
            self._found = moment, found
        self._view.redraw()

    def _there(self, moment: Moment) -> bool:
        return self._found is not None and self._found[0].id == moment.id

    def _draw(self, moment: Moment) -> UInt8:
        assert moment.converted is not None
        photo, found = photo_of(moment.converted.frame), self._found
        return photo if found is None else marked(photo, found[1].mask)


def _told(colour: Colour, found: Found) -> str:
    """What was found, and the flag that finds it."""
    said = "  \n".join(found.lines or ("nothing has this colour",))
    return f"{said}\n\n`{flag_of(colour)}`"
