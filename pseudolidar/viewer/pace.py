"""How often a browser may say something: what people do by hand, and no more."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Pace:
    """So many a second in the long run, and some at once. Time is handed in.

    Args:
        rate_hz: in the long run.
        burst: at once after a pause.
    """

    rate_hz: float
    burst: int
    _used: float = field(default=0.0, init=False)
    _at_s: float = field(default=0.0, init=False)

    def wait_s(self, now_s: float) -> float:
        """Take one, and tell for how long it has to wait; 0 where it need not."""
        self._pass(now_s)
        self._used += 1
        return max(self._used - self.burst, 0.0) / self.rate_hz

    def allows(self, now_s: float) -> bool:
        """Take one if it need not wait."""
        self._pass(now_s)
        free = self._used + 1 <= self.burst
        self._used += free
        return free

    def _pass(self, now_s: float) -> None:
        self._used = max(self._used - (now_s - self._at_s) * self.rate_hz, 0.0)
        self._at_s = now_s
