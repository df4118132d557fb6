"""What the viewer holds of the memory stays as it is, whatever five clients do."""

from __future__ import annotations

import pytest

from tests.viewer.soaking import MOST_GROWTH, ROTA_S, Soaked, soaked

MINUTE_S, HALF_HOUR_S = 60.0, 1800.0
# A leak that shows in a minute on a busy machine, too.
LEAK_BYTES = 2_000_000


def judged(seen: Soaked) -> None:
    assert seen.frames > 0
    assert min(seen.times.get(what, 0) for what in ("browser: tab", "take the scene")) > 1
    assert seen.growth <= MOST_GROWTH, seen.ends_mb


@pytest.mark.slow
def test_a_minute():
    judged(soaked(MINUTE_S))


@pytest.mark.slow
@pytest.mark.longest
def test_half_an_hour():
    judged(soaked(HALF_HOUR_S))


@pytest.mark.slow
def test_a_leak_is_seen():
    assert soaked(MINUTE_S, kept_bytes=LEAK_BYTES).growth > 2 * MOST_GROWTH


@pytest.mark.parametrize(("mb_a_s", "grown"), [(0.0, 0.0), (1.0, 0.21)])
def test_growth_is_told_from_turn_to_turn(mb_a_s: float, grown: float):
    """Whatever is held for a moment, and while all becomes warm."""
    seen, turn_s = Soaked(begun_s=3 * ROTA_S), int(ROTA_S)
    for at_s in range(4 * turn_s + 1):
        warming_mb = max(0, 2 * turn_s - at_s) * 5
        moment_mb = 200 if at_s % turn_s == 7 else 0
        seen.held.append((at_s, 300 + mb_a_s * max(at_s - 2 * turn_s, 0) - warming_mb + moment_mb))
    assert seen.growth == pytest.approx(grown, abs=0.03)
