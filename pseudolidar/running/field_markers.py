"""Marks on the fields of a pipeline's settings: how the command line and the journal treat them."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final


class Marker(enum.Enum):
    """Values for `Annotated[type, ...]` on a settings field."""

    POSITIONAL = "given by its place among the arguments, not by a flag"
    THIS_TIME = "asked for this one run; not repeated by --settings run.json"
    AFTERWARDS = "what is made of the frames once all are done; may be other things the next time"
    RUN_ONLY = "changes how a run goes, never a byte of its results; not part of the settings hash"


AFTERWARDS: Final = Marker.AFTERWARDS
POSITIONAL: Final = Marker.POSITIONAL
RUN_ONLY: Final = Marker.RUN_ONLY
THIS_TIME: Final = Marker.THIS_TIME


@dataclass(frozen=True)
class Recognised:
    """The field's choice is found from the content of the text given by place.

    `source: Annotated[KittiRaw | Folder, Recognised(recognise)]` takes `SOURCE` by place, calls
    `recognise(text)` for its settings, and `--source kitti-raw` forces one member of the union,
    whose first field the text then fills.

    Args:
        by: from the text of the argument to an instance of one member of the union.
    """

    by: Callable[[str], object]
