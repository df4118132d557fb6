"""Makes the folder `pipelines/` the package `pseudolidar.pipelines`, in checkout and wheel.

In the wheel the folder lies beside this module, in a checkout beside the package. Always import
pipelines by the qualified name (`pseudolidar.pipelines.convert`): then classes pickle for worker
processes and exist once.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # a type checker sees the folder alone: pipelines that others build on
    from pipelines import convert as convert

_here = Path(__file__).parent
__path__ = [str(next(p for p in (_here / "pipelines", _here.parent / "pipelines") if p.is_dir()))]
