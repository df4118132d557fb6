"""Times of two kinds of pictures: which belong together, within a tolerance, never by position."""

from __future__ import annotations

import bisect
from collections.abc import Sequence


def associate(
    first_ns: Sequence[int], second_ns: Sequence[int], *, tolerance_ns: int
) -> list[tuple[int, int]]:
    """Pairs of positions whose times are nearest, each used once, best pairs first.

    Args:
        first_ns: times, in any order.
        second_ns: times, in any order.
        tolerance_ns: largest difference, inclusive.

    Returns:
        (position in first, position in second), in order of the first times.

    Source: `associate.py` of TUM's RGB-D tools, which picks in the same order.
    """
    order = sorted(range(len(second_ns)), key=lambda j: second_ns[j])
    times = [second_ns[j] for j in order]
    candidates = []
    for i, time_ns in enumerate(first_ns):
        begin = bisect.bisect_left(times, time_ns - tolerance_ns)
        end = bisect.bisect_right(times, time_ns + tolerance_ns)
        candidates += [(abs(times[k] - time_ns), time_ns, i, order[k]) for k in range(begin, end)]
    used_first, used_second = set[int](), set[int]()
    pairs = []
    for _, _, i, j in sorted(candidates):
        if i not in used_first and j not in used_second:
            used_first.add(i)
            used_second.add(j)
            pairs.append((i, j))
    return sorted(pairs, key=lambda pair: first_ns[pair[0]])


def nearest(times_ns: Sequence[int], time_ns: int, *, tolerance_ns: int) -> int | None:
    """Position of the time that is nearest in increasing times, None beyond the tolerance."""
    at = bisect.bisect(times_ns, time_ns)
    near = range(max(0, at - 1), min(len(times_ns), at + 1))
    best = min(near, key=lambda k: abs(times_ns[k] - time_ns), default=None)
    return None if best is None or abs(times_ns[best] - time_ns) > tolerance_ns else best
