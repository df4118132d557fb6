"""What every page about a run tells: what was odd about its source, and what was skipped."""

from __future__ import annotations

from pseudolidar.evaluation.page import Section
from pseudolidar.running.results import RunResult

SKIPS_SHOWN = 50


def notes_section(result: RunResult) -> list[Section]:
    """Warnings and notes of the source and of its frames; none where there are none."""
    lines = [("warning", text) for text in result.warnings]
    lines += [("note", note) for note in result.source.notes]
    lines += [("absent", name) for name in result.source.absent]
    odd: dict[str, int] = {}
    for record in result.committed:
        for note in record.figures.get("notes", ()):
            odd[note] = odd.get(note, 0) + 1
    lines += [(f"{count} frame(s)", note) for note, count in odd.items()]
    return [Section("About the source", table=lines)] if lines else []


def skips_section(result: RunResult) -> list[Section]:
    """Frames that were skipped, with the reason and what to do; none where there are none."""
    if not result.skipped:
        return []
    rows = [
        (record.id, skip["code"], skip["got"], skip.get("fix", ""))
        for record in result.skipped[:SKIPS_SHOWN]
        if (skip := record.skipped) is not None
    ]
    more = len(result.skipped) - len(rows)
    text = "These frames have no output." + (f" {more} more are in report.json." if more else "")
    return [Section("Skipped frames", text, rows)]
