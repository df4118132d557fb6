"""Tell what is installed, which parts work, and what to do about those that do not.

Examples:
    pseudolidar doctor
    pseudolidar doctor --json
"""

from __future__ import annotations

import platform
import sys
from dataclasses import asdict, dataclass
from typing import Any

from pseudolidar import __version__
from pseudolidar.errors import EnvironmentFault
from pseudolidar.running.installation.environment import Finding, look_at_machine, try_parts
from pseudolidar.running.installation.requirements import Library, libraries
from pseudolidar.running.table import table_text


@dataclass(frozen=True)
class Doctor:
    """Tell what is installed, which parts work, and what to do about those that do not.

    Every part is tried for real: kernels are compiled, files written and read, open3d loaded.
    Ends with 0 if the core works (converting recorded pairs; open3d is not needed for it),
    with 5 otherwise.
    """


@dataclass(frozen=True)
class DoctorReport:
    """What the doctor found.

    Args:
        libraries: what is installed, against what was tested.
        parts: which parts work.
        machine: the machine.
    """

    libraries: tuple[Library, ...]
    parts: tuple[Finding, ...]
    machine: tuple[Finding, ...]

    @property
    def core_works(self) -> bool:
        """Whether pairs can be converted."""
        return all(part.fine for part in self.parts if part.core)

    @property
    def exit_code(self) -> int:
        """0 if the core works, 5 otherwise."""
        return 0 if self.core_works else EnvironmentFault.exit_code

    def as_dict(self) -> dict[str, Any]:
        """All findings."""
        return {
            "version": __version__,
            "python": platform.python_version(),
            "core_works": self.core_works,
            "libraries": [{**asdict(lib), "fine": lib.fine} for lib in self.libraries],
            "parts": [asdict(part) for part in self.parts],
            "machine": [asdict(finding) for finding in self.machine],
        }

    def text(self) -> str:
        """The findings as tables, the verdict, and what to do."""
        rows = [
            (mark(lib.fine), lib.name, lib.found or "absent", f">= {lib.wanted}")
            for lib in self.libraries
        ]
        findings = [(mark(f.fine), f.name, f.found) for f in (*self.parts, *self.machine)]
        head = f"pseudolidar {__version__}, Python {platform.python_version()}, {sys.platform}"
        parts = [head, table_text(rows), table_text(findings), *self._advice(), self._verdict()]
        return "\n\n".join(parts)

    def _advice(self) -> list[str]:
        fixes = [(lib.name, lib.fix) for lib in self.libraries]
        fixes += [(finding.name, finding.fix) for finding in (*self.parts, *self.machine)]
        rows = [row for row in fixes if row[1]]
        return [f"What to do:\n{table_text(rows)}"] if rows else []

    def _verdict(self) -> str:
        if not self.core_works:
            return "The core does not work."
        broken = [part.name for part in self.parts if not part.fine]
        return f"The core works, not so {', '.join(broken)}." if broken else "Everything works."


def run(_doctor: Doctor) -> DoctorReport:
    """Look at the libraries, try the parts, look at the machine."""
    return DoctorReport(libraries(), try_parts(), look_at_machine())


def mark(fine: bool) -> str:
    """What stands before a finding."""
    return "ok" if fine else "NO"
