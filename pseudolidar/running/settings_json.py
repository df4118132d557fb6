"""Settings to JSON and back: for the journal, `run.json` and `--settings`."""

from __future__ import annotations

import dataclasses
import enum
import json
import types
from collections.abc import Mapping
from dataclasses import MISSING
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin

from pseudolidar.errors import UsageError
from pseudolidar.running.settings_schema import (
    SettingsField,
    choice_name,
    is_settings,
    parser_of,
    settings_fields,
    union_members,
)

CHOICE_KEY = "kind"  # names the member of a union of settings
# In a file of settings: they are parts that verbs share, and each takes those that it has.
FOR_EVERY_VERB, TUNED_SCHEMA = "tuned", 1
TUNED_PARTS = (
    "matcher", "rows", "balance", "clean", "temporal", "smooth", "fill", "reproject", "outliers",
)  # fmt: skip
_NOT_FINITE = ("inf", "-inf", "nan")  # as text: JSON has no such numbers

Settings = TypeVar("Settings")


def to_json(settings: Any) -> dict[str, Any]:
    """Resolved settings as plain JSON values, fields in order.

    A chosen member of a union is an object with its name under `kind`. A value with one
    constructor from text (`parse`) is that text where its class defines `__str__`.

    Raises:
        TypeError: a field's type has no JSON form; a mistake in the pipeline, not of its user.
    """
    return {
        field.name: _field_to_json(field, getattr(settings, field.name))
        for field in settings_fields(type(settings))
    }


def from_json(cls: type[Settings], data: dict[str, Any], *, where: str = "") -> Settings:
    """Settings of class `cls` from what `to_json` gave; absent fields take their defaults.

    Raises:
        UsageError: a field is unknown, missing or of another type; `where` names it.
    """
    values = values_from_json(cls, data, where=where)
    for field in settings_fields(cls):
        if field.default is MISSING and field.name not in values:
            raise UsageError(f"setting {field.name!r} is missing", where=_at(where, field.name))
    return cls(**values)


def values_from_json(cls: type, data: dict[str, Any], *, where: str = "") -> dict[str, Any]:
    """Values of some fields of class `cls`, by name, from what `to_json` gave.

    Raises:
        UsageError: a field is unknown or of another type; `where` names it.
    """
    fields = {field.name: field for field in settings_fields(cls)}
    for name in data:
        if name not in fields:
            raise UsageError(
                f"unknown setting {name!r}", want=", ".join(fields), where=_at(where, name)
            )
    return {n: _field_from_json(fields[n], v, _at(where, n)) for n, v in data.items()}


def tuned_file(settings: Mapping[str, Any], about: Mapping[str, Any]) -> bytes:
    """A file of settings for every verb, each of which takes the parts that it has.

    Args:
        settings: some of `TUNED_PARTS`, as `to_json` gives them.
        about: how they were found.
    """
    data = {"schema": TUNED_SCHEMA, FOR_EVERY_VERB: about, "settings": settings}
    return (json.dumps(data, indent=2) + "\n").encode()


def result_settings(settings: Any) -> dict[str, Any]:
    """What can change a byte of the results: `to_json` without run-only fields, at any depth."""
    data = to_json(settings)
    for field in settings_fields(type(settings)):
        value = getattr(settings, field.name)
        if field.run_only:
            del data[field.name]
        elif is_settings(type(value)):
            choice = {CHOICE_KEY: choice_name(type(value))} if field.choices else {}
            data[field.name] = {**choice, **result_settings(value)}
    return data


def settings_differences(
    before: dict[str, Any], now: dict[str, Any], *, where: str = ""
) -> list[tuple[str, Any, Any]]:
    """Where two JSON forms differ: dotted name, value before, value now (None where absent)."""
    found: list[tuple[str, Any, Any]] = []
    for name in [*before, *(name for name in now if name not in before)]:
        old, new = before.get(name), now.get(name)
        if isinstance(old, dict) and isinstance(new, dict):
            found += settings_differences(old, new, where=_at(where, name))
        elif old != new:
            found.append((_at(where, name), old, new))
    return found


def _field_to_json(field: SettingsField, value: Any) -> Any:
    if field.choices and value is not None:
        return {CHOICE_KEY: choice_name(type(value)), **to_json(value)}
    return _value_to_json(value)


def _value_to_json(value: Any) -> Any:
    match value:
        case enum.Enum():
            return value.name
        case float() if repr(value) in _NOT_FINITE:
            return repr(value)
        case None | bool() | int() | float() | str():
            return value
        case Path():
            return str(value)
        case tuple() | list():
            return [_value_to_json(item) for item in value]
        case dict():
            return {str(key): _value_to_json(item) for key, item in value.items()}
    if parser_of(type(value)) and "__str__" in vars(type(value)):
        return str(value)
    return to_json(value)


def _field_from_json(field: SettingsField, value: Any, where: str) -> Any:
    if not field.choices or value is None:
        return _value_from_json(field.type, value, where)
    if not isinstance(value, dict) or value.get(CHOICE_KEY) not in field.choices:
        want = f"an object with {CHOICE_KEY!r} one of {', '.join(field.choices)}"
        raise UsageError(f"{value!r}", want=want, where=where)
    chosen = field.choices[value[CHOICE_KEY]]
    rest = {name: item for name, item in value.items() if name != CHOICE_KEY}
    return None if chosen is None else from_json(chosen, rest, where=where)


def _value_from_json(kind: Any, value: Any, where: str) -> Any:
    for member in union_members(kind):
        try:
            return _member_from_json(member, value, where)
        except _OtherType:
            continue
    raise UsageError(f"{value!r}", want=_kind_words(kind), where=where)


def _kind_words(kind: Any) -> str:
    """What is wanted, for people: `int | None`, or the values that may be chosen."""
    if get_origin(kind) is Literal:
        return " or ".join(map(repr, get_args(kind)))
    return getattr(kind, "__name__", str(kind))


class _OtherType(Exception):
    """A JSON value is not of the wanted type."""


def _member_from_json(kind: Any, value: Any, where: str) -> Any:
    match get_origin(kind) or kind:
        case types.NoneType if value is None:
            return None
        case container if container in (tuple, list) and isinstance(value, list):
            return _items_from_json(kind, value, where)
        case container if container is dict and isinstance(value, dict):
            inner = get_args(kind)[1]
            return {key: _value_from_json(inner, item, where) for key, item in value.items()}
        case literal if literal is Literal:
            if value in get_args(kind):
                return value
            raise _OtherType
    return _scalar_from_json(kind, value, where)


def _scalar_from_json(kind: Any, value: Any, where: str) -> Any:
    if not isinstance(kind, type):
        raise _OtherType
    if isinstance(value, dict) and dataclasses.is_dataclass(kind):
        return from_json(kind, value, where=where)
    if kind is float and (type(value) in (int, float) or value in _NOT_FINITE):
        return float(value)
    if type(value) is kind and kind in (bool, int, str):
        return value
    if isinstance(value, int) and issubclass(kind, int) and (parse := parser_of(kind)):
        return parse(str(value))
    if not isinstance(value, str):
        raise _OtherType
    if issubclass(kind, Path):
        return kind(value)
    if issubclass(kind, enum.Enum) and value in kind.__members__:
        return kind[value]
    if parse := parser_of(kind):
        return parse(value)
    raise _OtherType


def _items_from_json(kind: Any, value: list[Any], where: str) -> Any:
    inner = [item for item in get_args(kind) if item is not ...]
    if len(inner) == 1:
        inner *= len(value)
    if len(inner) != len(value):
        raise _OtherType
    items = (_value_from_json(i, v, where) for i, v in zip(inner, value, strict=True))
    return list(items) if get_origin(kind) is list else tuple(items)


def _at(where: str, name: str) -> str:
    return f"{where}.{name}" if where else name
