"""The first look at the arguments: options taken off by hand, texts given by place."""

from __future__ import annotations

from collections.abc import Mapping

from pseudolidar.errors import UsageError

END_OF_FLAGS = "--"
MANY = -1  # a flag that takes all texts up to the next flag


def split_flag(token: str) -> tuple[str, str | None]:
    """Name of a flag with dashes for underscores, and what follows its equals sign."""
    name, equals, value = token.partition("=")
    return "--" + name[2:].replace("_", "-"), value if equals else None


def take_switch(args: list[str], flag: str) -> bool:
    """Remove a switch from the arguments and tell whether it was there."""
    found = [i for i in range(_flags_end(args)) if args[i] == flag]
    for i in reversed(found):
        del args[i]
    return bool(found)


def take_value(args: list[str], flag: str) -> str | None:
    """Remove `flag VALUE` or `flag=VALUE` from the arguments; the last one counts.

    Raises:
        UsageError: the flag has no value.
    """
    value, i = None, 0
    while i < _flags_end(args):
        if not args[i].startswith("--") or split_flag(args[i])[0] != flag:
            i += 1
            continue
        value = split_flag(args.pop(i))[1]
        if value is None:
            if i >= _flags_end(args):
                raise UsageError(f"{flag} has no value", want=f"{flag} VALUE")
            value = args.pop(i)
    return value


def wants_help(args: list[str]) -> bool:
    """Whether help was asked for."""
    return any(arg in ("-h", "--help") for arg in args[: _flags_end(args)])


def flag_names(args: list[str]) -> list[str]:
    """Names of the long flags among the arguments."""
    return [split_flag(arg)[0] for arg in args[: _flags_end(args)] if arg.startswith("--")]


def positional_texts(args: list[str], values_of: Mapping[str, int]) -> list[str]:
    """Texts that belong to no flag, in order.

    Args:
        args: arguments after the verb.
        values_of: how many values each flag takes; 0 for flags not named here.
    """
    found: list[str] = []
    end, i = _flags_end(args), 0
    while i < end:
        token, i = args[i], i + 1
        if not _is_flag(token):
            found.append(token)
            continue
        name, value = split_flag(token)
        take = 0 if value is not None else values_of.get(name, 0)
        while take != 0 and i < end and not (take == MANY and _is_flag(args[i])):
            take, i = take - (take != MANY), i + 1
    return found + args[end + 1 :]


def _is_flag(token: str) -> bool:
    return len(token) > 1 and token[0] == "-" and not token[1:2].isdigit()


def _flags_end(args: list[str]) -> int:
    return args.index(END_OF_FLAGS) if END_OF_FLAGS in args else len(args)
