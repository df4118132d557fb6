"""Bins of the reference's depth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

from pseudolidar.errors import UsageError
from pseudolidar.evaluation.ranges import RANGE_BINS_M
from pseudolidar.structures.arrays import Bool, Float64


@dataclass(frozen=True)
class DepthBins:
    """Neighbouring bins of the reference's depth Z, m, as written on the command line.

    Args:
        edges_m: increasing; each bin holds its lower edge and not its upper one.

    Raises:
        UsageError: fewer than two edges, or not increasing from 0 on.
    """

    edges_m: tuple[int, ...]

    def __post_init__(self) -> None:
        rising = all(low < high for low, high in pairwise(self.edges_m))
        if len(self.edges_m) < 2 or self.edges_m[0] < 0 or not rising:
            raise UsageError(
                f"bins with the edges {self}", want="two or more depths, increasing, such as 0,5,10"
            )

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `0,5,10,20`.

        Raises:
            UsageError: an edge that is no whole number of metres, or edges that do not increase.
        """
        parts = [part.strip() for part in text.split(",")]
        if not all(part.isascii() and part.isdecimal() for part in parts):
            raise UsageError(f"{text!r}", want="whole metres, increasing, such as 0,5,10,20")
        return cls(tuple(map(int, parts)))

    def __str__(self) -> str:
        return ",".join(map(str, self.edges_m))

    def __iter__(self) -> Iterator[tuple[int, int]]:
        return pairwise(self.edges_m)

    @property
    def range_m(self) -> tuple[int, int]:
        """From the first edge to the last."""
        return self.edges_m[0], self.edges_m[-1]


def in_bin(reference_m: Float64, bin_m: tuple[int, int]) -> Bool:
    """(N,) which depths are in a bin, its lower edge included."""
    return (reference_m >= bin_m[0]) & (reference_m < bin_m[1])


DEFAULT_BINS = DepthBins((*(low for low, _ in RANGE_BINS_M), RANGE_BINS_M[-1][1]))
