"""The journal of a run: which frames are committed, durably, and with which settings.

One JSON line each: first what the run was started with, then a line for a frame as soon as its
files are durable. A run that was killed is continued by the same command: what the journal names
and the disk still holds whole is kept, everything else is done again.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, BinaryIO, Self

from pseudolidar.errors import OutputSettings, PseudolidarError
from pseudolidar.formats.atomic import fsync_folder, output_error, write_group
from pseudolidar.running.folder import inside
from pseudolidar.running.record import FrameRecord, OutputFile
from pseudolidar.running.settings_json import settings_differences
from pseudolidar.running.stream import default_workers

JOURNAL_NAME = "journal.jsonl"
SCHEMA = 1


class Journal:
    """What an output folder holds, and the only way to add to it; use `Journal.open`.

    Args:
        folder: output folder, owned by this run.
        file: the journal, open for appending, with a whole last line.
        records: what it held when it was opened, damaged frames left out.
    """

    def __init__(self, folder: Path, file: BinaryIO, records: Sequence[FrameRecord]) -> None:
        self._folder, self._file = folder, file
        self.committed = {record.id for record in records if record.skipped is None}

    @classmethod
    @contextlib.contextmanager
    def open(
        cls, folder: Path, settings: dict[str, Any], *, overwrite: bool = False
    ) -> Iterator[Self]:
        """Start the journal of `folder`, or continue the one that is there.

        A last line that a power cut tore is dropped. Every committed file is compared with its
        size and hash; frames whose files are missing or damaged count as not committed.

        Args:
            folder: output folder, owned by this run.
            settings: all that decides about the bytes of the results, plain JSON values.
            overwrite: forget what is there: the files that the journal names are deleted.

        Raises:
            OutputSettings: the folder holds a run with other settings.
            OutputError: the journal cannot be written.
        """
        path = folder / JOURNAL_NAME
        if overwrite:
            _forget(folder)
        try:
            records = _whole(folder, _continued(path, settings))
            file = path.open("ab", buffering=0)
        except OSError as error:
            raise output_error(path, error) from error
        with file:
            journal = cls(folder, file, records)
            if not path.stat().st_size:
                journal._append({"schema": SCHEMA, "settings": settings})
                fsync_folder(folder)
            yield journal

    def commit(self, record: FrameRecord, files: Sequence[OutputFile] = ()) -> None:
        """Make the files of a frame durable, and then its line.

        Raises:
            OutputError: the disk is full or gone; the frame is then not committed.
        """
        write_group({inside(self._folder, file.name): file.data for file in files})
        self._append(record.as_dict())
        if record.skipped is None:
            self.committed.add(record.id)

    def records(self) -> list[FrameRecord]:
        """The last record of each frame, read back from the file, in order of the source."""
        last = {record.id: record for record in _read(self._folder / JOURNAL_NAME)[1]}
        return sorted(last.values(), key=lambda r: -1 if r.index is None else r.index)

    def _append(self, entry: dict[str, Any]) -> None:
        line = json.dumps(entry, separators=(",", ":")).encode() + b"\n"
        begin = os.fstat(self._file.fileno()).st_size
        try:
            written = self._file.write(line)
            if written != len(line):
                raise OSError(f"{written} of {len(line)} bytes written")
            os.fsync(self._file.fileno())
        except OSError as error:
            with contextlib.suppress(OSError):
                self._file.truncate(begin)
            raise output_error(self._folder / JOURNAL_NAME, error, len(line)) from error


def _continued(path: Path, settings: dict[str, Any]) -> list[FrameRecord]:
    """Records of the journal at `path`, whose torn last line is cut off."""
    if not path.exists():
        return []
    whole = path.read_bytes().rfind(b"\n") + 1
    os.truncate(path, whole)
    if not whole:
        return []
    header, records = _read(path)
    _check_same(path, header, settings)
    return list({record.id: record for record in records}.values())


def _read(path: Path) -> tuple[dict[str, Any], list[FrameRecord]]:
    """Settings and frame lines; a line that is no record counts as not written."""
    with path.open("rb") as file:
        try:
            header = json.loads(file.readline())
            settings = dict(header["settings"])
            known = header["schema"] == SCHEMA
        except (ValueError, KeyError, TypeError) as error:
            raise _unreadable(path, "its first line is damaged") from error
        if not known:
            raise _unreadable(path, f"schema {header['schema']!r}")
        records = []
        for line in file:
            with contextlib.suppress(ValueError, KeyError, TypeError):
                records.append(FrameRecord.from_dict(json.loads(line)))
        return settings, records


def _whole(folder: Path, records: list[FrameRecord]) -> list[FrameRecord]:
    """The records whose files are as they were committed."""

    def check(record: FrameRecord) -> bool:
        return all(file.is_whole(folder) for file in record.files)

    with ThreadPoolExecutor(default_workers()) as pool:
        return [
            record for record, good in zip(records, pool.map(check, records), strict=True) if good
        ]


def _check_same(path: Path, before: dict[str, Any], now: dict[str, Any]) -> None:
    differences = settings_differences(before, now)
    if not differences:
        return
    name, old, new = differences[0]
    more = f" (and {len(differences) - 1} more)" if len(differences) > 1 else ""
    raise OutputSettings(
        f"the folder holds a run with {name} = {json.dumps(old)}, this one has "
        f"{json.dumps(new)}{more}",
        want="the same settings to continue it",
        fix="Choose another output folder, or pass --overwrite to start anew.",
        path=path.parent,
        where=name,
    )


def _unreadable(path: Path, what: str) -> PseudolidarError:
    return OutputSettings(
        f"the journal cannot be read: {what}",
        want="a journal of this version",
        fix="Choose another output folder, or pass --overwrite to start anew.",
        path=path,
    )


def _forget(folder: Path) -> None:
    """Delete what the journal names, last of all the journal; nothing else is touched."""
    path = folder / JOURNAL_NAME
    if not path.exists():
        return
    with contextlib.suppress(OutputSettings):
        for file in (file for record in _read(path)[1] for file in record.files):
            _remove(inside(folder, file.name))
    _remove(path)


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise output_error(path, error) from error
