"""Other people's reader of recordings: the program `rerun`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest


class Rerun:
    """The command line of `rerun-sdk`, with a home of its own and its analytics switched off."""

    def __init__(self, home: Path) -> None:
        self._program = Path(sys.executable).with_name("rerun")
        if not self._program.exists():
            pytest.skip("rerun-sdk is not installed")
        folders = ("HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME")
        self._environment = os.environ | {name: str(home) for name in folders}
        self("analytics", "disable")

    def __call__(self, *arguments: str | Path) -> str:
        result = subprocess.run(
            [self._program, *arguments],
            env=self._environment,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert result.returncode == 0, result.stderr
        assert "ERROR" not in result.stderr
        return result.stdout
