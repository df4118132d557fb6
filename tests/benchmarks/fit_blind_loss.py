"""Fit what each piece of evidence is worth where there is no truth, and tell how well it ranks.

    python -m tests.benchmarks.fit_blind_loss [FOLDER FOR WHAT WAS MATCHED] [CANDIDATES]

Candidates are spread over the space that `tune` searches. Their loss by truth and the evidence are
taken on rendered worlds, KITTI and Middlebury; weights are fitted to differences between settings
of one frame. Rank correlations are of kinds of data that were left out of the fit.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.optimize import lsq_linear
from scipy.stats import qmc, spearmanr

from pseudolidar.evaluation.blind import BINS, LEAST_LOSS, PairEvidence, evidence_shares
from pseudolidar.evaluation.matching_loss import (
    GAP_COST,
    as_the_rig_has_it,
    judged_by_reference,
)
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


def matched(frames, candidates, nearest_m):
    """Losses (S, F) by truth, densities (S, F) and evidence (S, F, 22) of candidates."""
    losses, gaps, shares, references = [], [], [], {}
    evidence = [PairEvidence.of(*pair) for pair in frames]
    for candidate in candidates:
        loaded = candidate.matcher.load(min_depth_m=nearest_m)
        matcher = FilteredMatcher(loaded, MapFilters.load(candidate.smooth, candidate.fill))
        row = []
        for (frame, following), pair in zip(frames, evidence, strict=True):
            values = matcher(frame).values
            if frame.id not in references:
                references[frame.id] = as_the_rig_has_it(reference_px(frame), values)
            rows = np.ones(len(values), bool)
            judged = judged_by_reference(values, references[frame.id], rows)
            of_right = matcher(mirrored(frame)).values[:, ::-1]
            then = matcher(following).values if pair.follows else None
            seen = evidence_shares(pair, values, of_right, then, rows)
            row.append((judged.loss, 1 - np.isfinite(values).mean(), seen))
        losses.append([each[0] for each in row])
        gaps.append([each[1] for each in row])
        shares.append([each[2] for each in row])
    return np.array(losses), np.array(gaps), np.array(shares)


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
    """Weights (22,) by which differences from the first settings are those of the loss by truth."""
    basis, least = steps()
    evidence, wanted = [], []
    for losses, gaps, shares in data:
        rest, count = losses - GAP_COST * gaps, np.sqrt(losses[1:].size)
        x = (shares - shares[:1])[1:] / losses[:1, :, None] / count
        evidence.append(x.reshape(-1, sum(BINS)) @ basis)
        wanted.append(((rest - rest[:1])[1:] / losses[:1] / count).ravel())
    x = np.concatenate([*evidence, np.sqrt(RIDGE) * np.eye(basis.shape[1])])
    y = np.concatenate([*wanted, np.zeros(basis.shape[1])])
    return basis @ lsq_linear(x, y, (least, np.full(len(least), np.inf))).x


def ranked(losses, gaps, shares, weights, usual):
    """Rank correlation; losses by truth of what is picked blindly and of the best, by default's."""
    blind = np.maximum(usual + shares @ weights + GAP_COST * gaps, LEAST_LOSS)
    mine, theirs = ((each / each[:1]).mean(1) for each in (losses, blind))
    return spearmanr(mine, theirs)[0], mine[theirs.argmin()], mine.min()


def usual_loss(data, weights):
    """What the first settings lose beyond their evidence."""
    rest = [(loss - share @ weights - GAP_COST * gap)[0] for loss, gap, share in data]
    return float(np.mean([each.mean() for each in rest]))


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
    candidates = int(sys.argv[2]) if len(sys.argv) > 2 else 31
    kinds, data = {}, {}
    for kind, name, frames, nearest_m, disparities in worlds():
        for matcher, settings in MATCHERS.items():
            label = f"{name} {matcher}"
            file = folder / f"{label.replace(' ', '_')}_{candidates}.npz"
            if not file.exists():
                start = settings() if disparities is None else settings(disparities=disparities)
                space = Space.around(Candidate(start))
                places = qmc.Sobol(len(space.dimensions), rng=np.random.default_rng(7))
                tried = [space.candidate(place) for place in places.random(candidates)]
                found = matched(frames, [Candidate(start), *tried], nearest_m)
                np.savez(file, *found)
            with np.load(file) as arrays:
                data[label] = tuple(arrays[key] for key in arrays.files)
            kinds[label] = kind
            print(label, flush=True)
    print("left out of the fit: rank correlation, loss of what is picked, of the best (default 1)")
    figures = []
    for label, own in data.items():
        others = [each for key, each in data.items() if kinds[key] != kinds[label]]
        weights = fitted(others)
        figures.append(ranked(*own, weights, usual_loss(others, weights)))
        print(f"  {label:20} {figures[-1][0]:5.2f} {figures[-1][1]:6.3f} {figures[-1][2]:6.3f}")
    print("  mean                 {:5.2f} {:6.3f} {:6.3f}".format(*np.mean(figures, axis=0)))
    weights = fitted(list(data.values()))
    print("usual", round(usual_loss(list(data.values()), weights), 4))
    for part in np.split(np.round(weights, 4), np.cumsum(BINS)[:-1]):
        print("   ", ", ".join(f"{weight:g}" for weight in part), ",")


if __name__ == "__main__":
    main()
