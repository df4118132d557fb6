"""What the viewer holds of the memory while five clients keep it busy.

    python -m tests.benchmarks.viewer_soak [--seconds 60] [--leaking]

`pseudolidar view` is served by a process of its own and plays. A browser turns the scene and goes
through the tabs; of four other clients one does everything that panels offer, one reads all, one
reads nothing for 8 and for 25 s, one comes and goes, and all do the same again every minute. The
median of the memory (PSS) in the last minute is compared with that in the last minute of a warm-up,
which is three minutes, or a sixth of the time. Ends with 1 where it grew by more than 5 %. With
--leaking the server keeps 100 kB of every frame that it draws.
"""

from __future__ import annotations

import argparse
import sys

from tests.viewer.soaking import MOST_GROWTH, ROTA_S, soaked

# Of a frame; 600 are drawn in a minute.
LEAK_BYTES = 100_000


def main() -> int:
    """Soak, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--leaking", action="store_true")
    given = parser.parse_args()
    seconds = max(given.seconds, ROTA_S)
    seen = soaked(seconds, kept_bytes=LEAK_BYTES * given.leaking)
    first_mb, last_mb = seen.ends_mb
    rate_hz = seen.frames / seconds
    print(f"{seen.frames} frames read by one, {rate_hz:.1f} a second; {seen.cpu_s:.0f} s of a core")
    for name, count in sorted(seen.times.items()):
        print(f"  {count:5d}  {name}")
    for at_s, held_mb in seen.held[:: max(len(seen.held) // 40, 1)]:
        print(f"  {at_s - seen.begun_s:7.0f} s  {held_mb:6.0f} MB")
    print(
        f"{first_mb:.0f} MB, then {last_mb:.0f} MB, at most {seen.most_mb:.0f}: {seen.growth:+.1%}"
    )
    return int(seen.growth > MOST_GROWTH)


if __name__ == "__main__":
    sys.exit(main())
