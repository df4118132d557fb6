"""What `view` ends with: for people, and for programs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pseudolidar.errors import ALL_DONE
from pseudolidar.viewer.inventory import inventory
from pseudolidar.viewer.opening import Opened


@dataclass(frozen=True)
class ViewReport:
    """What was looked at, and what is left of it.

    Args:
        opened: what the paths were.
        address: URL where it was served, without token; "" where it was not served.
        file: what was exported; None where it was served.
    """

    opened: Opened
    address: str = ""
    file: Path | None = None
    exit_code = ALL_DONE

    def as_dict(self) -> dict[str, Any]:
        """What was opened, and where it was served or written."""
        file = None if self.file is None else str(self.file)
        return {"file": file, "address": self.address or None, "opened": inventory(self.opened)}

    def text(self) -> str:
        """The file alone: the page has told the rest."""
        return "" if self.file is None else f"  {self.file}"
