"""Short names of flags: `--sequence` for `--source.sequence`, `--mcap-profile` with a dash."""

from __future__ import annotations

from collections.abc import Mapping

from pseudolidar.commandline.arguments import END_OF_FLAGS, split_flag
from pseudolidar.running.settings_schema import is_settings, settings_fields

# Flags of every verb.
COMMON_FLAGS = frozenset({"json", "debug", "settings", "help"})


def bare_flags(cls: type) -> dict[str, str]:
    """Flags of what is recognised, with their prefix, by their name without it.

    The verb's own flags win: where it has `--frames`, the source's is `--source.frames`.

    Args:
        cls: settings class of the verb.
    """
    fields = settings_fields(cls)
    taken = COMMON_FLAGS | {field.flag for field in fields}
    found: dict[str, str] = {}
    for field in fields:
        members = field.choices.values() if field.recognised else ()
        for member in members:
            # The first field is what SOURCE itself fills.
            below = settings_fields(member)[1:] if member else ()
            plain = [f.flag for f in below if not f.choices and not is_settings(f.type)]
            found |= {f"--{n}": f"--{field.flag}.{n}" for n in plain if n not in taken}
    return found


def dashed_flags(cls: type) -> dict[str, str]:
    """Flags of nested settings, with their dot, by their name with a dash in its place.

    Args:
        cls: settings class of the verb.
    """
    fields = settings_fields(cls)
    taken = {field.flag for field in fields}
    nested = [field for field in fields if is_settings(field.type)]
    names = [(field.flag, below.flag) for field in nested for below in settings_fields(field.type)]
    return {f"--{a}-{b}": f"--{a}.{b}" for a, b in names if f"{a}-{b}" not in taken}


def renamed(args: list[str], names: Mapping[str, str]) -> list[str]:
    """The arguments with flags renamed, those that switch off (`--no-NAME`) as well."""
    end = args.index(END_OF_FLAGS) if END_OF_FLAGS in args else len(args)
    return [_renamed(arg, names) for arg in args[:end]] + args[end:]


def _renamed(arg: str, names: Mapping[str, str]) -> str:
    if not arg.startswith("--"):
        return arg
    name, value = split_flag(arg)
    head, dot, last = name[2:].rpartition(".")
    positive = f"--{head}{dot}{last.removeprefix('no-')}"
    if name in names:
        name = names[name]
    elif last.startswith("no-") and positive in names:
        head, dot, last = names[positive][2:].rpartition(".")
        name = f"--{head}{dot}no-{last}"
    else:
        return arg
    return name if value is None else f"{name}={value}"
