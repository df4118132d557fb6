"""What `check` says: findings of the pairs of a source, or of each pair of a body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pseudolidar.calibration.check_finding import Finding, percent
from pseudolidar.errors import ALL_DONE, PseudolidarError, printable
from pseudolidar.running.preflight import SourceCheck
from pseudolidar.running.table import table_text

MARKS = {"stop": "STOP", "warn": "warn", "note": "note", "good": "ok", "unknown": "?"}


@dataclass(frozen=True, eq=False)
class CheckReport:
    """What was found.

    Args:
        check: of the source.
        findings: of its pairs together, and of maps.
        picture: where the matches are drawn, if they are.
        out: where a mended rig was wanted, if it was.
        mended: whether there was anything to be put right in it.
    """

    check: SourceCheck
    findings: tuple[Finding, ...]
    picture: Path | None
    out: Path | None = None
    mended: bool = False

    @property
    def exit_code(self) -> int:
        """3 where something would stop a run, else 0."""
        stops = any(finding.severity == "stop" for finding in self.findings)
        return PseudolidarError.exit_code if stops else ALL_DONE

    def as_dict(self) -> dict[str, Any]:
        """Findings of all pairs together, and of each."""
        return {
            "source": self.check.source,
            "path": self.check.path,
            "stops": self.exit_code != ALL_DONE,
            "findings": [finding.as_dict() for finding in self.findings],
            "pairs": [
                {"id": pair.id, "findings": [finding.as_dict() for finding in pair.findings]}
                for pair in self.check.pairs
            ],
            "unreadable": [
                {"id": frame.id, "reason": str(frame.error)} for frame in self.check.failed
            ],
            "picture": None if self.picture is None else str(self.picture),
            "out": str(self.out) if self.mended else None,
        }

    def text(self) -> str:
        """A table of the findings, and what to do."""
        pairs = ", ".join(pair.id for pair in self.check.pairs)
        lines = [self.check.source, f"pairs looked at: {pairs}" if pairs else "no pair fits"]
        rows = [
            (MARKS[f.severity], f.name, f.text, "" if f.sure is None else percent(f.sure))
            for f in self.findings
        ]
        lines.append(table_text(rows, header=("", "what", "seen", "sure")))
        lines += [f"{frame.id} cannot be read: {frame.error}" for frame in self.check.failed]
        mends = {f.name: f.mend for f in self.findings if f.mend}
        if mends:
            lines.append(f"What to do:\n{table_text(list(mends.items()))}")
        lines.append(self._verdict())
        if self.out is not None:
            lines.append(
                f"  {self.out}: pass it to other commands with --rig"
                if self.mended
                else "  no eye is turned: no rig is written"
            )
        if self.picture is not None:
            lines.append(f"  {self.picture}")
        return "\n".join(printable_lines(lines))

    def _verdict(self) -> str:
        by = {s: [f.name for f in self.findings if f.severity == s] for s in MARKS}
        if by["stop"]:
            return f"A run would stop: {', '.join(by['stop'])}."
        if by["warn"]:
            return f"A run would warn: {', '.join(by['warn'])}."
        if any(f.severity == "good" and f.name == "rows" for f in self.findings):
            return "Pairs and calibration fit together."
        return "Nothing is wrong that could be seen; the pairs do not show whether rows correspond."


@dataclass(frozen=True, eq=False)
class BodyCheckReport:
    """What was found of each pair of a body.

    Args:
        source: what was looked at, one line.
        path: of it.
        pairs: what was found, by the name of the pair.
    """

    source: str
    path: str
    pairs: Mapping[str, CheckReport]

    @property
    def exit_code(self) -> int:
        """3 where something would stop a run on one of the pairs, else 0."""
        return max(report.exit_code for report in self.pairs.values())

    def as_dict(self) -> dict[str, Any]:
        """Findings of each pair."""
        return {
            "source": self.source,
            "path": self.path,
            "stops": self.exit_code != ALL_DONE,
            "body": {name: report.as_dict() for name, report in self.pairs.items()},
        }

    def text(self) -> str:
        """The tables of the pairs."""
        parts = [f"{name}: {report.text()}" for name, report in self.pairs.items()]
        return "\n\n".join((printable(self.source), *parts))


def printable_lines(lines: list[str]) -> list[str]:
    """Lines without what a terminal would act on; names of files may hold anything."""
    return [printable(part) for line in lines for part in line.splitlines()]
