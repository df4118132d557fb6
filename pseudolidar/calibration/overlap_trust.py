"""How sure the places of pairs are that were fitted to what they see, and what is not believed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pseudolidar.calibration.overlap import Trust
from pseudolidar.calibration.overlap_partners import (
    Partners,
    Sights,
    all_partners,
    system,
    twist_of,
)
from pseudolidar.errors import OverlapInsufficient
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.pose import Pose

# A place that is so many standard deviations from the given one is not believed.
FARTHEST = 4.0
# Frames that the spread of the fit without one of them is taken from; where there are fewer, what
# two pairs share is cut into so many slices.
LEAST_FRAMES, SLICES = 3, 8


def covariance_of(H: Float64, free: Sequence[str], dof: int, chi2: float) -> Float64:
    """(6 n, 6 n) of the twists; wide in directions that nothing holds.

    Args:
        H: (6 n, 6 n) normal matrix.
        free: names of the pairs that may move, n of them.
        dof: how many distances it is from.
        chi2: their weighted sum of squares.
    """
    values, vectors = np.linalg.eigh(H)
    # Each partner counts twice, once from each side.
    scale = 2.0 * max(1.0, chi2 / max(dof - 6 * len(free), 1))
    with np.errstate(divide="ignore"):
        inverse = np.where(values > 0, 1.0 / np.maximum(values, 1e-12), 1e12)
    return np.asarray((vectors * inverse) @ vectors.T * scale)


def common_errors(
    partners: Sequence[Partners], H: Float64, free: Sequence[str], dof: int, chi2: float
) -> Float64:
    """(6 n, 6 n) of errors that all points of a pair share, such as those of its calibration.

    They are taken to be as large, in standard deviations, as what is left of the distances.

    Args:
        partners: of all frames.
        H: (6 n, 6 n) normal matrix.
        free: names of the pairs that may move, n of them.
        dof: how many distances it is from.
        chi2: their weighted sum of squares.
    """
    share = np.sqrt(chi2 / max(dof, 1))
    inverse = np.linalg.pinv(H, rcond=1e-9, hermitian=True)
    total = np.zeros_like(H)
    for name in dict.fromkeys(each.first for each in partners):
        step = share * (inverse @ _pull_of(name, partners, free))
        total += np.outer(step, step)
    return total


def _pull_of(name: str, partners: Sequence[Partners], free: Sequence[str]) -> Float64:
    """(6 n,) how all points of a pair pull that err along their rays by one standard deviation."""
    pulls = np.zeros(6 * len(free))
    for each in partners:
        if name not in (each.first, each.second):
            continue
        own = each.first == name
        along = each.along_first if own else -each.along_second
        pull = each.jacobian.T @ (each.weights * along)
        for other, sign in ((each.first, 1.0), (each.second, -1.0)):
            if other in free:
                pulls[twist_of(free.index(other))] += sign * pull
    return pulls


def spread_of(
    sights: Sights, places: Mapping[str, Pose], free: Sequence[str], gate_m: float
) -> Float64:
    """(6 n,) standard deviations by leaving out one part of what is seen after the other.

    Errors of neighbouring points belong together, which the covariance does not know. Parts are
    frames; where these are few, slices of what two pairs share.

    Args:
        sights: of each frame what each pair sees.
        places: `T_base_link_left` of each pair, as fitted.
        free: names of the pairs that may move, n of them.
        gate_m: how far apart points of one surface may be.
    """
    if len(sights) < LEAST_FRAMES:
        slices = [each.slices(SLICES) for each in all_partners(sights, places, gate_m)]
        parts = [list(part) for part in zip(*slices, strict=True)]
    else:
        parts = [all_partners([frame], places, gate_m) for frame in sights]
    systems = [system(part, free)[:2] for part in parts]
    H = np.sum([H for H, _ in systems], axis=0)
    g = np.sum([g for _, g in systems], axis=0)
    steps = [-np.linalg.lstsq(H - H_part, g - g_part, rcond=1e-6)[0] for H_part, g_part in systems]
    n = len(parts)
    off = np.array(steps) - np.mean(steps, axis=0)
    return np.asarray(np.sqrt((n - 1) / n * (off**2).sum(axis=0)))


# --- what is not believed ------------------------------------------------------------------------


def check_near(name: str, moved: Float64, turned: Float64, trust: Trust) -> None:
    """Refuse a place so far from the given one that another surface was taken for the same.

    Args:
        name: of the pair.
        moved: (3,) m, shift from the place given.
        turned: (3,) rotation vector from it, rad.
        trust: how well places given are known.

    Raises:
        OverlapInsufficient: with what it moved by.
    """
    shift_m, turn_deg = float(np.linalg.norm(moved)), float(np.degrees(np.linalg.norm(turned)))
    far = shift_m > FARTHEST * trust.given_shift_m
    if far or turn_deg > FARTHEST * trust.given_turn_deg:
        raise OverlapInsufficient(
            f"{name}: the surfaces seem to lie on one another {shift_m:.2g} m and {turn_deg:.2g} "
            "degrees from the place given: another wall was taken for the same",
            want=f"places given to {trust.given_shift_m:g} m and {trust.given_turn_deg:g} degrees",
            fix="Measure the places better, take more frames, or say how well they are known: "
            "--trust.given-shift-m, --trust.given-turn-deg.",
            where=f"pair {name}",
        )


def check_held(name: str, covariance: Float64, sigma: Float64, trust: Trust) -> None:
    """Refuse a place that what is seen does not hold.

    Args:
        name: of the pair.
        covariance: (6, 6) of its shift, m, and its turn, rad.
        sigma: (6,) standard deviations that are believed.
        trust: how sure places must be.

    Raises:
        OverlapInsufficient: with the direction.
    """
    shift, turn_deg = float(sigma[:3].max()), float(np.degrees(sigma[3:].max()))
    if shift <= trust.worst_shift_m and turn_deg <= trust.worst_turn_deg:
        return
    values, vectors = np.linalg.eigh(covariance[:3, :3])
    loose = vectors[:, int(np.argmax(values))]
    told = ", ".join(f"{x:.2f}" for x in loose)
    raise OverlapInsufficient(
        f"{name}: known to {shift:.2g} m and {turn_deg:.2g} degrees only, least of all along "
        f"({told}) of the body",
        want=f"{trust.worst_shift_m:g} m and {trust.worst_turn_deg:g} degrees",
        where=f"pair {name}",
    )


def check_connected(
    sights: Sights, places: Mapping[str, Pose], root: str, gate_m: float, least: int
) -> None:
    """Refuse pairs that share too little with those that are tied to the root.

    Args:
        sights: of each frame what each pair sees.
        places: `T_base_link_left` of each pair.
        root: the pair that stays.
        gate_m: how far apart points of one surface may be.
        least: points that two pairs must share.

    Raises:
        OverlapInsufficient: with what each neighbour shares.
    """
    shared = _shared(sights, places, gate_m)
    tied, waiting = {root}, [root]
    while waiting:
        here = waiting.pop()
        for name in places:
            if name not in tied and shared.get(frozenset((here, name)), 0) >= least:
                tied.add(name)
                waiting.append(name)
    for name in places:
        if name not in tied:
            told = ", ".join(_told(name, other, shared) for other in places if other != name)
            raise OverlapInsufficient(
                f"{name} shares too little with the others: {told} points",
                want=f"{least} points that another pair sees as well",
                where=f"pair {name}",
            )


def _shared(sights: Sights, places: Mapping[str, Pose], gate_m: float) -> dict[frozenset[str], int]:
    shared: dict[frozenset[str], int] = {}
    for each in all_partners(sights, places, gate_m):
        key = frozenset((each.first, each.second))
        shared[key] = shared.get(key, 0) + each.count
    return {key: count // 2 for key, count in shared.items()}


def _told(name: str, other: str, shared: Mapping[frozenset[str], int]) -> str:
    return f"{shared.get(frozenset((name, other)), 0)} with {other}"
