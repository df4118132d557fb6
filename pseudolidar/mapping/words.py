"""Places by the words that they show: a vocabulary made of what was seen, and an index by word."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pseudolidar.structures.arrays import Float64, Int64, UInt8

Int32 = npt.NDArray[np.int32]

# Words are leaves of a tree: so many branches, and so many leaves on each.
BRANCHES, LEAVES = 64, 64
# The vocabulary is made when so many places were seen, and anew at each of these.
LEARNT_AT = (8, 32, 128, 512)
# It is made of so many descriptors at most.
MOST_LEARNT = 30_000
# A word that more than this share of places shows tells no place.
COMMON_SHARE = 0.5


def nearest(one: UInt8, other: UInt8, count: int = 1) -> tuple[Int32, Int32]:
    """The nearest descriptors of another set, by the bits in which they differ.

    Args:
        one: (N, 32), not empty.
        other: (M, 32), at least `count`.
        count: how many.

    Returns:
        (N, count) bits, ascending, and (N, count) rows of `other`.
    """
    import cv2

    bits, rows = cv2.batchDistance(one, other, cv2.CV_32S, normType=cv2.NORM_HAMMING, K=count)
    return np.asarray(bits, np.int32), np.asarray(rows, np.int32)


@dataclass(frozen=True, eq=False)
class Vocabulary:
    """Words as the nearest branch and its nearest leaf.

    Args:
        branches: (B, 32) descriptors.
        leaves: (B, L, 32) descriptors of each branch.
    """

    branches: UInt8
    leaves: UInt8

    @classmethod
    def of(cls, descriptors: UInt8, seed: int = 0) -> Vocabulary:
        """Made of descriptors (N, 32): some of them are the words; always the same ones.

        Random members serve as well as means here, and cost nothing.
        """
        rng = np.random.default_rng(seed)
        branches = descriptors[rng.choice(len(descriptors), BRANCHES)]
        branch_of = nearest(descriptors, branches)[1][:, 0]
        leaves = np.empty((BRANCHES, LEAVES, descriptors.shape[1]), np.uint8)
        for branch in range(BRANCHES):
            members = np.flatnonzero(branch_of == branch)
            chosen = rng.choice(members, LEAVES) if len(members) else np.zeros(LEAVES, np.intp)
            leaves[branch] = descriptors[chosen]
        return cls(branches, leaves)

    def words(self, descriptors: UInt8) -> Int64:
        """(N,) word of each descriptor (N, 32)."""
        branch = nearest(descriptors, self.branches)[1][:, 0].astype(np.int64)
        a = np.ascontiguousarray(descriptors).view(np.uint64)
        b = np.ascontiguousarray(self.leaves[branch]).view(np.uint64)
        leaf = np.bitwise_count(a[:, None] ^ b).sum(axis=2, dtype=np.int64).argmin(axis=1)
        return np.asarray(branch * LEAVES + leaf)


@dataclass
class WordIndex:
    """Which places show which words.

    Places are numbered as they come. Their similarity is the cosine of their words, each weighted
    by how rare it is.

    Source: Sivic & Zisserman, Video Google, ICCV 2003.
    """

    _vocabulary: Vocabulary | None = None
    _seen: list[UInt8] = field(default_factory=list)
    _sizes: list[int] = field(default_factory=list)
    _newest: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    # Whole numbers of four bytes: of a long path this is what grows.
    _places: dict[int, array[int]] = field(default_factory=dict)

    def add(self, descriptors: UInt8) -> None:
        """The next place."""
        if len(self._sizes) < LEARNT_AT[-1]:
            self._seen.append(descriptors)
        self._sizes.append(0)
        if len(self._sizes) in LEARNT_AT:
            self._learn()
        elif self._vocabulary is not None:
            self._enter(len(self._sizes) - 1, descriptors)

    def _learn(self) -> None:
        every = np.concatenate(self._seen)
        if not len(every):
            return
        self._vocabulary = Vocabulary.of(every[:: max(1, len(every) // MOST_LEARNT)])
        self._places.clear()
        for place, descriptors in enumerate(self._seen):
            self._enter(place, descriptors)
        if len(self._sizes) == LEARNT_AT[-1]:
            self._seen.clear()

    def _enter(self, place: int, descriptors: UInt8) -> None:
        assert self._vocabulary is not None  # asked for once there is one
        self._newest = np.zeros(0, np.int64)
        if not len(descriptors):
            return
        self._newest = np.unique(self._vocabulary.words(descriptors))
        self._sizes[place] = len(self._newest)
        for word in self._newest.tolist():
            self._places.setdefault(word, array("i")).append(place)

    def similar(self) -> Float64:
        """(N,) similarity of all places to the newest one; 0 to itself."""
        count = len(self._sizes)
        shared, own = np.zeros(count), 0.0
        for word in self._newest.tolist():
            places = self._places[word]
            if len(places) > COMMON_SHARE * count:
                continue
            rarity = float(np.log(count / len(places)))
            shared[np.array(places)] += rarity**2
            own += rarity**2
        sizes = np.maximum(1, self._sizes)
        likeness = shared / max(own, 1e-12) / np.sqrt(sizes / sizes[-1])
        likeness[-1] = 0.0
        return np.asarray(likeness)
