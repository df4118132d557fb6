"""Fit what each piece of evidence is worth where there is no truth, and tell how well it ranks.

    python -m tests.benchmarks.fit_blind_loss [FOLDER FOR WHAT WAS MATCHED] [CANDIDATES]

Candidates are spread over the space that `tune` searches, half of them near the defaults. Their
errors by truth and the evidence are taken on rendered worlds, KITTI and Middlebury; weights are
fitted to differences of the errors of matched pixels between settings of one frame. Then what a gap
costs decides: rank correlations with the loss by truth are told for some costs, of kinds of data
that were left out of the fit.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.optimize import lsq_linear
from scipy.stats import qmc, spearmanr

from pseudolidar.evaluation.blind import (
    BINS,
    GAP_COST,
    LEAST_LOSS,
    PairEvidence,
    evidence_shares,
)
from pseudolidar.evaluation.matching_loss import as_the_rig_has_it, judged_by_reference
from pseudolidar.running.tuning.judged import mirrored, reference_px
from pseudolidar.running.tuning.space import Candidate, Space
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.map_filter import FilteredMatcher, MapFilters
from pseudolidar.stereo.sgbm import Sgbm
from tests.conftest import DATA
from tests.stereo.motorcycle import DISPARITIES, motorcycle

MATCHERS = {"census": Census, "sgbm": Sgbm}
RIDGE = 1e-3
SMALL_PX = 480
# Errors count in proportion up to this.
MOST_PX = 3.0
# Settings near the first ones: share of them that differs, and by how much of their range.
CHANGED, NEAR = 0.5, 0.2
GAP_COSTS = (0.1, 0.2, 0.3, GAP_COST, 0.4, 0.5)
NEAREST_M = {"room": 1.0}


def worlds():
    """Kind of data, name, and pairs with the pair after them."""
    for world, seed in (
        ("street", 2),
        ("room", 1),
        ("flight", 3),
        ("street", 7),
        ("room", 5),
        ("flight", 8),
    ):
        source = Synthetic(world, frames=30, seed=seed, width_px=SMALL_PX).open()
        frames = [(source.load(index), source.load(index + 1)) for index in (3, 17)]
        yield world, f"{world} {seed}", frames, NEAREST_M.get(world, 3.0), None
    yield "middlebury", "motorcycle", [(motorcycle(DATA), None)], 3.0, DISPARITIES
    stereo = recognise(str(DATA / "kitti_stereo2015" / "training")).open()
    yield "kitti", "kitti 2015", [(stereo.load(index), None) for index in (0, 12)], 3.0, None
    raw = recognise(str(DATA / "kitti_raw" / "2011_09_26")).open()
    yield "kitti", "kitti raw", [(raw.load(2), raw.load(3))], 3.0, None


def sampled(space, count):
    """Half of the places spread over the whole space, half near the first settings."""
    rng = np.random.default_rng(7)
    spread = qmc.Sobol(len(space.dimensions), rng=rng).random(count // 2)
    origin = np.array(space.origin)
    steps = rng.normal(0, NEAR, (count - len(spread), len(origin)))
    moved = origin + steps * (rng.random(steps.shape) < CHANGED)
    return [*spread, *np.clip(1 - np.abs(1 - np.abs(moved)), 0, 1)]


def matched(frames, candidates, nearest_m):
    """Of candidates (S, F): losses by truth, errors of matched pixels, gaps, evidence (.., 22)."""
    references, rows = {}, []
    evidence = [PairEvidence.of(*pair) for pair in frames]
    for candidate in candidates:
        loaded = candidate.matcher.load(min_depth_m=nearest_m)
        matcher = FilteredMatcher(loaded, MapFilters.load(candidate.smooth, candidate.fill))
        row = []
        for (frame, following), pair in zip(frames, evidence, strict=True):
            values = matcher(frame).values
            if frame.id not in references:
                references[frame.id] = as_the_rig_has_it(reference_px(frame), values)
            reference = references[frame.id]
            every = np.ones(len(values), bool)
            loss = judged_by_reference(values, reference, every).loss
            off = np.minimum(np.abs(values - reference)[np.isfinite(reference)] / MOST_PX, 1)
            of_right = matcher(mirrored(frame)).values[:, ::-1]
            then = matcher(following).values if pair.follows else None
            seen = evidence_shares(pair, values, of_right, then, every)
            gaps = 1 - np.isfinite(values).mean()
            row.append((loss, np.nansum(off) / len(off), gaps, seen))
        rows.append(row)
    return tuple(np.array([[each[i] for each in row] for row in rows]) for i in range(4))


def steps():
    """(22, 19) what weights are made of, and the least of each: worse evidence never costs less.

    A level for all matched pixels and one for those with texture, steps from bin to bin, and what
    the last bins of the first and the fourth kind cost, where there is no evidence.
    """
    columns, least = [], []
    ends = np.cumsum(BINS)
    begins = ends - BINS
    every = np.eye(sum(BINS))

    def add(begin, end, at_least):
        columns.append(every[begin:end].sum(0))
        least.append(at_least)

    add(begins[0], ends[0], -np.inf)
    add(begins[2] + 1, ends[2], -np.inf)
    for kind, unknown in ((0, 1), (1, 0), (3, 1), (4, 0)):
        for begin in range(begins[kind] + 1, ends[kind] - unknown):
            add(begin, ends[kind] - unknown, 0)
        if unknown:
            add(ends[kind] - 1, ends[kind], 0)
    return np.array(columns).T, np.array(least)


def fitted(data):
    """Weights (22,) by which differences from the first settings are those of the errors."""
    basis, least = steps()
    evidence, wanted = [], []
    for losses, errors, _, shares in data:
        count = np.sqrt(losses[1:].size)
        x = (shares - shares[:1])[1:] / errors[:1, :, None] / count
        evidence.append(x.reshape(-1, sum(BINS)) @ basis)
        wanted.append(((errors - errors[:1])[1:] / errors[:1] / count).ravel())
    x = np.concatenate([*evidence, np.sqrt(RIDGE) * np.eye(basis.shape[1])])
    y = np.concatenate([*wanted, np.zeros(basis.shape[1])])
    return basis @ lsq_linear(x, y, (least, np.full(len(least), np.inf))).x


def ranked(losses, gaps, shares, weights, usual, gap_cost):
    """Rank correlation; promise and loss by truth of the pick, and the best loss; default 1."""
    blind = np.maximum(usual + shares @ weights + gap_cost * gaps, LEAST_LOSS)
    mine, theirs = ((each / each[:1]).mean(1) for each in (losses, blind))
    best = theirs.argmin()
    return spearmanr(mine, theirs)[0], theirs[best], mine[best], mine.min()


def usual_loss(data, weights):
    """What the first settings lose beyond their evidence."""
    return float(np.mean([(errors - shares @ weights)[0].mean() for _, errors, _, shares in data]))


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
    candidates = int(sys.argv[2]) if len(sys.argv) > 2 else 32
    kinds, data = {}, {}
    for kind, name, frames, nearest_m, disparities in worlds():
        for matcher, settings in MATCHERS.items():
            label = f"{name} {matcher}"
            file = folder / f"{label.replace(' ', '_')}_{candidates}.npz"
            if not file.exists():
                start = settings() if disparities is None else settings(disparities=disparities)
                space = Space.around(Candidate(start))
                tried = [space.candidate(place) for place in sampled(space, candidates)]
                found = matched(frames, [Candidate(start), *tried], nearest_m)
                np.savez(file, *found)
            with np.load(file) as arrays:
                data[label] = tuple(arrays[key] for key in arrays.files)
            kinds[label] = kind
            print(label, flush=True)
    print("left out of the fit: rank correlation, promise and loss of the pick, best; default 1")
    for gap_cost in GAP_COSTS:
        figures = []
        print(f"a gap costs {gap_cost}")
        for label, (losses, _, gaps, shares) in data.items():
            others = [each for key, each in data.items() if kinds[key] != kinds[label]]
            weights = fitted(others)
            usual = usual_loss(others, weights)
            figures.append(ranked(losses, gaps, shares, weights, usual, gap_cost))
            print(f"  {label:20}", "  ".join(f"{each:5.2f}" for each in figures[-1]))
        print(f"  {'mean':20}", "  ".join(f"{each:5.2f}" for each in np.mean(figures, axis=0)))
    weights = fitted(list(data.values()))
    print("usual", round(usual_loss(list(data.values()), weights), 4))
    for part in np.split(np.round(weights, 4), np.cumsum(BINS)[:-1]):
        print("   ", ", ".join(f"{weight:g}" for weight in part), ",")


if __name__ == "__main__":
    main()
