"""Settings that are being tuned: as they are, as they were, and as they were kept."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Generic, TypeVar

from pseudolidar.running.settings_json import to_json
from pseudolidar.running.settings_schema import choice_name, settings_fields
from pseudolidar.viewer.tuning.knobs import Knob, Part, parts_of

Job = TypeVar("Job")
# Steps that can be taken back, and turns of one knob that are one step: less than this apart, s.
MOST_STEPS, ONE_TURN_S = 200, 1.5


class Bench(Generic[Job]):
    """What the knobs stand at.

    Args:
        job: settings of a verb, a frozen dataclass; some of its fields are tuned.
    """

    def __init__(self, job: Job) -> None:
        self.job, self.kept = job, job
        self.parts = {part.name: part for part in parts_of(job)}
        self._before: list[Job] = []
        self._turned: tuple[str, float] = "", 0.0
        # What was asked for of a kind and could not be, for another knob must be turned first.
        self._asked: dict[tuple[str, str], dict[str, Any]] = {}
        # Kinds that were chosen before; those of the start may need what only they have: a file.
        self._left = {
            (part.name, self.kind(part)): getattr(job, part.name)
            for part in self.parts.values()
            if not part.plain
        }

    def kind(self, part: Part) -> str:
        """The chosen kind of a part; "" of a plain setting."""
        value = getattr(self.job, part.name)
        return "" if part.plain else choice_name(None if value is None else type(value))

    def value(self, part: Part, knob: Knob) -> Any:
        """What the control of a knob of the chosen kind shows: what it stands at.

        What was asked for and refused is shown too, for it is tried again with the next knob.
        """
        settings = getattr(self.job, part.name)
        if part.plain:
            return settings
        asked = self._asked.get((part.name, self.kind(part)), {})
        return asked[knob.name] if knob.name in asked else getattr(settings, knob.name)

    def turn(self, part: Part, knob: Knob, value: Any, now_s: float) -> bool:
        """Set a knob of the chosen kind.

        Args:
            part: whose.
            knob: which.
            value: of its control.
            now_s: turns that follow soon on one of the same knob are one step with it.

        Returns:
            Whether anything has changed.

        Raises:
            PseudolidarError: the settings cannot be so; what was asked for is remembered, and tried
                again with the next knob of the part.
        """
        value = knob.taken(value)
        name = f"{part.name}.{knob.name}"
        if part.plain:
            return self._take(part, value, name, now_s)
        asked = self._asked.setdefault((part.name, self.kind(part)), {})
        asked[knob.name] = value
        made = replace(getattr(self.job, part.name), **asked)
        asked.clear()
        return self._take(part, made, name, now_s)

    def choose(self, part: Part, kind: str, now_s: float) -> bool:
        """Take another kind, with the settings that it had when it was left; tells of a change."""
        if kind == self.kind(part):
            return False
        cls = part.kinds[kind]
        settings = None if cls is None else self._left.get((part.name, kind)) or cls()
        return self._take(part, settings, part.name, now_s)

    def undo(self) -> None:
        """Take the last step back."""
        if self._before:
            self._forget()
            self.job = self._before.pop()

    def reset(self) -> None:
        """The defaults, which is a step as well."""
        defaults = {field.name: field.default for field in settings_fields(type(self.job))}
        self._take_all({name: defaults[name] for name in self.parts})

    def keep(self) -> None:
        """Remember the settings, to compare others with them."""
        self.kept = self.job

    def restore(self) -> None:
        """Go back to the kept settings, which is a step as well."""
        self._take_all({name: getattr(self.kept, name) for name in self.parts})

    def as_json(self) -> dict[str, Any]:
        """The matcher, and the other parts as far as they are not the defaults.

        Verbs whose defaults are others keep them that way.
        """
        data = to_json(self.job)
        fields = {field.name: field for field in settings_fields(type(self.job))}
        return {
            name: data[name]
            for name in self.parts
            if name == "matcher" or getattr(self.job, name) != fields[name].default
        }

    def _take_all(self, values: dict[str, Any]) -> None:
        self._forget()
        self._step(replace(self.job, **values))  # type: ignore[type-var] # Job is a dataclass

    def _take(self, part: Part, settings: Any, name: str, now_s: float) -> bool:
        old = getattr(self.job, part.name)
        if settings == old and type(settings) is type(old):
            return False
        if not part.plain:
            self._left[part.name, self.kind(part)] = old
        before, then_s = self._turned
        self._turned = name, now_s
        made = replace(self.job, **{part.name: settings})  # type: ignore[type-var]
        if name == before and now_s - then_s < ONE_TURN_S and self._before:
            self.job = made
        else:
            self._step(made)
        return True

    def _step(self, made: Job) -> None:
        if made != self.job:
            self._before = [*self._before[1 - MOST_STEPS :], self.job]
            self.job = made

    def _forget(self) -> None:
        self._asked.clear()
        self._turned = "", 0.0
