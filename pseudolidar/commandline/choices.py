"""The first pass over the arguments: which classes were chosen, so that their flags exist."""

from __future__ import annotations

import contextlib
import dataclasses
import enum
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, replace
from typing import Any, get_args, get_origin

from pseudolidar.commandline.arguments import (
    MANY,
    flag_names,
    positional_texts,
    take_value,
    wants_help,
)
from pseudolidar.commandline.bare_flags import bare_flags, dashed_flags, renamed
from pseudolidar.commandline.verbs import did_you_mean
from pseudolidar.errors import PseudolidarError, UsageError
from pseudolidar.running.settings_schema import (
    SettingsField,
    choice_name,
    is_settings,
    settings_fields,
    union_members,
)


class FilledBy(enum.Enum):
    """Where the value of a field comes from."""

    FLAG = "its flag, or its default"
    PLACE = "a text given by place"
    RECOGNITION = "the text by place, through what recognised it; it is in the default"
    OUTER_TEXT = "the text given by place for the choice that this field belongs to"


@dataclass(frozen=True)
class Entry:
    """One field of a settings class on this command line.

    Args:
        field: the field.
        default: its value unless a flag says otherwise; `MISSING` if it has none.
        chosen: the settings below it, where it is a choice or nested settings.
        filled_by: where its value comes from.
    """

    field: SettingsField
    default: Any
    chosen: Node | None = None
    filled_by: FilledBy = FilledBy.FLAG


@dataclass(frozen=True)
class Node:
    """A settings class whose choices are made.

    Args:
        cls: the class.
        entries: its fields.
        bare: flags below it that need no prefix: their names with it, by those without.
    """

    cls: type
    entries: tuple[Entry, ...]
    bare: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def awaited(self) -> SettingsField | None:
        """The field that the text given by place for the whole class fills, if one does."""
        awaited = (e.field for e in self.entries if e.filled_by is FilledBy.OUTER_TEXT)
        return next(awaited, None)


def resolve(cls: type, args: list[str], given: Mapping[str, Any] | None = None) -> Node:
    """Make the choices that the arguments name; their flags are taken out of `args`.

    `--matcher census:fine` chooses the class and leaves `--matcher.quality=fine`, its first field.
    The class of a field that is recognised from its text follows from the text given by place.

    Args:
        cls: settings class.
        args: arguments after the verb; changed.
        given: values of fields to start from, instead of their defaults.

    Raises:
        UsageError: a choice is unknown; the nearest is named.
    """
    bare = bare_flags(cls)
    args[:] = renamed(renamed(args, dashed_flags(cls)), bare)
    node = _resolve(cls, args, given, prefix="")
    by_place = [entry for entry in node.entries if entry.filled_by is FilledBy.PLACE]
    entries = [
        _recognise(entry, args, node, by_place.index(entry))
        if entry in by_place and entry.field.recognised
        else entry
        for entry in node.entries
    ]
    node = Node(cls, tuple(entries), bare)
    _refuse_unknown_flags(args, node)
    return node


def _resolve(cls: type, args: list[str], given: Mapping[str, Any] | None, prefix: str) -> Node:
    entries = []
    for field in settings_fields(cls):
        default = field.default if given is None else given.get(field.name, field.default)
        entries.append(_entry(field, default, args, prefix))
    return Node(cls, tuple(entries))


def _entry(field: SettingsField, default: Any, args: list[str], prefix: str) -> Entry:
    path = f"{prefix}{field.flag}"
    if field.choices:
        return _choice(field, default, args, path)
    if is_settings(field.type):
        below = None if default is MISSING else vars(default)
        return Entry(field, default, _resolve(field.type, args, below, f"{path}."))
    return Entry(field, default, filled_by=_by_place(field, path))


def _by_place(field: SettingsField, path: str) -> FilledBy:
    return FilledBy.PLACE if field.positional and "." not in path else FilledBy.FLAG


def _choice(field: SettingsField, default: Any, args: list[str], path: str) -> Entry:
    filled_by = _by_place(field, path)
    text = take_value(args, f"--{path}")
    if text is None:
        if default is MISSING or default is None:
            return Entry(field, default, filled_by=filled_by)
        return Entry(
            field, default, _resolve(type(default), args, vars(default), f"{path}."), filled_by
        )
    name, colon, rest = text.partition(":")
    chosen = _named(field, name, path)
    if chosen is None:
        return Entry(field, None)
    if colon:
        args.insert(0, f"--{path}.{_first_field(chosen).flag}={rest}")
        filled_by = FilledBy.FLAG
    default = default if type(default) is chosen else MISSING
    below = None if default is MISSING else vars(default)
    return Entry(field, default, _resolve(chosen, args, below, f"{path}."), filled_by)


def _named(field: SettingsField, name: str, path: str) -> type | None:
    if name in field.choices:
        return field.choices[name]
    names = list(field.choices)
    raise UsageError(
        f"--{path} has no choice {name!r}",
        want=f"one of {', '.join(names)}",
        fix=did_you_mean(name, names),
    )


def _first_field(cls: type) -> SettingsField:
    fields = settings_fields(cls)
    if not fields:
        raise UsageError(f"{choice_name(cls)} takes no value after a colon")
    return fields[0]


def _recognise(entry: Entry, args: list[str], node: Node, place: int) -> Entry:
    """The entry with its class, from the text given by place or from the flag that forces it."""
    if entry.chosen is not None and entry.default is MISSING:
        forced = _mark_first(entry.chosen, FilledBy.OUTER_TEXT)
        return Entry(entry.field, MISSING, forced, FilledBy.PLACE)
    texts = positional_texts(args, _values_of(node))
    recognised = entry.field.recognised
    if place >= len(texts) or recognised is None:
        return entry
    with contextlib.suppress(*([PseudolidarError] if wants_help(args) else [])):
        settings = recognised.by(texts[place])
        chosen = _resolve(type(settings), args, vars(settings), f"{entry.field.flag}.")
        chosen = _mark_first(chosen, FilledBy.RECOGNITION)
        return Entry(entry.field, settings, chosen, FilledBy.PLACE)
    return entry


def _mark_first(node: Node, filled_by: FilledBy) -> Node:
    first = node.entries[0]
    return Node(node.cls, (replace(first, filled_by=filled_by), *node.entries[1:]))


def _refuse_unknown_flags(args: list[str], node: Node) -> None:
    """Name the nearest flag, or the choice that a flag belongs to where it is not the chosen."""
    filled = _filled_by_text(node)
    here = [name for name in [*_values_of(node, others=False), "--help"] if name not in filled]
    short = {name: bare for bare, name in node.bare.items()}
    for name in flag_names(args):
        if name in here or name.replace("--no-", "--").replace(".no-", ".") in here:
            continue
        if name in filled:
            place = name[2:].partition(".")[0].upper()
            raise UsageError(f"{name} is given by {place}", fix=f"Leave out {name}.")
        if owners := _owners(node, name):
            path, choices = owners[0]
            fix = f"It belongs to --{path} {' or '.join(choices)}."
            shown = short.get(name, name)
            raise UsageError(f"{shown} is not a setting of the chosen --{path}", fix=fix)
        near = [short.get(flag, flag) for flag in here]
        fix = did_you_mean(name, near) or "See --help for all flags."
        raise UsageError(f"there is no flag {name}", fix=fix)


def _filled_by_text(node: Node) -> list[str]:
    return [
        f"--{entry.field.flag}.{below.field.flag}"
        for entry in node.entries
        if entry.chosen is not None
        for below in entry.chosen.entries
        if below.filled_by is not FilledBy.FLAG
    ]


def _owners(node: Node, name: str, prefix: str = "") -> list[tuple[str, list[str]]]:
    """Fields of the node, and their choices, that would have a flag of that name."""
    found = []
    for entry in node.entries:
        path = f"{prefix}{entry.field.flag}"
        members = {n: m for n, m in entry.field.choices.items() if m is not None}
        choices = [n for n, m in members.items() if name in _flags_of(m, f"--{path}.")]
        if choices:
            found.append((path, choices))
        if entry.chosen is not None:
            found += _owners(entry.chosen, name, f"{path}.")
    return found


def _flags_of(cls: type, prefix: str) -> dict[str, int]:
    return _values_of(_resolve(cls, [], None, ""), prefix)


def _values_of(node: Node, prefix: str = "--", *, others: bool = True) -> dict[str, int]:
    """How many values each flag of the node takes, those of the choices not taken included."""
    found: dict[str, int] = {}
    for entry in node.entries:
        flag = f"{prefix}{entry.field.flag}"
        if others:
            for member in entry.field.choices.values():
                found |= {} if member is None else _flags_of(member, f"{flag}.")
        if entry.chosen is not None:
            found |= _values_of(entry.chosen, f"{flag}.", others=others)
        found[flag] = _count(entry.field.type)
    return found


def _count(kind: Any) -> int:
    for member in union_members(kind):
        if member is bool:
            return 0
        if get_origin(member) in (tuple, list):
            items = get_args(member)
            return MANY if ... in items or get_origin(member) is list else len(items)
    return 1
