"""One verb from its arguments to its report."""

from __future__ import annotations

import json
import logging
from collections.abc import Collection
from pathlib import Path
from typing import Any

from pseudolidar.commandline.arguments import take_value
from pseudolidar.commandline.choices import resolve
from pseudolidar.commandline.help_text import verb_description
from pseudolidar.commandline.outcome import Report
from pseudolidar.commandline.verbs import RUN_VERB, Verb, load_file, load_verb
from pseudolidar.errors import PseudolidarError, UsageError
from pseudolidar.running.settings_json import (
    FOR_EVERY_VERB,
    TUNED_PARTS,
    TUNED_SCHEMA,
    values_from_json,
)
from pseudolidar.running.settings_schema import settings_fields

_log = logging.getLogger(__name__)
_MAX_SETTINGS_BYTES = 10_000_000  # a run.json holds kilobytes


def execute(args: list[str]) -> Report:
    """Load the verb, read its settings from the arguments, run it.

    Args:
        args: the verb and what follows it, without the switches of every verb; consumed.

    Raises:
        PseudolidarError: the arguments or the input are refused, or the run was stopped.
    """
    verb = _load(args)
    report: Report = verb.run(_settings(verb, args))
    return report


def _load(args: list[str]) -> Verb:
    name = args.pop(0)
    if name != RUN_VERB:
        return load_verb(name)
    if not args or args[0].startswith("-"):
        raise UsageError(
            "no pipeline is named", want="pseudolidar run FILE.py [SOURCE] [OUT] [flags]"
        )
    return load_file(args.pop(0))


def _settings(verb: Verb, args: list[str]) -> Any:
    from pseudolidar.commandline.flags import parse_settings

    file = take_value(args, "--settings")
    given = None if file is None else _values_of(verb, Path(file))
    return parse_settings(
        resolve(verb.settings, args, given),
        args,
        prog=f"pseudolidar {verb.name}",
        description=verb_description(verb.settings, verb.doc),
    )


def _values_of(verb: Verb, file: Path) -> dict[str, Any]:
    """Settings by name from a file: `run.json` of a run, what `tune` found, or settings alone.

    Of what `tune` found a verb takes what it has; the settings of a run must all be known.
    """
    fields = {field.name: field for field in settings_fields(verb.settings)}
    try:
        with file.open("rb") as stream:
            data = json.loads(stream.read(_MAX_SETTINGS_BYTES))
        if not isinstance(data, dict):
            raise UsageError(f"a JSON {type(data).__name__}", want="an object")
        given = data.get("settings", data)
        if not isinstance(given, dict):
            raise UsageError(f"a JSON {type(given).__name__}", want="an object", where="settings")
        if FOR_EVERY_VERB in data:
            given = _tuned_of(data, fields, file)
        values = values_from_json(verb.settings, given)
    except OSError as error:
        raise UsageError(error.strerror or str(error), want="a run.json", path=file) from error
    except (ValueError, RecursionError) as error:
        raise UsageError(f"not JSON: {error}", want="a run.json", path=file) from error
    except PseudolidarError as error:
        raise error.located(file) from None
    return {name: value for name, value in values.items() if not fields[name].this_time}


def _tuned_of(data: dict[str, Any], fields: Collection[str], file: Path) -> dict[str, Any]:
    """What a verb has of the parts that `tune` found; a part that no verb has is a mistake."""
    if data.get("schema") != TUNED_SCHEMA:
        raise UsageError(f"{data.get('schema')}", want=f"{TUNED_SCHEMA}", where="schema")
    if "settings" not in data:
        raise UsageError(f"only {', '.join(data)}", want="'settings'")
    given: dict[str, Any] = data["settings"]
    unused = [name for name in given if name not in fields]
    for name in unused:
        if name not in TUNED_PARTS:
            raise UsageError(f"unknown part {name!r}", want=", ".join(TUNED_PARTS), where=name)
    if unused:
        _log.info("not used here: %s of %s", ", ".join(unused), file)
    return {name: value for name, value in given.items() if name in fields}
