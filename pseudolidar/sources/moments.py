"""Which frames of several sources are of one moment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.errors import SourceEmpty
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.sources.names import natural_key
from pseudolidar.sources.source import FrameSource
from pseudolidar.sources.timed_pairs import associate

# Of the usual time between frames, how far apart pictures of one moment may be.
TOLERANCE_OF_INTERVAL = 0.4


def moments_of(
    path: str, sources: Sequence[FrameSource], *, tolerance_s: float | None
) -> dict[str, tuple[int | None, ...]]:
    """Frames of one moment: of equal names, else of near times.

    Args:
        path: of all of them, for what is told.
        sources: of each pair.
        tolerance_s: how far apart pictures of one moment may be; by default a share of the usual
            time between frames. Pictures with equal names belong together whatever their times.

    Returns:
        Name of each frame, and its index in each source; None where that has none.

    Raises:
        SourceEmpty: there are none.
    """
    tables = [{name: index for index, name in enumerate(source.ids)} for source in sources]
    if len(tables) == 1 or any(tables[0].keys() & table.keys() for table in tables[1:]):
        names = sorted({name for table in tables for name in table}, key=natural_key)
        return {name: tuple(table.get(name) for table in tables) for name in names}
    times = [source.timestamps_ns for source in sources]
    if not all(times):
        raise SourceEmpty("a pair without frames", want="pictures", path=path)
    tolerance_ns = _tolerance_ns(tolerance_s, times[0])
    found: dict[str, list[int | None]] = {
        name: [index, *[None] * (len(sources) - 1)] for name, index in tables[0].items()
    }
    by_index = list(found.values())
    for number, other in enumerate(times[1:], start=1):
        for first, second in associate(times[0], other, tolerance_ns=tolerance_ns):
            by_index[first][number] = second
    if all(set(indices[1:]) == {None} for indices in by_index):
        raise SourceEmpty(
            "no frames of one moment: neither names nor times of the pairs' pictures agree",
            want="pictures of one moment with equal names, or times "
            f"{tolerance_ns / NS_PER_S:.3g} s apart at most",
            fix="Name the pictures alike, or pass --source.tolerance-s.",
            path=path,
        )
    return {name: tuple(indices) for name, indices in found.items()}


def _tolerance_ns(tolerance_s: float | None, times_ns: Sequence[int]) -> int:
    if tolerance_s is not None:
        return round(tolerance_s * NS_PER_S)
    steps = np.diff(np.asarray(times_ns, np.int64))
    return int(TOLERANCE_OF_INTERVAL * float(np.median(steps))) if len(steps) else 0
