"""Settings of matchers and filters as things that can be turned: read from their dataclasses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass
from typing import Any, Literal, get_args, get_origin

from pseudolidar.running.settings_docs import class_doc
from pseudolidar.running.settings_json import TUNED_PARTS
from pseudolidar.running.settings_schema import (
    SettingsField,
    choice_name,
    is_settings,
    settings_fields,
    union_members,
)
from pseudolidar.viewer.tuning.spans import Span, span_of

# What is no matter of how a frame is seen: how fast it goes, what is written, and what only frames
# of other kinds have.
NOT_TUNED = frozenset(
    {
        "census.threads",
        "onnx.threads",
        "onnx.provider",
        "reproject.organised",
        "reproject.depth_sigma_rel",
    }
)
_UNITS = {"px": "px", "m": "m", "m2": "m²", "deg": "°", "percent": "%"}


@dataclass(frozen=True)
class Knob:
    """One setting.

    Args:
        name: of the field.
        hint: what its docstring says.
        kind: what it takes.
        options: of a choice.
        span: of a number.
        whole: whether the number is a whole one.
        optional: whether it may be left to itself, or be no limit: None.
    """

    name: str
    hint: str
    kind: Literal["switch", "choice", "number"]
    options: tuple[str, ...] = ()
    span: Span | None = None
    whole: bool = False
    optional: bool = False

    @property
    def label(self) -> str:
        """For people, with its unit."""
        words, _, last = self.name.rpartition("_")
        if last in _UNITS and words:
            return f"{words.replace('_', ' ')}, {_UNITS[last]}"
        return self.name.replace("_", " ")

    def taken(self, value: Any) -> Any:
        """A value of a control as the setting has it."""
        if self.kind != "number" or value is None:
            return value
        return round(value) if self.whole else round(float(value), 6)


@dataclass(frozen=True)
class Part:
    """A matcher, a filter, or a plain setting of a job.

    Args:
        name: of the field of the job.
        hint: what its docstring says.
        kinds: what may be chosen, by name; None for nothing. One where there is no choice.
        knobs: of each kind, by its name; of a plain setting one, under "".
    """

    name: str
    hint: str
    kinds: Mapping[str, type | None]
    knobs: Mapping[str, tuple[Knob, ...]]

    @property
    def plain(self) -> bool:
        """Whether it is a value itself, without settings of its own."""
        return not self.kinds


def parts_of(job: Any) -> tuple[Part, ...]:
    """What of a job can be tuned, in the order of `TUNED_PARTS`.

    Args:
        job: settings of a verb; kinds that need something given, such as a file, are offered where
            the job has it.
    """
    docs = class_doc(type(job)).fields
    fields = {field.name: field for field in settings_fields(type(job))}
    return tuple(
        _part(fields[name], getattr(job, name), docs.get(name, ""))
        for name in TUNED_PARTS
        if name in fields
    )


def _part(field: SettingsField, now: Any, hint: str) -> Part:
    if not field.choices and not is_settings(field.type):
        knob = _knob(None, field, hint, now)
        return Part(field.name, hint, {}, {"": () if knob is None else (knob,)})
    every = field.choices or {choice_name(field.type): field.type}
    kinds = {
        name: kind
        for name, kind in every.items()
        if kind is None or kind is type(now) or _needs_nothing(kind)
    }
    knobs = {
        name: () if kind is None else knobs_of(kind, now if kind is type(now) else None)
        for name, kind in kinds.items()
    }
    return Part(field.name, hint, kinds, knobs)


def _needs_nothing(kind: type) -> bool:
    return all(field.default is not MISSING for field in settings_fields(kind))


def knobs_of(kind: type, now: Any = None) -> tuple[Knob, ...]:
    """The knobs of a class of settings.

    Args:
        kind: the class.
        now: settings of that class, whose numbers the ranges hold.
    """
    docs = class_doc(kind).fields
    found = (
        _knob(kind, field, docs.get(field.name, ""), getattr(now, field.name, None))
        for field in settings_fields(kind)
    )
    return tuple(knob for knob in found if knob is not None)


def _knob(kind: type | None, field: SettingsField, hint: str, now: Any) -> Knob | None:
    owner = "" if kind is None else choice_name(kind)
    if f"{owner}.{field.name}" in NOT_TUNED:
        return None
    members = [one for one in union_members(field.type) if one is not type(None)]
    (member,) = members if len(members) == 1 else (None,)
    if member is bool:
        return Knob(field.name, hint, "switch")
    words = get_args(member) if get_origin(member) is Literal else ()
    if words and all(isinstance(word, str) for word in words):
        return Knob(field.name, hint, "choice", words)
    span = None if kind is None else span_of(kind, field.name)
    if member not in (int, float) or span is None:
        return None
    optional = len(members) < len(union_members(field.type))
    return Knob(
        field.name, hint, "number", (), span.holding(now), whole=member is int, optional=optional
    )
