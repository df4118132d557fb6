"""What can be done with the frames that are looked at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pseudolidar.running.sighting import Seen
from pseudolidar.structures.recorded import Frame
from pseudolidar.viewer.comparing.rigs import RigShop
from pseudolidar.viewer.objects.asking import NOTHING_ASKED, Asked
from pseudolidar.viewer.tuning.tuner import Workshop


@dataclass(frozen=True)
class Means:
    """How the frames of the first sequence are measured and made otherwise.

    Args:
        sighted: a frame to what things in it are measured by; None where they cannot be.
        asked: what is looked for in frames from the start.
        workshop: how frames are made by other settings; None where they cannot be.
        rigs: how frames are made by other rigs; None where they cannot be.
    """

    sighted: Callable[[Frame], Seen] | None = None
    asked: Asked = NOTHING_ASKED
    workshop: Workshop[Any] | None = None
    rigs: RigShop | None = None


NO_MEANS = Means()
