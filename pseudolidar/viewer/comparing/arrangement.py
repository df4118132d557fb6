"""Groups of clouds over each other, in turn, or side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pseudolidar.viewer.comparing.companions import Companion
from pseudolidar.viewer.comparing.pool import EVERY
from pseudolidar.viewer.moment import VELODYNE

OVER, IN_TURN, ASIDE = "over each other", "in turn", "side by side"
ONLY = "only "
# What the clouds of the first sequence are called together.
FIRST = "the first"


@dataclass(frozen=True)
class Arrangement:
    """How groups are shown.

    Args:
        mode: over each other, in turn, side by side, or only one of them.
        apart_m: from group to group where they are side by side.
        turn: whose turn it is.
    """

    mode: str = OVER
    apart_m: float = 20.0
    turn: int = 0

    def hidden(self, groups: Mapping[str, Sequence[str]]) -> frozenset[str]:
        """Names of clouds that are not drawn now.

        Args:
            groups: names of clouds by the name of their group.
        """
        names = list(groups)
        if not names or self.mode in (OVER, ASIDE):
            return frozenset()
        shown = names[self.turn % len(names)]
        if self.mode.startswith(ONLY):
            shown = self.mode.removeprefix(ONLY)
        if shown not in groups:
            return frozenset()
        return frozenset(n for name, group in groups.items() if name != shown for n in group)

    def shifts(
        self, groups: Mapping[str, Sequence[str]]
    ) -> Mapping[str, tuple[float, float, float]]:
        """Where clouds are moved to, m in the frame of the rig; what stays is left out."""
        if self.mode != ASIDE:
            return {}
        return {
            name: (0.0, -place * self.apart_m, 0.0)
            for place, group in enumerate(groups.values())
            for name in group
            if place
        }


def modes(groups: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """How such groups can be shown."""
    return (OVER, IN_TURN, ASIDE, *(f"{ONLY}{name}" for name in groups))


def groups_of(
    clouds: Sequence[str],
    companions: Sequence[Companion],
    chosen: Sequence[str],
    *,
    makings: Sequence[str] = (),
    stills: Sequence[str] = (),
) -> dict[str, tuple[str, ...]]:
    """What is shown in turn: the sequences, where there are several, else the chosen clouds.

    The scan belongs to all and stays, as does what lies still in the map.

    Args:
        clouds: of the frame, by name.
        companions: the other sequences.
        chosen: two that are compared; what is no cloud, as the truth, is not shown in turn.
        makings: clouds of the frame that `EVERY` stands for.
        stills: clouds that lie still.
    """
    if not companions:
        named = [each for name in chosen for each in (makings if name == EVERY else (name,))]
        return {name: (name,) for name in named if name in clouds or name in stills}
    groups = {
        one.label: tuple(name for name in clouds if name.startswith(f"{one.label}: "))
        for one in companions
    }
    taken = {VELODYNE, *(name for group in groups.values() for name in group)}
    return {FIRST: tuple(name for name in clouds if name not in taken), **groups}
