"""The search: defaults first, then rounds of candidates, the better part of each judged further."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.evaluation.matching_loss import Judgement
from pseudolidar.running.tuning.clearly import clearly_better, shares_of_first
from pseudolidar.running.tuning.judged import JudgedFrame, JudgedFrames
from pseudolidar.running.tuning.space import Candidate, Space
from pseudolidar.running.tuning.trials import FAILED, Trial, Trials, key_of
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame

Place = tuple[float, ...]
# Candidates of the first round, spread evenly, and of each later one.
FIRST_ROUND, ROUND = 16, 12
# Of a round, the best of each step are judged on more frames: a third.
KEPT_SHARE = 3
# Parents of new candidates: the best that were judged on all frames.
PARENTS = 4
# So many of the best are remembered: those who may become parents as others drop out.
REMEMBERED = 12
# New candidates: share that is drawn anywhere, share of settings that a child changes, and by how
# much (one standard deviation of the unit cube) at first and at last, falling by a factor a round.
ANYWHERE, CHANGED, CROSSED = 0.2, 0.35, 0.4
STEP_FIRST, STEP_LAST, STEP_FALL = 0.2, 0.04, 0.93
# A better candidate is better by this much of the loss.
BETTER = 1e-4


class BudgetSpent(Exception):
    """The time is over; what was judged is kept."""


@dataclass
class Budget:
    """Time that a search may take.

    Args:
        seconds: of it.
    """

    seconds: float
    _begin_s: float = field(default_factory=time.monotonic)

    @property
    def spent_s(self) -> float:
        """Since the start."""
        return time.monotonic() - self._begin_s

    def check(self) -> None:
        """Raise `BudgetSpent` where it is over."""
        if self.spent_s >= self.seconds:
            raise BudgetSpent


@dataclass(frozen=True)
class Scored:
    """A candidate that was judged on all frames to tune on.

    Args:
        candidate: the settings.
        place: where it is in the unit cube.
        score: mean over the frames of its loss as a share of the first settings'; less is better.
    """

    candidate: Candidate
    place: Place
    score: float


@dataclass
class Search:
    """A search that can be stopped at any time.

    It is a function of the space, the frames and the seed alone: time decides only where it ends,
    and what was judged before is taken from the journal.

    Args:
        space: what is varied.
        frames: what candidates are judged on.
        loader: settings to what matches.
        trials: what was judged.
        budget: time.
        seed: of all chance.
        workers: frames that are matched at the same time.
        on_best: called with each candidate that is better than all that were taken before on the
            frames to tune on, and clearly better than the first settings on those held back; with
            its score there.
        progress: called after each judged frame, with the number of candidates begun.
    """

    space: Space
    frames: JudgedFrames
    loader: Callable[[Candidate], StereoMatcher]
    trials: Trials
    budget: Budget
    seed: int
    workers: int
    on_best: Callable[[Scored, float], None]
    progress: Callable[[int], None] = lambda _begun: None
    tried: dict[str, Candidate] = field(default_factory=dict)
    _elite: list[Scored] = field(default_factory=list)
    _taken: list[Scored] = field(default_factory=list)

    def run(self, *, most_candidates: int | None = None) -> None:
        """Until the time is over, or so many candidates were begun."""
        try:
            self._first()
            for number, places in enumerate(self._rounds()):
                if most_candidates is not None and len(self.tried) >= most_candidates:
                    return
                self._halve(places, number)
        except BudgetSpent:
            return

    @property
    def repeats_only(self) -> bool:
        """Whether nothing was judged yet that an earlier run has not judged."""
        return 0 < self.trials.restored == len(self.trials.known)

    @property
    def best(self) -> Scored:
        """The best on the frames to tune on."""
        return self._elite[0]

    def score(self, candidate: Candidate, frames: Sequence[JudgedFrame]) -> float:
        """Mean loss of a judged candidate as a share of the first settings'."""
        own, first = (self.judgements(each, frames) for each in (candidate, self.space.start))
        return float(np.mean(shares_of_first(own, first)))

    def seconds(self, candidate: Candidate, frames: Sequence[JudgedFrame]) -> float:
        """How long a map of a judged candidate took: the quickest, others were disturbed."""
        key = key_of(candidate)
        return min(self.trials.known[key, part.id].seconds for part in frames)

    def judged_on(self, candidate: Candidate) -> tuple[JudgedFrame, ...]:
        """The frames to tune on that a candidate was judged on."""
        key = key_of(candidate)
        return tuple(p for p in self.frames.tuned_on if (key, p.id) in self.trials.known)

    def judgements(self, candidate: Candidate, frames: Sequence[JudgedFrame]) -> list[Judgement]:
        """How a candidate was judged on each frame."""
        key = key_of(candidate)
        return [self.trials.known[key, part.id].judgement for part in frames]

    def _first(self) -> None:
        """The first settings on all frames, held back ones included, whatever time it takes."""
        start = self.space.start
        self._note(start)
        self._judge([start], (*self.frames.tuned_on, *self.frames.held), limited=False)
        for part in (*self.frames.tuned_on, *self.frames.held):
            if self.trials.known[key_of(start), part.id].judgement == FAILED:  # say why
                part(self.loader(start))
        self._elite = [Scored(start, self.space.origin, 1.0)]
        self._taken = self._elite[:]
        self.on_best(self._elite[0], 1.0)

    def _rounds(self) -> Iterator[list[Place]]:
        from scipy.stats import qmc

        dimensions = len(self.space.dimensions)
        spread = qmc.Sobol(dimensions, rng=np.random.default_rng([self.seed, 0]))
        yield [tuple(map(float, place)) for place in spread.random(FIRST_ROUND)]
        number = 1
        while True:
            yield self._children(np.random.default_rng([self.seed, number]), number)
            number += 1

    def _children(self, rng: np.random.Generator, number: int) -> list[Place]:
        step = max(STEP_LAST, STEP_FIRST * STEP_FALL**number)
        parents = [np.array(scored.place) for scored in self._elite[:PARENTS]]
        children: list[Place] = []
        for _ in range(ROUND):
            if rng.random() < ANYWHERE:
                child = rng.random(len(self.space.dimensions))
            else:
                child = parents[rng.integers(len(parents))].copy()
                if rng.random() < CROSSED:
                    other = parents[rng.integers(len(parents))]
                    child = np.where(rng.random(len(child)) < 0.5, child, other)
                moved = rng.random(len(child)) < CHANGED
                moved[rng.integers(len(child))] = True
                child = child + moved * rng.normal(0, step, len(child))
                child = 1 - np.abs(1 - np.abs(child))  # what leaves the cube is reflected
            children.append(tuple(float(np.clip(each, 0, 1)) for each in child))
        return children

    def _halve(self, places: Sequence[Place], number: int) -> None:
        """Judge a round on one frame, its better third on more, the best of them on all."""
        unique: dict[str, tuple[Candidate, Place]] = {}
        for place in places:
            candidate = self.space.candidate(place)
            key = key_of(candidate)
            if key not in self.tried:
                unique.setdefault(key, (candidate, place))
        left = list(unique.values())
        tuned_on = _from(self.frames.tuned_on, number)
        for candidate, _ in left:
            self._note(candidate)
        for judged in _steps(len(tuned_on)):
            self._judge([candidate for candidate, _ in left], tuned_on[:judged])
            scores = [self.score(candidate, tuned_on[:judged]) for candidate, _ in left]
            order = np.argsort(scores, kind="stable")
            if judged == len(tuned_on):
                for i in order:
                    self._enter(Scored(left[i][0], left[i][1], scores[i]))
                return
            left = [left[i] for i in order[: max(1, -(-len(left) // KEPT_SHARE))]]

    def _enter(self, scored: Scored) -> None:
        """Take a fully judged candidate among the best; where it may be the one, look at the rest.

        What is best on the frames to tune on may be so by chance: it stays a parent, and the next
        best have their turn.
        """
        self._elite = sorted([*self._elite, scored], key=lambda each: each.score)[:REMEMBERED]
        if scored.score >= self._taken[-1].score * (1 - BETTER):
            return
        held = self.frames.held
        self._judge([scored.candidate], held)
        own, first = (self.judgements(c, held) for c in (scored.candidate, self.space.start))
        if clearly_better(own, first, self.frames.by):
            self._taken.append(scored)
            self.on_best(scored, self.score(scored.candidate, held))

    def _note(self, candidate: Candidate) -> None:
        self.tried[key_of(candidate)] = candidate

    def _judge(
        self,
        candidates: Sequence[Candidate],
        frames: Sequence[JudgedFrame],
        *,
        limited: bool = True,
    ) -> None:
        """Judge every candidate on every frame, as far as that was not done."""
        jobs = [
            (candidate, part)
            for candidate in candidates
            for part in frames
            if (key_of(candidate), part.id) not in self.trials.known
        ]
        with ThreadPoolExecutor(self.workers) as pool:
            for begin in range(0, len(jobs), self.workers):
                if limited:
                    self.budget.check()
                some = jobs[begin : begin + self.workers]
                for (candidate, _), trial in zip(some, pool.map(self._tried, some), strict=True):
                    self.trials.add(candidate, trial)
                    self.progress(len(self.tried))

    def _tried(self, job: tuple[Candidate, JudgedFrame]) -> Trial:
        candidate, part = job
        try:
            matcher = _Timed(self.loader(candidate))
            judgement = part(matcher)
        except PseudolidarError:  # nothing can be matched with such settings
            return Trial(key_of(candidate), part.id, FAILED, math.inf)
        return Trial(key_of(candidate), part.id, judgement, round(matcher.seconds, 4))


@dataclass
class _Timed:
    """A matcher that knows how long its quickest map took."""

    matcher: StereoMatcher
    seconds: float = math.inf

    def __call__(self, frame: StereoFrame) -> DisparityMap:
        begin_s = time.perf_counter()
        found = self.matcher(frame)
        self.seconds = min(self.seconds, time.perf_counter() - begin_s)
        return found


def _from(frames: Sequence[JudgedFrame], number: int) -> tuple[JudgedFrame, ...]:
    """The frames, from another one on in each round: none decides alone who goes on."""
    first = number % len(frames)
    return (*frames[first:], *frames[:first])


def _steps(frames: int) -> list[int]:
    """On how many frames the candidates of a round are judged, step by step: 1, a third, all."""
    return sorted({1, max(1, -(-frames // KEPT_SHARE)), frames})
