"""What a run told when it was done: the same command given again tells it once more.

So nothing is walked or written a second time where nothing has changed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pseudolidar.errors import PseudolidarError, printable
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.journal.record import FileRecord, crc32_of
from pseudolidar.running.reports.map_report import MapReport
from pseudolidar.running.run import Run

# Hidden: nobody needs to open it.
FINISHED_FILE = ".finished.json"
# What reading raises where the file is absent, torn, or not what a run has kept there; errors of
# ours are those of names that lead out of the folder.
UNREADABLE = (
    OSError,
    ValueError,
    KeyError,
    TypeError,
    OverflowError,
    RecursionError,
    PseudolidarError,
)


@dataclass(frozen=True)
class FinishedReport:
    """What an earlier run told, told again.

    Args:
        done: the line that says that there was nothing to do.
        lines: what the earlier run told people below its first line.
        facts: what it told programs, as its `MapReport.as_dict`.
        out: output folder, where it is now.
        files: what there is to open.
        exit_code: of the earlier run.
    """

    done: str
    lines: tuple[str, ...]
    facts: dict[str, Any]
    out: Path
    files: tuple[Path, ...]
    exit_code: int

    def as_dict(self) -> dict[str, Any]:
        """What the earlier run told, with places as they are now and no frame that passed now."""
        places = {"out": str(self.out), "files": [str(path) for path in self.files]}
        return {**self.facts, **places, "passed_now": 0}

    def text(self) -> str:
        """The same for people: that nothing was done, the figures, and what to open."""
        return "\n".join([self.done, *self.lines, *(f"  {path}" for path in self.files)])


class Finished:
    """Keeps what a run told when it was done, for a later run that would do just the same.

    Args:
        run: in progress; owns the output folder.
        asked: what is to be made of its frames, and how, as plain JSON values: all that is not in
            `run.decided_by`, which decides about single frames.
    """

    def __init__(self, run: Run, asked: Sequence[Any]) -> None:
        self._run, self._path = run, run.folder / FINISHED_FILE
        source = run.source.summary
        same = [run.decided_by, asked, run.source.ids, source.lost, source.unpaired]
        self._same = hashlib.sha256(json.dumps(same, sort_keys=True).encode()).hexdigest()

    def report(self) -> FinishedReport | None:
        """What the earlier run told; None where something is left to do.

        Something is left where a frame was not looked at yet, or was skipped and may be mended by
        now; where a file is not as it was written; where settings differ, or other things are
        asked for.
        """
        result = self._run.result()
        if len(result.committed) != result.total:
            return None
        try:
            kept = json.loads(self._path.read_bytes())
            if kept["same"] != self._same:
                return None
            if not all(FileRecord(**file).is_whole(self._run.folder) for file in kept["whole"]):
                return None
            return FinishedReport(
                result.text().partition("\n")[0],
                tuple(printable(str(line)) for line in kept["lines"]),
                dict(kept["facts"]),
                self._run.folder,
                tuple(self._run.folder / str(name) for name in kept["files"]),
                int(kept["exit_code"]),
            )
        except UNREADABLE:
            return None  # everything is made again, as if the file were not there

    def keep(self, report: MapReport) -> None:
        """Keep the report of a run that is done, with checksums of its files as they are now.

        Args:
            report: with files in the output folder; those that are not there are left out.

        Raises:
            OutputError: the disk is full or gone.
        """
        folder = self._run.folder
        files = [path for path in report.files if path.exists()]
        told = replace(report, files=()).text().splitlines()[1:]
        kept = {
            "same": self._same,
            "lines": told,
            "facts": report.as_dict(),
            "files": [str(path.relative_to(folder)) for path in files],
            "whole": [asdict(one) for one in _records(folder, files)],
            "exit_code": report.exit_code,
        }
        write_atomic(self._path, json.dumps(kept).encode() + b"\n")


def _records(folder: Path, files: Iterable[Path]) -> Iterator[FileRecord]:
    """One for each of the files, and for each file in those that are folders."""
    for path in files:
        inner = sorted(path.rglob("*")) if path.is_dir() else [path]
        for file in filter(Path.is_file, inner):
            name = file.relative_to(folder).as_posix()
            yield FileRecord(name, file.stat().st_size, crc32_of(file))
