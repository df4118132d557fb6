"""What this installation should hold, by the package's own metadata, and what it does hold."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import metadata

_REQUIREMENT = re.compile(r"^([\w.-]+)\s*(?:>=\s*([\w.]+))?[^;]*(?:;\s*(.*))?$")


@dataclass(frozen=True)
class Library:
    """A library that the package depends on.

    Args:
        name: of the distribution, as pip knows it.
        wanted: lowest version that was tested, empty if any.
        found: installed version, None if there is none.
    """

    name: str
    wanted: str
    found: str | None

    @property
    def fine(self) -> bool:
        """Whether it is installed, and not older than what was tested."""
        return self.found is not None and _numbers(self.found) >= _numbers(self.wanted)

    @property
    def fix(self) -> str:
        """What to do where it is not fine."""
        return "" if self.fine else f'pip install "{self.name}>={self.wanted}"'


def libraries() -> tuple[Library, ...]:
    """The libraries that the package needs, extras left out."""
    found = []
    for text in metadata.requires("pseudolidar") or []:
        match = _REQUIREMENT.match(text)
        if match and "extra" not in (match[3] or ""):
            found.append(Library(match[1], match[2] or "0", _installed(match[1])))
    return tuple(found)


def _installed(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _numbers(version: str) -> tuple[int, ...]:
    """Leading numbers of a version, so that 1.10 is above 1.9."""
    numbers = re.match(r"\d+(\.\d+)*", version)
    return tuple(map(int, numbers[0].split("."))) if numbers else ()
