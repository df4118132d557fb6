"""What the second argument of `compare` is: a folder for the results, or another source."""

from __future__ import annotations

import logging
from pathlib import Path

from pseudolidar.errors import SourceUnknown, UsageError
from pseudolidar.evaluation.map_files import is_maps
from pseudolidar.running.products.compared_file import COMPARED_FOLDER
from pseudolidar.running.reports.comparison_files import JSON_NAME
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.synthetic import SYNTHETIC

_log = logging.getLogger(__name__)

# A path that is not there and is named like one of these was meant to be read.
READ_SUFFIXES = frozenset(
    (".mcap", ".bag", ".db3", ".pcd", ".ply", ".bin", ".npz", ".mp4", ".mkv", ".avi")
)


def places(text: str, *, out: Path | None, reference: str | None) -> tuple[Path | None, str | None]:
    """Output folder and other source, once it is known what `text` is; that is said.

    Args:
        text: the second argument.
        out: output folder, where it was given for certain.
        reference: other source, where it was given for certain.

    Raises:
        UsageError: both were given.
    """
    if out is not None and reference is not None:
        raise UsageError(
            f"{text!r} beside --out and --reference", want="one output folder, one reference"
        )
    if out is None and (reference is not None or not is_source(text)):
        _log.info("results: %s", text)
        return Path(text), reference
    _log.info("compared with: %s (--out makes it the output folder)", text)
    return out, text


def check_another(source: str, reference: str) -> None:
    """Refuse a source as its own reference: it would be right everywhere.

    Raises:
        UsageError: both are the same file or folder.
    """
    if reference == source or Path(reference).resolve() == Path(source).resolve():
        raise UsageError(
            "the source as its own reference",
            want="another source to compare with",
            fix="For results in this folder pass --out.",
            path=reference,
        )


def is_source(text: str) -> bool:
    """Whether the argument is another source, and not where the results go.

    It is one if it can be read as a source or as disparity maps, unless `compare` wrote it.

    Raises:
        UsageError: a recording or file that is not there.
    """
    if text.startswith(SYNTHETIC):
        return True
    path = Path(text)
    if not path.exists():
        if path.suffix.lower() in READ_SUFFIXES:
            want = "an output folder, or another source to compare with"
            raise UsageError("no such file", want=want, path=text)
        return False
    if any((path / name).exists() for name in (JSON_NAME, COMPARED_FOLDER)):
        return False
    try:
        recognise(text)
    except SourceUnknown:
        return is_maps(path)
    return True
