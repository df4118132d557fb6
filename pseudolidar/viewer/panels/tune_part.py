"""The controls of one matcher or filter."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pseudolidar.running.settings_schema import settings_fields
from pseudolidar.viewer.controls import set_value
from pseudolidar.viewer.tuning.knobs import Knob, Part

if TYPE_CHECKING:
    from viser import GuiApi

# What is told when a person has set a knob, or chosen a kind.
Turned = Callable[[Part, Knob, Any], None]
Chosen = Callable[[Part, str], None]


class KnobControl:
    """One setting on the page.

    Args:
        gui: of the page.
        knob: what it sets.
        value: that it has at first; None where it is left to itself.
        turned: is told the new value.
    """

    def __init__(
        self, gui: GuiApi, knob: Knob, value: Any, turned: Callable[[Knob, Any], None]
    ) -> None:
        self.knob = knob
        self._own: Any = None
        if knob.optional:
            self._own = gui.add_checkbox(
                f"set {knob.label}", value is not None, hint=knob.hint, visible=False
            )
            self._own.on_update(lambda _: turned(knob, self.value))
        self._control = _control(gui, knob, value)
        self._control.on_update(lambda _: turned(knob, self.value))

    @property
    def value(self) -> Any:
        """What the page shows."""
        return None if self._own is not None and not self._own.value else self._control.value

    def show(self, *, visible: bool, value: Any) -> None:
        """Show it or not, and that value."""
        if visible and self._own is not None:
            set_value(self._own, value is not None)
        if visible and value is not None:
            set_value(self._control, value)
        if self._own is not None and self._own.visible != visible:
            self._own.visible = visible
        used = visible and (self._own is None or value is not None)
        if self._control.visible != used:
            self._control.visible = used


def _control(gui: GuiApi, knob: Knob, value: Any) -> Any:
    if knob.kind == "switch":
        return gui.add_checkbox(knob.label, bool(value), hint=knob.hint, visible=False)
    if knob.kind == "choice":
        return gui.add_dropdown(
            knob.label, knob.options, initial_value=value, hint=knob.hint, visible=False
        )
    span = knob.span
    assert span is not None
    if value is None:
        value = span.low if span.start is None else span.start
    as_it_is = int if knob.whole else float
    low, high, step, at = (as_it_is(one) for one in (span.low, span.high, span.step, value))
    return gui.add_slider(knob.label, low, high, step, at, hint=knob.hint, visible=False)


class PartControls:
    """A part on the page: which kind of it, and the settings of that kind.

    Args:
        gui: of the page.
        part: which.
        chosen: is told another kind.
        turned: is told another setting.
    """

    def __init__(self, gui: GuiApi, part: Part, chosen: Chosen, turned: Turned) -> None:
        self.part = part
        self._kind: Any = None
        if len(part.kinds) > 1:
            self._kind = gui.add_dropdown(
                "kind", tuple(part.kinds), initial_value=next(iter(part.kinds)), hint=part.hint
            )
            self._kind.on_update(lambda _: chosen(part, self._kind.value))

        def told(kind: str) -> Callable[[Knob, Any], None]:
            def tell(knob: Knob, value: Any) -> None:
                if self.kind == kind:
                    turned(part, knob, value)

            return tell

        self._knobs = {
            kind: [
                KnobControl(gui, knob, _at_first(part, kind, knob), told(kind)) for knob in knobs
            ]
            for kind, knobs in part.knobs.items()
        }

    @property
    def kind(self) -> str:
        """Which is chosen on the page."""
        if self._kind is not None:
            return str(self._kind.value)
        return next(iter(self.part.kinds), "")

    def show(self, kind: str, values: Callable[[Knob], Any]) -> None:
        """Show the settings of a kind."""
        if self._kind is not None:
            set_value(self._kind, kind)
        for name, controls in self._knobs.items():
            for one in controls:
                visible = name == kind
                one.show(visible=visible, value=values(one.knob) if visible else None)


def _at_first(part: Part, kind: str, knob: Knob) -> Any:
    """The default of a setting; of a plain one the first of its words."""
    cls = part.kinds.get(kind)
    if cls is None:
        return knob.options[0] if knob.options else None
    defaults = {field.name: field.default for field in settings_fields(cls)}
    return defaults[knob.name]
