"""Each field of the chosen settings as tyro sees it: flag, place, metavar, default, help."""

from __future__ import annotations

from dataclasses import MISSING
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin

import tyro
from tyro.constructors import PrimitiveConstructorSpec, StructFieldSpec

from pseudolidar.commandline.choices import Entry, FilledBy, Node
from pseudolidar.errors import PseudolidarError, UsageError
from pseudolidar.running.settings_docs import class_doc
from pseudolidar.running.settings_schema import (
    NO_CHOICE,
    SettingsField,
    choice_name,
    union_members,
)

_SWITCHES = {
    "json": "One JSON object on the standard output, everything else on the standard error.",
    "debug": "Show the traceback of an error.",
}
_SETTINGS_HELP = "Start from the settings of an earlier run (its run.json); flags override them."
_FORCE_HELP = "Force what it is, instead of recognising it from its content."
_NAMED_TYPES = {int: "INT", float: "FLOAT", str: "TEXT", Path: "PATH"}
_ABSENT: Any = tyro.MISSING_NONPROP


class Placeholder:
    """Stands for a node of the settings in tyro's types; one subclass a node."""

    node: ClassVar[Node]
    root: ClassVar[bool]
    bare: ClassVar[frozenset[str]]
    prefix: ClassVar[str]


def placeholder(
    node: Node, *, root: bool = False, bare: frozenset[str] = frozenset(), prefix: str = ""
) -> type[Placeholder]:
    """The type that stands for a node.

    Args:
        node: the node.
        root: whether it also shows the flags of every verb.
        bare: flags of the node that are written without its prefix.
        prefix: what its other flags begin with, such as `detector.`.
    """
    doc = class_doc(node.cls).summary
    members = {"node": node, "root": root, "bare": bare, "prefix": prefix, "__doc__": doc}
    return type(node.cls.__name__, (Placeholder,), members)


def specs_of(kind: type[Placeholder]) -> tuple[StructFieldSpec, ...]:
    """Flags and places of a node's fields."""
    docs = class_doc(kind.node.cls).fields
    specs = [
        spec
        for entry in kind.node.entries
        for spec in _specs(entry, docs.get(entry.field.name, ""), kind)
    ]
    return (*specs, *(_common_specs() if kind.root else ()))


def text_name(field: SettingsField) -> str:
    """Keyword of the text given by place for a field that is recognised from it."""
    return f"{field.name}__text"


def _specs(entry: Entry, help_text: str, parent: type[Placeholder]) -> list[StructFieldSpec]:
    if entry.filled_by in (FilledBy.RECOGNITION, FilledBy.OUTER_TEXT):
        return []
    if not entry.field.choices and entry.chosen is None:
        return [_plain(entry, help_text, parent)]
    specs = []
    if entry.filled_by is FilledBy.PLACE:
        specs.append(_text_by_place(entry, help_text))
        help_text = _FORCE_HELP
    if entry.field.choices:
        specs.append(_chooser(entry, help_text))
    if entry.chosen is not None:
        chosen = placeholder(
            entry.chosen,
            bare=_bare_below(entry, parent.node),
            prefix=f"{parent.prefix}{entry.field.flag}.",
        )
        if any(_specs(below, "", chosen) for below in entry.chosen.entries):
            specs.append(StructFieldSpec(entry.field.name, chosen, _ABSENT))
    return specs


def _bare_below(entry: Entry, node: Node) -> frozenset[str]:
    prefix = f"--{entry.field.flag}."
    below = (name.removeprefix(prefix) for name in node.bare.values() if name.startswith(prefix))
    return frozenset(below)


def _plain(entry: Entry, help_text: str, parent: type[Placeholder]) -> StructFieldSpec:
    kind = _kind(entry, parent)
    default = _ABSENT if entry.default is MISSING else entry.default
    return StructFieldSpec(entry.field.name, kind, default, help_text)


def _kind(entry: Entry, parent: type[Placeholder]) -> Any:
    """The type of a field with what tyro needs to know: its parser, place, metavar, hint."""
    field, by_place = entry.field, entry.filled_by is FilledBy.PLACE
    bare = field.flag in parent.bare
    metavar = _metavar(field)
    if by_place:
        name = metavar if metavar and metavar[0] == "{" else field.flag.upper()
        metavar = name if entry.default is MISSING else f"[{name}]"
    hint = "(optional)" if entry.default is None else None
    argument = tyro.conf.arg(
        name=None if by_place else field.flag,
        prefix_name=False if bare else None,
        metavar=metavar,
        help_behavior_hint=hint,
    )
    flag = f"--{'' if bare else parent.prefix}{field.flag}"
    kind: Any = Annotated[_parsed(field, flag), argument]
    return Annotated[kind, tyro.conf.Positional] if by_place else kind


def _parsed(field: SettingsField, flag: str) -> Any:
    return field.type if field.parse is None else Annotated[field.type, _value_spec(field, flag)]


def _metavar(field: SettingsField) -> str | None:
    """Shorter than tyro's own where None is the only other possibility."""
    members = [member for member in union_members(field.type) if member is not type(None)]
    if len(members) != 1:
        return None
    if get_origin(members[0]) is Literal:
        return "{" + ",".join(map(str, get_args(members[0]))) + "}"
    return _NAMED_TYPES.get(members[0])


def _text_by_place(entry: Entry, help_text: str) -> StructFieldSpec:
    metavar = tyro.conf.arg(name=entry.field.flag, metavar=entry.field.flag.upper())
    awaited = None if entry.chosen is None else entry.chosen.awaited
    required = awaited is not None or entry.chosen is None
    inner: Any = str if awaited is None else _parsed(awaited, f"--{awaited.flag}")
    kind: Any = Annotated[inner, metavar, tyro.conf.Positional]
    return StructFieldSpec(text_name(entry.field), kind, _ABSENT if required else "", help_text)


def _chooser(entry: Entry, help_text: str) -> StructFieldSpec:
    """The flag that names the choice; the first pass has taken it, here it is for help."""
    field = entry.field
    name = choice_name(entry.chosen.cls) if entry.chosen else ""
    if entry.default is None:
        name = NO_CHOICE
    free = field.recognised is not None
    hint = f"(chosen: {name})" if name else "(recognised)" if free else "(required)"
    argument = tyro.conf.arg(
        name=field.flag, metavar="{" + ",".join(field.choices) + "}", help_behavior_hint=hint
    )
    default = name if name or free else _ABSENT
    kind: Any = Annotated[str, argument]
    return StructFieldSpec(f"{field.name}__choice", kind, default, help_text)


def _value_spec(field: SettingsField, flag: str) -> PrimitiveConstructorSpec[Any]:
    """How tyro reads a value with one constructor from text; `flag` is named in errors."""
    parse = field.parse
    assert parse is not None

    def read(texts: list[str]) -> Any:
        try:
            return parse(texts[0])
        except PseudolidarError as error:
            error.where = error.where or flag
            raise
        except ValueError as error:
            raise UsageError(str(error), where=flag) from error

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=field.flag.upper(),
        instance_from_str=read,
        is_instance=lambda value: not isinstance(value, str),
        str_from_instance=lambda value: [str(value)],
    )


def _common_specs() -> list[StructFieldSpec]:
    """Flags of every verb; the first pass has taken them, here they are for help."""
    specs = []
    for name, text in _SWITCHES.items():
        argument = tyro.conf.arg(name=name, help_behavior_hint="")
        kind: Any = Annotated[bool, argument, tyro.conf.FlagCreatePairsOff]
        specs.append(StructFieldSpec(f"{name}__common", kind, False, text))
    argument = tyro.conf.arg(name="settings", metavar="FILE", help_behavior_hint="")
    kind = Annotated[str, argument]
    return [*specs, StructFieldSpec("settings__common", kind, "", _SETTINGS_HELP)]
