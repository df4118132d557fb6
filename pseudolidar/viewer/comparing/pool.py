"""What frames say about clouds against a reference, gathered until it is told."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from pseudolidar.errors import PseudolidarError
from pseudolidar.evaluation.cloud_distances import CloudDistances
from pseudolidar.evaluation.comparison.bins import DEFAULT_BINS, DepthBins
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.comparing.errors import (
    ErrorsByRange,
    Evidence,
    errors_by_range,
    evidence,
    judged_by,
)
from pseudolidar.viewer.comparing.large import compared_stills
from pseudolidar.viewer.comparing.standing import are_standing, reaching
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.octree.tree import Octree

# Every stereo cloud of the scene that can be judged, one beside the other.
EVERY = "every stereo cloud"
# Points that are kept of a cloud's frames together: of the reference, as `compare` does, or of both
# clouds.
MOST_POINTS = 4_000_000
NONE_LARGE: Mapping[str, Octree] = MappingProxyType({})


class Pool:
    """Gathers frame by frame.

    Args:
        name: of the cloud that is judged, or `EVERY`.
        against: what by.
        frames: how many there will be.
    """

    def __init__(self, name: str, against: str, *, frames: int = 1) -> None:
        self.name, self.against = name, against
        self._most = max(1, MOST_POINTS // max(1, frames))
        self._found: dict[str, list[Evidence]] = {}
        self.faults: list[str] = []
        self._standing = False
        # What the figures are of, where that is not all: of the last frame that has such.
        self.notes: tuple[str, ...] = ()

    def add(
        self,
        moment: Moment,
        stills: Mapping[str, PointCloud],
        trees: Mapping[str, Octree] = NONE_LARGE,
    ) -> None:
        """What a frame says; one that cannot be used is among the faults."""
        if moment.fault:
            self.faults.append(f"{moment.id}: {moment.fault}")
        stills, left_out = compared_stills(moment, stills, trees, {self.name, self.against})
        self._standing = are_standing(moment, stills, self.name, self.against)
        middle = [f"Ranges are from the middle of {self.against}."] if self._standing else []
        self.notes = (*left_out, *middle) or self.notes
        for name in names_of(moment, self.name, self.against):
            try:
                found = evidence(moment, stills, name, self.against)
            except PseudolidarError as error:
                self.faults.append(f"{moment.id}: {error}")
                continue
            if found is not None:
                self._found.setdefault(name, []).append(found.thinned(self._most))

    def told(self) -> tuple[ErrorsByRange, ...]:
        """Figures of every cloud that was judged."""
        every = [
            errors_by_range(name, self.against, frames, self._bins(frames))
            for name, frames in self._found.items()
        ]
        return tuple(one for one in every if one is not None)

    def _bins(self, frames: list[Evidence]) -> DepthBins:
        if not self._standing:
            return DEFAULT_BINS
        return reaching(each for each in frames if isinstance(each, CloudDistances))


def names_of(moment: Moment, name: str, against: str) -> tuple[str, ...]:
    """The clouds of a frame that are judged."""
    if name != EVERY:
        return (name,)
    return tuple(each for each in moment.makings if against in judged_by(moment, each))


def choices(moment: Moment, stills: Iterable[str]) -> tuple[tuple[str, ...], ...]:
    """Names of what can be judged, and of what it can be judged by; the likeliest first."""
    clouds = (*moment.clouds, *stills)
    references = tuple(
        dict.fromkeys(by for name in moment.makings for by in judged_by(moment, name))
    )
    every = (EVERY,) if references and len(moment.makings) > 1 else ()
    return (*every, *clouds), (*references, *(name for name in clouds if name not in references))
