"""What a run that is done told, kept: the same command given again says so, and does nothing."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.journal.record import FileRecord, crc32_of
from pseudolidar.running.reports.map_report import MapReport
from pseudolidar.running.run import Run

# Hidden: nobody needs to open it.
FINISHED_FILE = ".finished.json"


@dataclass(frozen=True)
class FinishedReport:
    """What an earlier run told.

    Args:
        done: that there was nothing to do.
        lines: what was told then, for people.
        facts: and for programs, without places.
        out: output folder.
        files: what there is to open.
        exit_code: as then.
    """

    done: str
    lines: tuple[str, ...]
    facts: dict[str, Any]
    out: Path
    files: tuple[Path, ...]
    exit_code: int

    def as_dict(self) -> dict[str, Any]:
        """As the earlier run told it, but that no frame passed now."""
        places = {"out": str(self.out), "files": [str(path) for path in self.files]}
        return {**self.facts, **places, "passed_now": 0}

    def text(self) -> str:
        """The same for people, and what to open."""
        return "\n".join([self.done, *self.lines, *(f"  {path}" for path in self.files)])


class Finished:
    """Keeps what a run told when it was done, and gives it to one that would do the same.

    Args:
        run: in progress.
        asked: everything that is to be made of its frames, and how: plain JSON values.
    """

    def __init__(self, run: Run, asked: Sequence[Any]) -> None:
        self._run, self._path = run, run.folder / FINISHED_FILE
        source = run.source.summary
        same = [run.decided_by, asked, run.source.ids, source.lost, source.unpaired]
        self._same = hashlib.sha256(json.dumps(same, sort_keys=True).encode()).hexdigest()

    def report(self) -> FinishedReport | None:
        """What was told; None where something is left to do.

        That is: a frame that nobody has looked at or that was skipped, and may be mended; a file
        that is not as it was written; other settings, other things asked for.
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
                tuple(map(str, kept["lines"])),
                dict(kept["facts"]),
                self._run.folder,
                tuple(self._run.folder / str(name) for name in kept["files"]),
                int(kept["exit_code"]),
            )
        except (OSError, ValueError, KeyError, TypeError):
            return None  # made again, as if it were not there

    def keep(self, report: MapReport) -> None:
        """Of a run that is done, with its files as they are now.

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
    """Of files, and of all that is in folders."""
    for path in files:
        inner = sorted(path.rglob("*")) if path.is_dir() else [path]
        for file in filter(Path.is_file, inner):
            name = file.relative_to(folder).as_posix()
            yield FileRecord(name, file.stat().st_size, crc32_of(file))
