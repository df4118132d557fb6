"""The command `pseudolidar`: parses, runs one verb, turns an error into a line and an exit code."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from typing import NoReturn, TextIO

from pseudolidar.commandline.arguments import take_switch
from pseudolidar.commandline.outcome import (
    as_known,
    error_object,
    exit_code_of,
    json_text,
    show_error,
)
from pseudolidar.commandline.overview import overview, version_line
from pseudolidar.commandline.streams import (
    escape_what_the_terminal_cannot_show,
    lines_of_the_library,
    output_kept_clean,
    write_result,
)
from pseudolidar.errors import ALL_DONE, Interrupted, UsageError
from pseudolidar.running.blas_threads import use_one_blas_thread
from pseudolidar.running.crew.given_up import still_working
from pseudolidar.running.kernel_cache import prepare_kernel_cache
from pseudolidar.running.lingering import linger
from pseudolidar.running.signals import Stopped, StopSignals

# New objects after which the collector of garbage looks for cycles, and the rounds of the older
# generations. Loading a verb makes some hundred thousand objects that stay; by Python's own
# numbers a tenth of a short run goes into looking through them in vain.
GARBAGE_THRESHOLDS = (50_000, 20, 50)
# What to do after Ctrl-C, where a verb does not say it.
CONTINUES = "Run the same command again: where it has an output folder, it continues."


def main(argv: list[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: arguments after the program's name; those of the process if None.

    Returns:
        The process status: 0 done, 2 usage, 3 input refused, 4 some frames skipped, 5 environment,
        6 workers lost, 130 and 143 interrupted, 1 a bug.
    """
    args = list(sys.argv[1:] if argv is None else argv)
    escape_what_the_terminal_cannot_show()
    if not args or args[0] in ("-h", "--help"):
        write_result(sys.stdout if args else sys.stderr, overview())
        return ALL_DONE if args else UsageError.exit_code
    if args[0] == "--version":
        write_result(sys.stdout, version_line())
        return ALL_DONE
    prepare_kernel_cache()
    use_one_blas_thread()
    as_json, debug = take_switch(args, "--json"), take_switch(args, "--debug")
    results = output_kept_clean() if as_json else contextlib.nullcontext(sys.stdout)
    with results as out, lines_of_the_library(), StopSignals():
        return _run(args, out, as_json=as_json, debug=debug)


def _run(args: list[str], out: TextIO, *, as_json: bool, debug: bool) -> int:
    from pseudolidar.commandline.execute import execute

    try:
        report = execute(args)
        write_result(out, json_text(report.as_dict()) if as_json else report.text())
        linger(report.exit_code)
        return report.exit_code
    except SystemExit:  # help was shown
        return ALL_DONE
    except KeyboardInterrupt as stop:
        own = stop.advice if isinstance(stop, Stopped) else ""
        known: Exception = Interrupted("stopped by a signal", fix=own or CONTINUES)
        code = stop.exit_code if isinstance(stop, Stopped) else Interrupted.exit_code
    except Exception as error:
        known = as_known(error)
        code = exit_code_of(known)
    show_error(known, debug=debug)
    if as_json:
        write_result(out, json_text({"error": error_object(known) | {"exit_code": code}}))
    return code


def program() -> NoReturn:
    """Run the command line as a process of its own, and end it.

    A frame that was given up still runs in a thread. The end of the interpreter would meet it
    inside a library, which aborts the process and loses its status, so that is left out.
    """
    gc.set_threshold(*GARBAGE_THRESHOLDS)
    code = main()
    if still_working():
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):  # closed, or nobody reads it any more
                stream.flush()
        os._exit(code)
    sys.exit(code)


if __name__ == "__main__":
    program()
