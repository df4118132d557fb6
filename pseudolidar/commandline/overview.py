"""What `pseudolidar --help` says: the verbs, one line each."""

from __future__ import annotations

from pseudolidar import __doc__ as package_doc
from pseudolidar import __version__
from pseudolidar.commandline.verbs import RUN_HELP, RUN_VERB, first_line, verb_files


def version_line() -> str:
    """Name and version."""
    return f"pseudolidar {__version__}"


def overview() -> str:
    """Usage and the list of verbs, read from the pipelines' files without importing them."""
    lines = {name: first_line(file) for name, file in verb_files().items()}
    lines[RUN_VERB] = RUN_HELP
    width = max(map(len, lines)) + 2
    verbs = "\n".join(f"  {name:{width}}{text}".rstrip() for name, text in lines.items())
    return f"""usage: pseudolidar VERB [SOURCE] [OUT] [flags]

{package_doc}

verbs:
{verbs}

`pseudolidar VERB --help` shows the flags of a verb, --json and --settings among them;
`pseudolidar --version` tells the version."""
