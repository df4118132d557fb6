"""What a run ended with: counts, figures, times; `run.json` and `report.json`."""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pseudolidar import __version__
from pseudolidar.errors import ALL_DONE, SOME_SKIPPED, printable
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.running.settings_json import to_json
from pseudolidar.running.settings_schema import choice_name
from pseudolidar.sources.source import SourceSummary

SCHEMA = 1
# Skipped frames named one by one on the terminal; report.json has all.
NAMED_SKIPS = 5
# What both files say of how many frames there are, and of what is missing.
COUNTS = ("frames", "committed", "lost", "unpaired")
ALREADY_COMPLETE = "the folder is already complete"


class Stopwatch:
    """Times of a run, from when it is made; `lap` once per frame."""

    def __init__(self) -> None:
        self.started = datetime.now(UTC)
        self._begin_s = time.monotonic()
        self.frames, self.cpu_s = 0, 0.0

    def lap(self, cpu_s: float) -> None:
        """One more frame has passed, for which a worker used `cpu_s` processor seconds."""
        self.frames, self.cpu_s = self.frames + 1, self.cpu_s + cpu_s

    @property
    def seconds(self) -> float:
        """Since the start."""
        return time.monotonic() - self._begin_s

    def as_dict(self) -> dict[str, Any]:
        """Times as `run.json` has them."""
        return {
            "started": self.started.isoformat(timespec="seconds"),
            "seconds": round(self.seconds, 3),
            "frames_per_s": round(self.frames / self.seconds, 3),
            "worker_cpu_s_per_frame": round(self.cpu_s / self.frames, 4) if self.frames else None,
        }


@dataclass(frozen=True)
class RunResult:
    """How a run ended.

    Args:
        source: what it read.
        total: frames of the source, refused ones included.
        records: the last record of each frame that is done with.
        passed_now: frames that passed in this run; the others were committed before.
        times: of this run, as in `run.json`.
        ended_by: exit code of the signal or error that ended it early, or 0.
        warnings: what was odd about the pairs when they were looked at before the first frame.
        figures_of_run: what is of no single frame, plain JSON values.
        halted_by: exit code of what was watched for and ended it, for good, or 0.
    """

    source: SourceSummary
    total: int
    records: tuple[FrameRecord, ...]
    passed_now: int
    times: dict[str, Any] = field(default_factory=dict)
    ended_by: int = 0
    warnings: tuple[str, ...] = ()
    figures_of_run: Mapping[str, Any] = field(default_factory=dict)
    halted_by: int = 0

    @property
    def skipped(self) -> tuple[FrameRecord, ...]:
        """Frames that were left out, with the reason."""
        return tuple(record for record in self.records if record.skipped is not None)

    @property
    def committed(self) -> tuple[FrameRecord, ...]:
        """Frames whose results are there."""
        return tuple(record for record in self.records if record.skipped is None)

    @property
    def exit_code(self) -> int:
        """0 all done, 4 something was left out, else of what ended the run early.

        Left out are frames that were skipped or lost, and labels that belong to no frame.
        """
        left_out = self.skipped or self.source.lost or self.source.unpaired
        return self.ended_by or self.halted_by or (SOME_SKIPPED if left_out else ALL_DONE)

    @property
    def ended_early(self) -> bool:
        """Whether frames are left that nobody looked at, or a signal or an error ended the run."""
        halted = self.halted_by != ALL_DONE and len(self.records) < self.total
        return self.ended_by != ALL_DONE or halted

    @property
    def figures(self) -> dict[str, dict[str, float]]:
        """Mean, least and largest value over the frames of every figure that is a number."""
        return _aggregated([record.figures for record in self.committed])

    def as_dict(self) -> dict[str, Any]:
        """Counts, figures and times, plain JSON values."""
        return {
            "frames": self.total,
            "committed": len(self.committed),
            "skipped": len(self.skipped),
            "lost": list(self.source.lost),
            "unpaired": list(self.source.unpaired),
            "passed_now": self.passed_now,
            "ended_early": self.ended_early,
            "exit_code": self.exit_code,
            "figures": self.figures,
            "times": self.times,
            "warnings": list(self.warnings),
            **self.figures_of_run,
        }

    def text(self) -> str:
        """The same for people: what was done, what was not, and what to do about it."""
        left_out = (*self.source.lost, *self.source.unpaired)
        lost = (printable(f"  {line}") for line in left_out)
        skipped = self.skip_lines(NAMED_SKIPS)
        return "\n".join([self._done_line(), *skipped, *lost, *self._stop_lines()])

    def _done_line(self) -> str:
        count = f"{len(self.committed)} of {self.total} frames"
        if not (self.passed_now or self.skipped or self.ended_by):
            so_far = "the run has already stopped here" if self.ended_early else ALREADY_COMPLETE
            return f"{count}: {so_far}, nothing was done"
        before = len(self.committed) - self.passed_now
        kept = f", {before} of them kept from before" if before else ""
        rate = self.times["frames_per_s"]
        return f"{count}{kept}, {self.times['seconds']:.1f} s, {rate:.1f} frames/s"

    def skip_lines(self, most: int) -> list[str]:
        """What was skipped and why, at most so many of them one by one."""
        lines = [
            printable(f"  skipped {record.id}: {record.skipped['code']}: {record.skipped['got']}")
            for record in self.skipped[:most]
            if record.skipped is not None
        ]
        more = len(self.skipped) - most
        return [*lines, f"  ... and {more} more, see report.json"] if more > 0 else lines

    def _stop_lines(self) -> list[str]:
        return ["stopped; the same command continues from here"] if self.ended_by else []


def write_results(folder: Path, result: RunResult, job: object) -> None:
    """Write `run.json` (how the run went, enough to repeat it) and `report.json` (every frame).

    Args:
        folder: output folder.
        result: how the run ended.
        job: settings of the pipeline; their class is named after the verb.

    Raises:
        OutputError: the disk is full or gone.
    """
    summary = {"path": result.source.path, "kind": result.source.kind, "line": result.source.line}
    head = {"schema": SCHEMA, "verb": choice_name(type(job)), "version": __version__}
    source = {"absent": list(result.source.absent), "notes": list(result.source.notes)}
    run = {
        **head,
        "settings": to_json(job),
        "source": summary | source,
        "python": platform.python_version(),
        "machine": platform.machine(),
        **result.as_dict(),
    }
    report = {
        **head,
        **{key: run[key] for key in (*COUNTS, "exit_code", "figures", "warnings")},
        "skipped": [
            {"id": record.id, "index": record.index, **(record.skipped or {})}
            for record in result.skipped
        ],
        "per_frame": [
            {"id": record.id, "index": record.index, **record.figures}
            for record in result.committed
        ],
    }
    for name, content in (("run.json", run), ("report.json", report)):
        write_atomic(folder / name, json.dumps(content, indent=1).encode() + b"\n")


def _aggregated(figures: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    columns: dict[str, list[float]] = {}
    for frame in figures:
        for name, value in frame.items():
            if isinstance(value, int | float) and not isinstance(value, bool):
                columns.setdefault(name, []).append(value)
    return {
        name: {"mean": sum(values) / len(values), "min": min(values), "max": max(values)}
        for name, values in columns.items()
    }
