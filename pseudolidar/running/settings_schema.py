"""What the fields of a settings dataclass mean: types, marks, choices. Read by flags and JSON."""

from __future__ import annotations

import dataclasses
import re
import types
from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass
from typing import Annotated, Any, TypeGuard, Union, get_args, get_origin, get_type_hints

from pseudolidar.running.field_markers import Marker, Recognised

NO_CHOICE = "none"  # the name of None in a union of settings


@dataclass(frozen=True)
class SettingsField:
    """One field of a settings dataclass.

    Args:
        name: as in Python.
        type: annotation without its marks.
        default: default value, `MISSING` if the field is required.
        marks: what stood beside the type in `Annotated`.
        choices: where the type is a union of settings dataclasses: their names and classes.
        parse: where the type is a value with one constructor from text: that constructor.
    """

    name: str
    type: Any
    default: Any
    marks: tuple[Any, ...]
    choices: dict[str, type | None]
    parse: Callable[[str], Any] | None

    @property
    def flag(self) -> str:
        """Name on the command line, without dashes; rates are in Hz and need not say so."""
        return self.name.removesuffix("_hz").replace("_", "-")

    @property
    def recognised(self) -> Recognised | None:
        """How text given by place becomes a choice, where that is so."""
        return next((mark for mark in self.marks if isinstance(mark, Recognised)), None)

    @property
    def positional(self) -> bool:
        """Whether the field is given by place."""
        return Marker.POSITIONAL in self.marks or self.recognised is not None

    @property
    def run_only(self) -> bool:
        """Whether the field leaves what is known of each frame as it is."""
        return bool({Marker.RUN_ONLY, Marker.AFTERWARDS}.intersection(self.marks))

    @property
    def this_time(self) -> bool:
        """Whether the field is not repeated when the settings of a run are."""
        return Marker.THIS_TIME in self.marks


def settings_fields(cls: type) -> tuple[SettingsField, ...]:
    """The fields of a settings dataclass in order.

    Raises:
        TypeError: two choices of a field have one name, or `cls` is no dataclass.
    """
    hints = get_type_hints(cls, include_extras=True)
    return tuple(
        _field(field, hints[field.name]) for field in dataclasses.fields(cls) if field.init
    )


def choice_name(cls: type | None) -> str:
    """Name of a member of a union on the command line and in JSON: `KittiRaw` is `kitti-raw`.

    A class that people know by another name says so by `CHOICE`.
    """
    if cls is None:
        return NO_CHOICE
    if own := vars(cls).get("CHOICE"):
        return str(own)
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "-", cls.__name__).lower()


def described(settings: Any) -> str:
    """One line for people: the choice, its first setting, and those that are not the default."""
    first, *others = settings_fields(type(settings))
    chosen = [field for field in others if getattr(settings, field.name) != field.default]
    values = [(field.flag, getattr(settings, field.name)) for field in (first, *chosen)]
    named = ", ".join(
        f"{flag} {value}" for part in values for flag, value in _told(*part) if value is not None
    )
    return choice_name(type(settings)) + (f" ({named})" if named else "")


def _told(flag: str, value: Any) -> Iterator[tuple[str, Any]]:
    """A setting as it is named; of one that has settings itself those that are not the default."""
    if not is_settings(type(value)):
        yield flag, value
        return
    for field in settings_fields(type(value)):
        inner = getattr(value, field.name)
        if inner != field.default:
            yield from _told(f"{flag}.{field.flag}", inner)


def union_members(kind: Any) -> tuple[Any, ...]:
    """Members of a union without their marks; of any other type, that type alone."""
    kind = unmarked(kind)[0]
    if get_origin(kind) in (Union, types.UnionType):
        return tuple(part for member in get_args(kind) for part in union_members(member))
    return (kind,)


def unmarked(kind: Any) -> tuple[Any, tuple[Any, ...]]:
    """A type and what stood beside it in `Annotated`."""
    if get_origin(kind) is Annotated:
        inner, *marks = get_args(kind)
        return inner, tuple(marks)
    return kind, ()


def parser_of(kind: Any) -> Callable[[str], Any] | None:
    """The `parse(text)` of a value type, None for types without one."""
    parse = getattr(kind, "parse", None) if isinstance(kind, type) else None
    return parse if callable(parse) else None


def is_settings(kind: Any) -> TypeGuard[type]:
    """Whether a type is a settings dataclass: fields of their own, not a value read from text."""
    return isinstance(kind, type) and dataclasses.is_dataclass(kind) and parser_of(kind) is None


def _field(field: dataclasses.Field[Any], hint: Any) -> SettingsField:
    kind, marks = unmarked(hint)
    default = field.default if field.default_factory is MISSING else field.default_factory()
    parsers = [parse for member in union_members(kind) if (parse := parser_of(member))]
    parse = parsers[0] if len(parsers) == 1 else None
    return SettingsField(field.name, kind, default, marks, _choices(field.name, kind), parse)


def _choices(name: str, kind: Any) -> dict[str, type | None]:
    members = [None if m is type(None) else m for m in union_members(kind)]
    settings = [member for member in members if member is not None]
    if len(members) < 2 or not all(is_settings(member) for member in settings):
        return {}
    choices = {choice_name(member): member for member in members}
    if len(choices) < len(members):
        raise TypeError(f"two choices of {name} have one name: {members}")
    return choices
