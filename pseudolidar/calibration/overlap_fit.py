"""Places of the pairs of a body, fitted to the surfaces that several of them see.

Point to plane, all frames and all neighbours in one system: a single frame often shows a road and
one wall, along which its clouds slide, and a chain of pairs around a body closes only together.
Source: Chen and Medioni, Object modelling by registration of multiple range images, 1992; weights:
Cauchy's, on errors along the rays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.calibration.overlap import Overlap, Trust
from pseudolidar.calibration.overlap_board import SharedBoard
from pseudolidar.calibration.overlap_partners import (
    Sights,
    all_partners,
    distances_of,
    system,
    twist_of,
)
from pseudolidar.calibration.overlap_trust import (
    check_connected,
    check_held,
    check_near,
    common_errors,
    covariance_of,
    spread_of,
)
from pseudolidar.geometry.twists import exp_twist, skew
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.pose import Pose

STEPS = 12
# A step smaller than this, m and rad, ends the search with a gate.
SMALL_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class PlaceFound:
    """Where a pair was found to stand.

    Args:
        T_base_link_left: its place.
        rotation_sigma_rad: (3,) standard deviations about the axes of the body.
        translation_sigma_m: (3,) along them.
        moved_m: how far from the place that was given.
        turned_deg: by how much.
        matches: points that have a partner in another pair.
        share: of the points of the pair.
        before_m: median distance of partners from each other's surface, as given.
        after_m: as found.
    """

    T_base_link_left: Pose
    rotation_sigma_rad: Float64
    translation_sigma_m: Float64
    moved_m: float
    turned_deg: float
    matches: int
    share: float
    before_m: float
    after_m: float


def places_found(
    sights: Sights,
    given: Mapping[str, Pose],
    root: str,
    by: Overlap | SharedBoard,
    trust: Trust,
) -> dict[str, PlaceFound]:
    """Find the places of all pairs but one, which stays.

    Args:
        sights: of each frame what each pair sees, by its name.
        given: `T_base_link_left` of each pair, roughly.
        root: the pair that stays.
        by: which points count.
        trust: how well the places given are known, and how sure the result must be.

    Raises:
        OverlapInsufficient: a pair that shares too little with the others, or sees nothing that
            holds it in some direction.
    """
    free = [name for name in given if name != root]
    check_connected(sights, given, root, by.gates_m[0], by.least_matches)
    found = dict(given)
    for gate_m in by.gates_m:
        found = _with_gate(sights, found, free, gate_m, _Prior(given, trust))
    check_connected(sights, found, root, by.gates_m[0], by.least_matches)
    partners = all_partners(sights, found, by.gates_m[-1])
    H, _, dof, chi2 = system(partners, free)
    covariance = covariance_of(H, free, dof, chi2) + common_errors(partners, H, free, dof, chi2)
    spread = spread_of(sights, found, free, by.gates_m[-1])
    doubt = {
        name: _Doubt.of(found[name], covariance, spread, twist_of(at))
        for at, name in enumerate(free)
    }
    for name in free:
        moved, turned = moved_by(given[name], found[name])
        check_near(name, moved, turned, trust)
        check_held(name, doubt[name].covariance, doubt[name].sigma, trust)
    return {name: _place(name, sights, given, found, doubt[name].sigma, by) for name in free}


def _with_gate(
    sights: Sights, places: dict[str, Pose], free: Sequence[str], gate_m: float, prior: _Prior
) -> dict[str, Pose]:
    """Gauss-Newton with partners that are sought anew in each step."""
    for _ in range(STEPS):
        H, g, _, _ = system(all_partners(sights, places, gate_m), free)
        step = np.asarray(-np.linalg.solve(*prior.add(H, g, places, free)), np.float64)
        places = _moved(places, free, step)
        if np.abs(step).max() < SMALL_STEP:
            break
    return places


def _moved(places: Mapping[str, Pose], free: Sequence[str], step: Float64) -> dict[str, Pose]:
    moved = dict(places)
    for at, name in enumerate(free):
        matrix = exp_twist(step[twist_of(at)]) @ places[name].matrix
        moved[name] = Pose(places[name].dst, places[name].src, matrix)
    return moved


@dataclass(frozen=True, eq=False)
class _Prior:
    """What is known of the places before: without it a pair that sees a road alone slides away."""

    given: Mapping[str, Pose]
    trust: Trust

    def add(
        self, H: Float64, g: Float64, places: Mapping[str, Pose], free: Sequence[str]
    ) -> tuple[Float64, Float64]:
        """The system with the squares of what each pair moved and turned since."""
        H, g = H.copy(), g.copy()
        turn = 1.0 / np.radians(self.trust.given_turn_deg) ** 2
        shift = 1.0 / self.trust.given_shift_m**2
        for at, name in enumerate(free):
            block = twist_of(at)
            about = about_place(places[name])
            weights = about.T @ np.diag([shift] * 3 + [turn] * 3) @ about
            H[block, block] += weights
            moved = np.concatenate(moved_by(self.given[name], places[name]))
            g[block] += about.T @ (np.array([shift] * 3 + [turn] * 3) * moved)
        return H, g


def moved_by(before: Pose, after: Pose) -> tuple[Float64, Float64]:
    """(3,) shift of a place, m, and (3,) rotation vector of its turn, rad, in the body's axes."""
    import cv2

    R = after.matrix[:3, :3] @ before.matrix[:3, :3].T
    turn = np.asarray(cv2.Rodrigues(R)[0][:, 0], np.float64)
    return after.translation_m - before.translation_m, turn


def about_place(place: Pose) -> Float64:
    """(6, 6) from a twist of the body's origin to the shift and turn of the place itself.

    A turn about the far origin of the body would be told as a shift.
    """
    about = np.eye(6)
    about[:3, 3:] = -skew(place.translation_m)
    return about


@dataclass(frozen=True, eq=False)
class _Doubt:
    """How sure a place is: (6, 6) covariance of shift, m, and turn, rad; (6,) what is believed."""

    covariance: Float64
    sigma: Float64

    @classmethod
    def of(cls, place: Pose, covariance: Float64, spread: Float64, block: slice) -> _Doubt:
        about = about_place(place)
        own = about @ covariance[block, block] @ about.T
        return cls(own, np.sqrt(np.diag(own) + spread[block] ** 2))


def _place(
    name: str,
    sights: Sights,
    given: Mapping[str, Pose],
    found: Mapping[str, Pose],
    sigma: Float64,
    by: Overlap | SharedBoard,
) -> PlaceFound:
    moved, turned = moved_by(given[name], found[name])
    mine = distances_of(sights, found, name, by.gates_m[-1])
    before = distances_of(sights, given, name, by.gates_m[0])
    total = sum(len(frame[name]) for frame in sights if name in frame)
    return PlaceFound(
        found[name],
        sigma[3:],
        sigma[:3],
        float(np.linalg.norm(moved)),
        float(np.degrees(np.linalg.norm(turned))),
        len(mine),
        len(mine) / max(total, 1),
        _median(before),
        _median(mine),
    )


def _median(values: Float64) -> float:
    return float(np.median(values)) if len(values) else float("nan")
