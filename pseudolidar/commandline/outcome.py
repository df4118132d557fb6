"""What the command line ends with: a report or one sentence, as text or JSON, and an exit code."""

from __future__ import annotations

import json
import math
import sys
import traceback
from pathlib import Path
from typing import Any, Protocol

from pseudolidar.errors import MissingDependency, PseudolidarError, printable

BUG_EXIT_CODE = 1


class Report(Protocol):
    """What `run(settings)` of a pipeline returns."""

    @property
    def exit_code(self) -> int:
        """0 all done, 4 some frames skipped, 5 the environment is not fit."""

    def as_dict(self) -> dict[str, Any]:
        """The object that `--json` prints."""

    def text(self) -> str:
        """The result for people."""


def json_text(data: dict[str, Any]) -> str:
    """One line of JSON: numbers that are not finite become null, paths become text."""
    return json.dumps(_plain(data), allow_nan=False)


def error_object(error: BaseException) -> dict[str, Any]:
    """The fields of the `--json` error object, for an error of ours or any other."""
    if isinstance(error, PseudolidarError):
        return error.as_dict()
    fields = dict.fromkeys(("path", "where", "want", "fix"), "")
    got = {"got": str(error), "code": type(error).__name__, "exit_code": BUG_EXIT_CODE}
    return {**fields, "path": None, "where": _place(error), **got}


def error_line(error: BaseException) -> str:
    """One sentence about an error, for the terminal."""
    if isinstance(error, PseudolidarError):
        return str(error)
    kind = type(error).__name__
    text = printable(" ".join(str(error).split()))
    return f"{kind}: {_place(error)}: {text}. This is a bug; --debug shows where."


def as_known(error: Exception) -> Exception:
    """An error as the one the user can act on: a failed import is a missing dependency."""
    if not isinstance(error, ImportError) or isinstance(error, PseudolidarError):
        return error
    name = (error.name or str(error)).split(".")[0]
    known = MissingDependency(
        f"cannot import {name}: {error}",
        want="an installation with all dependencies",
        fix="Run `pseudolidar doctor`: it names what to install.",
    )
    known.__cause__ = error
    return known


def exit_code_of(error: BaseException) -> int:
    """Process status of an error."""
    return error.exit_code if isinstance(error, PseudolidarError) else BUG_EXIT_CODE


def show_error(error: BaseException, *, debug: bool) -> None:
    """Print one sentence about an error on the standard error, with its traceback if asked for."""
    if debug:
        traceback.print_exception(error, file=sys.stderr)
    sys.stderr.write(error_line(error) + "\n")


def _place(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    return f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""


def _plain(value: Any) -> Any:
    match value:
        case dict():
            return {str(key): _plain(item) for key, item in value.items()}
        case list() | tuple():
            return [_plain(item) for item in value]
        case bool() | int() | str() | None:
            return value
        case float():
            return value if math.isfinite(value) else None
        case Path():
            return str(value)
    tolist = getattr(value, "tolist", None)  # numpy scalars and arrays, without importing numpy
    return _plain(tolist()) if tolist else str(value)
