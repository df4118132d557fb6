"""The journal as a file: read back, compared with a new run, forgotten."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pseudolidar.errors import OutputSettings
from pseudolidar.formats.atomic import output_error
from pseudolidar.running.folder import inside, stays_inside
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.running.settings_json import settings_differences

JOURNAL_NAME = "journal.jsonl"
SCHEMA = 1
ANEW = "Choose another output folder, or pass --overwrite to start anew."


@dataclass(frozen=True)
class JournalContent:
    """What a journal says.

    Args:
        settings: what decides about the bytes of the results.
        products: files that belong to no single frame, finished or not.
        records: the last record of each frame.
    """

    settings: dict[str, Any]
    products: tuple[str, ...]
    records: tuple[FrameRecord, ...]

    @property
    def holds_results(self) -> bool:
        """Whether a frame was ever committed."""
        return any(record.skipped is None for record in self.records)

    def check_same(self, settings: dict[str, Any], folder: Path) -> None:
        """Raise `OutputSettings` where a new run would write other results, with both values."""
        check_same(self.settings, settings, folder)


def check_same(
    before: dict[str, Any],
    settings: dict[str, Any],
    place: Path,
    *,
    holds: str = "the folder holds a run",
    fix: str = ANEW,
) -> None:
    """Refuse a folder, or a file, with the results of other settings.

    Args:
        before: those that its results are of, plain JSON values.
        settings: those of the run that wants to write there.
        place: output folder or file.
        holds: what is there, in words.
        fix: what to do about it.

    Raises:
        OutputSettings: they differ; with both values of the first that does.
    """
    differences = settings_differences(before, settings)
    if not differences:
        return
    name, old, new = differences[0]
    more = f" (and {len(differences) - 1} more)" if len(differences) > 1 else ""
    raise OutputSettings(
        f"{holds} with {name} = {json.dumps(old)}, this one has {json.dumps(new)}{more}",
        want="the same settings to continue it",
        fix=fix,
        path=place,
        where=name,
    )


def first_line(settings: dict[str, Any], products: Sequence[str]) -> dict[str, Any]:
    """What a journal begins with."""
    return {"schema": SCHEMA, "settings": settings, "products": list(products)}


def read_journal(path: Path) -> JournalContent | None:
    """What the journal at `path` says; None where there is none, or not one whole line.

    A line that is no record counts as not written; so does a last line without its end.

    Raises:
        OutputSettings: it is something else.
    """
    lines = path.read_bytes().splitlines(keepends=True) if path.exists() else []
    if not lines or not lines[0].endswith(b"\n"):
        return None
    try:
        header = json.loads(lines[0])
        settings, products = dict(header["settings"]), tuple(map(str, header["products"]))
        schema = header["schema"]
    except (ValueError, KeyError, TypeError) as error:
        raise _unreadable(path, "its first line is damaged") from error
    if schema != SCHEMA:
        raise _unreadable(path, f"schema {schema!r}")
    records: dict[str, FrameRecord] = {}
    for line in (line for line in lines[1:] if line.endswith(b"\n")):
        with contextlib.suppress(ValueError, KeyError, TypeError):
            record = FrameRecord.from_dict(json.loads(line))
            records[record.id] = record
    return JournalContent(settings, products, tuple(records.values()))


def forget(folder: Path) -> None:
    """Delete what the journal of `folder` names, last of all the journal; nothing else.

    Raises:
        OutputError: something cannot be deleted.
    """
    path = folder / JOURNAL_NAME
    with contextlib.suppress(OutputSettings):  # of an unreadable journal only itself is known
        content = read_journal(path)
        if content is not None:
            files = [file.name for record in content.records for file in record.files]
            for name in (*files, *filter(stays_inside, content.products)):
                _remove(inside(folder, name))
    _remove(path)


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise output_error(path, error) from error


def _unreadable(path: Path, what: str) -> OutputSettings:
    return OutputSettings(
        f"the journal cannot be read: {what}",
        want="a journal of this version",
        fix=ANEW,
        path=path,
    )
