"""The second pass: the settings of the chosen classes as flags, parsed and checked by tyro."""

from __future__ import annotations

import contextlib
import functools
import io
import re
import sys
from collections.abc import Callable
from typing import Any

import tyro
from tyro.constructors import ConstructorRegistry, StructConstructorSpec, StructTypeInfo

from pseudolidar.commandline.bare_flags import renamed
from pseudolidar.commandline.choices import Entry, FilledBy, Node
from pseudolidar.commandline.flag_specs import Placeholder, placeholder, specs_of, text_name
from pseudolidar.commandline.streams import forget_reader
from pseudolidar.errors import UsageError

# Its frame; rules of dashes where the terminal has no such characters.
_BOX = re.compile(r"[─│╭╮╰╯]+|-{8,}")
_END_OF_MESSAGE = re.compile(r"(Argument helptext|For full helptext).*", re.DOTALL)


def parse_settings(node: Node, args: list[str], *, prog: str, description: str) -> Any:
    """Settings from the arguments that the first pass left.

    Raises:
        UsageError: an argument is unknown, missing or cannot be read.
        SystemExit: help was asked for and is printed.
    """
    registry = ConstructorRegistry()
    registry.struct_rule(_placeholder_rule)
    args = renamed(args, {name: bare for bare, name in node.bare.items()})
    message = io.StringIO()
    try:
        with contextlib.redirect_stderr(message):
            return tyro.cli(
                placeholder(node, root=True),
                prog=prog,
                description=description,
                args=args,
                registry=registry,
            )
    except BrokenPipeError:  # help was asked for by a reader that has gone away (`| head`)
        forget_reader(sys.stdout)
        raise SystemExit(0) from None
    except SystemExit as end:
        if not end.code:
            raise
        raise UsageError(
            _one_sentence(message.getvalue(), prog), fix=f"See `{prog} --help`."
        ) from None


def _placeholder_rule(info: StructTypeInfo) -> StructConstructorSpec | None:
    if not (isinstance(info.type, type) and issubclass(info.type, Placeholder)):
        return None
    return StructConstructorSpec(_builder(info.type.node), specs_of(info.type))


def _builder(node: Node) -> Callable[..., Any]:
    """What makes the settings of a node from the values of its flags.

    A class whose first field the text given by place fills is made in two steps: it comes out as
    a function of that field.
    """

    def build(**values: Any) -> Any:
        settings = {
            entry.field.name: _value(entry, values)
            for entry in node.entries
            if entry.filled_by is not FilledBy.OUTER_TEXT
        }
        if len(settings) < len(node.entries):
            return functools.partial(node.cls, **settings)
        return node.cls(**settings)

    return build


def _value(entry: Entry, values: dict[str, Any]) -> Any:
    if entry.chosen is None:
        return values.get(entry.field.name, entry.default)
    value = values.get(entry.field.name) or _builder(entry.chosen)()
    if awaited := entry.chosen.awaited:
        return value(**{awaited.name: values[text_name(entry.field)]})
    return value


def _one_sentence(message: str, prog: str) -> str:
    """The text inside tyro's box without its frame, its reminder of help and its line breaks."""
    text = _BOX.sub(" ", _END_OF_MESSAGE.sub("", message.partition("\n")[2]))
    text = " ".join(text.split()).replace(f"Missing from {prog}:", "missing:")
    return text.removesuffix(".").removeprefix("Error parsing ")
