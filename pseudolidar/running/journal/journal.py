"""The journal of a run: which frames are committed, durably, and with which settings.

One JSON line each: first what the run was started with, then a line for a frame as soon as its
files are durable. A run that was killed is continued by the same command: what the journal names
and the disk still holds whole is kept, everything else is done again.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, BinaryIO, Self

from pseudolidar.formats.atomic import fsync_folder, output_error, write_group
from pseudolidar.running.crew.crew_plan import default_workers
from pseudolidar.running.folder import inside
from pseudolidar.running.journal.journal_file import JOURNAL_NAME, first_line, forget, read_journal
from pseudolidar.running.journal.record import FrameRecord, OutputFile


class Journal:
    """What an output folder holds, and the only way to add to it; use `Journal.open`.

    Args:
        folder: output folder, owned by this run.
        file: the journal, open for appending, with a whole last line.
        committed: ids of the frames whose files are whole.
    """

    def __init__(self, folder: Path, file: BinaryIO, committed: Iterable[str]) -> None:
        self._folder, self._file = folder, file
        self.committed = set(committed)

    @classmethod
    @contextlib.contextmanager
    def open(
        cls,
        folder: Path,
        settings: dict[str, Any],
        *,
        products: Sequence[str] = (),
        overwrite: bool = False,
    ) -> Iterator[Self]:
        """Start the journal of `folder`, or continue the one that is there.

        A last line that a power cut tore is dropped. A journal without a committed frame gives way
        to other settings. Every committed file is compared with its size and hash; frames whose
        files are missing or damaged count as not committed.

        Args:
            folder: output folder, owned by this run.
            settings: all that decides about the bytes of the results, plain JSON values.
            products: names of files that the run will make besides those of its frames.
            overwrite: forget what is there: the files that the journal names are deleted.

        Raises:
            OutputSettings: the folder holds a run with other settings.
            OutputError: the journal cannot be written.
        """
        path = folder / JOURNAL_NAME
        if overwrite:
            forget(folder)
        content = read_journal(path)
        if content is not None and content.holds_results:
            content.check_same(settings, folder)
        elif content is not None and content.settings != settings:
            forget(folder)
            content = None
        try:
            file = path.open("ab", buffering=0)
            os.truncate(path, path.read_bytes().rfind(b"\n") + 1)
        except OSError as error:
            raise output_error(path, error) from error
        with file:
            journal = cls(folder, file, _whole(folder, content.records if content else ()))
            if content is None:
                journal._append(first_line(settings, products))
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
        else:
            self.committed.discard(record.id)

    def records(self) -> list[FrameRecord]:
        """The last record of each frame, read back from the file, in order of the source."""
        content = read_journal(self._folder / JOURNAL_NAME)
        records = content.records if content else ()
        return sorted(records, key=lambda record: -1 if record.index is None else record.index)

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


def _whole(folder: Path, records: Sequence[FrameRecord]) -> list[str]:
    """Ids of committed frames whose files are as they were committed."""

    def check(record: FrameRecord) -> bool:
        return record.skipped is None and all(file.is_whole(folder) for file in record.files)

    with ThreadPoolExecutor(default_workers()) as pool:
        checked = zip(records, pool.map(check, records), strict=True)
        return [record.id for record, good in checked if good]
