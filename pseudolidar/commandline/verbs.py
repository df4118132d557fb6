"""Verbs are files: listed from the folder without importing them, loaded late and by name."""

from __future__ import annotations

import ast
import difflib
import importlib
import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, get_type_hints

from pseudolidar.errors import UsageError
from pseudolidar.running.settings_schema import is_settings

PIPELINES = "pseudolidar.pipelines"
RUN_VERB = "run"
RUN_HELP = "Run a pipeline of your own: `pseudolidar run my_job.py --help`."


@dataclass(frozen=True)
class Verb:
    """A pipeline that is loaded.

    Args:
        name: as typed after `pseudolidar`.
        run: the pipeline's `run(settings)`.
        settings: class of its only parameter.
        doc: docstring of the pipeline's module.
    """

    name: str
    run: Callable[[Any], Any]
    settings: type
    doc: str


def pipelines_folder() -> Path:
    """Where the pipelines of this installation lie."""
    return Path(importlib.import_module(PIPELINES).__path__[0])


def verb_files() -> dict[str, Path]:
    """The verbs of this installation and their files, by name."""
    files = sorted(pipelines_folder().glob("[!_]*.py"))
    return {file.stem.replace("_", "-"): file for file in files}


def first_line(file: Path) -> str:
    """First line of a Python file's docstring, without importing it."""
    try:
        doc = ast.get_docstring(ast.parse(file.read_bytes()))
    except SyntaxError as error:
        return f"(does not load: {error})"
    return doc.splitlines()[0] if doc else ""


def load_verb(name: str) -> Verb:
    """Import the pipeline of a verb.

    Raises:
        UsageError: there is no such verb; the nearest is named.
    """
    files = verb_files()
    if name not in files:
        known = [*files, RUN_VERB]
        raise UsageError(
            f"there is no verb {name!r}",
            want=f"one of {', '.join(known)}",
            fix=did_you_mean(name, known) or "See `pseudolidar --help`.",
        )
    return _verb(name, importlib.import_module(f"{PIPELINES}.{files[name].stem}"))


def load_file(text: str) -> Verb:
    """Import a user's own pipeline file, its folder first on the path as for a script.

    Its module has the file's name, so that its functions and classes pickle for worker processes.

    Raises:
        UsageError: no such Python file, or its name is taken by another module.
    """
    file = Path(text)
    if file.suffix != ".py" or not file.is_file():
        raise UsageError("no such pipeline", want="a Python file with run(settings)", path=text)
    folder = str(file.resolve().parent)
    if folder not in sys.path:
        sys.path.insert(0, folder)
    module = importlib.import_module(file.stem)
    if not module.__file__ or not Path(module.__file__).samefile(file):
        raise UsageError(
            f"a module named {file.stem} exists already: {module.__file__ or 'built in'}",
            fix="Give the pipeline's file another name.",
            path=text,
        )
    return _verb(f"{RUN_VERB} {text}", module)


def did_you_mean(name: str, known: list[str]) -> str:
    """A question with the nearest of the known names, empty if none is near."""
    near = difflib.get_close_matches(name, known, n=1)
    return f"Did you mean {near[0]!r}?" if near else ""


def _verb(name: str, module: ModuleType) -> Verb:
    run = getattr(module, "run", None)
    parameters = list(inspect.signature(run).parameters) if callable(run) else []
    settings = get_type_hints(run).get(parameters[0]) if len(parameters) == 1 else None
    if not callable(run) or not is_settings(settings):
        raise UsageError(
            "not a pipeline",
            want="a function run(settings) whose only parameter is a frozen dataclass",
            path=module.__file__,
        )
    return Verb(name, run, settings, inspect.getdoc(module) or "")
