"""Points that two pairs of a body see of one surface, and the equations that they make."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np

from pseudolidar.geometry.robust import robust_sigma
from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.pose import Pose

# Residuals beyond so many times what is usual count for less (Cauchy).
CAUCHY = 2.0
# Usual residuals in standard deviations: those hold an error of the rig that all points share, so
# that most residuals are a fraction of them. Not less than this, and not more than one.
LEAST_USUAL = 0.05


@dataclass(frozen=True, eq=False)
class Between:
    """Two pairs of a body.

    Args:
        first: name of the one whose points are compared.
        second: of the one that they are compared with.
        T_body_first: its place, `T_base_link_left`.
        T_body_second: that of the other.
    """

    first: str
    second: str
    T_body_first: Pose
    T_body_second: Pose


class AnySight(Protocol):
    """What one pair sees in one frame; all sights of a fit are of one kind."""

    def __len__(self) -> int:
        """How many points it has."""

    def partners(self, other: Self, between: Between, gate_m: float) -> Partners:
        """The points of this sight that another pair sees as well.

        Args:
            other: what that sees in the same frame.
            between: the two pairs; this sight is of the first.
            gate_m: how far apart points of one thing may be.
        """


FrameSight = Mapping[str, AnySight]
Sights = Sequence[FrameSight]


@dataclass(frozen=True, eq=False)
class Partners:
    """Points of one pair and the surfaces of another, both in the frame of the body.

    Args:
        first: name of the pair of the points.
        second: of the pair of the surfaces.
        points: (N, 3) m.
        normals: (N, 3) of length 1, of the surfaces.
        residual_m: (N,) distance of the point from the surface, along its normal.
        along_first: (N,) m, what one standard deviation along the point's own ray does to it.
        along_second: (N,) m, the same along the ray of the surface's point.
        floor_m: no distance is surer than this.
        rows_a_point: how many rows belong to one point; 3 where each axis is a row.
        usual: what residuals of all partners usually are, in standard deviations.
    """

    first: str
    second: str
    points: Float64
    normals: Float64
    residual_m: Float64
    along_first: Float64
    along_second: Float64
    floor_m: float
    rows_a_point: int = 1
    usual: float = 1.0

    @property
    def count(self) -> int:
        """How many points they are."""
        return len(self.residual_m) // self.rows_a_point

    @property
    def distances_m(self) -> Float64:
        """(count,) how far each is from its partner, or from the partner's surface."""
        rows = self.residual_m.reshape(-1, self.rows_a_point)
        return np.asarray(np.linalg.norm(rows, axis=1))

    @property
    def sigma_m(self) -> Float64:
        """(N,) error of each distance: both points err along their rays, seen along the normal."""
        return np.asarray(np.sqrt(self.along_first**2 + self.along_second**2 + self.floor_m**2))

    @property
    def jacobian(self) -> Float64:
        """(N, 6) change of the distances with the first pair's twist, in the body's frame."""
        return np.hstack([self.normals, np.cross(self.points, self.normals)])

    @property
    def weights(self) -> Float64:
        """(N,) of the squares of the distances, Cauchy's."""
        scaled = self.residual_m / (CAUCHY * self.usual * self.sigma_m)
        return np.asarray(1.0 / (self.sigma_m**2 * (1.0 + scaled**2)))

    def slices(self, count: int) -> list[Partners]:
        """As many points in each of `count` slices, side by side as seen from the body's origin."""
        x, y = self.points[:: self.rows_a_point, :2].T
        order = np.argsort(np.arctan2(y, x), kind="stable")
        rows = np.arange(len(self.residual_m)).reshape(-1, self.rows_a_point)
        return [self._at(rows[part].ravel()) for part in np.array_split(order, count)]

    def _at(self, rows: Int64) -> Partners:
        columns = ("points", "normals", "residual_m", "along_first", "along_second")
        return replace(self, **{name: getattr(self, name)[rows] for name in columns})


def all_partners(sights: Sights, places: Mapping[str, Pose], gate_m: float) -> list[Partners]:
    """Partners of all frames, each two pairs both ways; those without any are left out.

    Args:
        sights: of each frame what each pair sees.
        places: `T_base_link_left` of each pair.
        gate_m: how far apart points of one surface may be; boards need none.
    """
    found = (
        partners_of(frame, first, second, places, gate_m)
        for frame in sights
        for first, second in itertools.permutations(frame, 2)
    )
    some = [partners for partners in found if len(partners.residual_m)]
    usual = _usual(some)
    return [replace(partners, usual=usual) for partners in some]


def _usual(partners: Sequence[Partners]) -> float:
    """What residuals usually are, in standard deviations."""
    if not partners:
        return 1.0
    scaled = np.concatenate([each.residual_m / each.sigma_m for each in partners])
    return float(np.clip(robust_sigma(scaled), LEAST_USUAL, 1.0))


def partners_of(
    frame: FrameSight, first: str, second: str, places: Mapping[str, Pose], gate_m: float
) -> Partners:
    """Points of `first` and what `second` sees of the same thing.

    Args:
        frame: what each pair sees in it.
        first: name of the pair of the points.
        second: of the pair of the surfaces.
        places: `T_base_link_left` of each pair.
        gate_m: how far apart points of one surface may be; boards need none.
    """
    between = Between(first, second, places[first], places[second])
    return frame[first].partners(frame[second], between, gate_m)


def distances_of(sights: Sights, places: Mapping[str, Pose], name: str, gate_m: float) -> Float64:
    """(N,) how far the points of a pair that have a partner are from it, or its surface.

    Args:
        sights: of each frame what each pair sees.
        places: `T_base_link_left` of each pair.
        name: of the pair.
        gate_m: how far apart points of one surface may be.
    """
    parts = [
        partners_of(frame, name, other, places, gate_m).distances_m
        for frame in sights
        if name in frame
        for other in frame
        if other != name
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def twist_of(number: int) -> slice:
    """Where the twist of a free pair stands among those of all."""
    return slice(6 * number, 6 * number + 6)


def system(
    partners: Sequence[Partners], free: Sequence[str]
) -> tuple[Float64, Float64, int, float]:
    """Normal matrix and gradient over the twists of the free pairs, count and weighted squares.

    Args:
        partners: of all frames.
        free: names of the pairs that may move, n of them.

    Returns:
        (6 n, 6 n) normal matrix, (6 n,) gradient, how many distances, their weighted squares.
    """
    n = 6 * len(free)
    H, g, dof, chi2 = np.zeros((n, n)), np.zeros(n), 0, 0.0
    for each in partners:
        J, w = each.jacobian, each.weights
        blocks = [
            (free.index(name), sign)
            for name, sign in ((each.first, 1.0), (each.second, -1.0))
            if name in free
        ]
        JwJ, Jwr = (J * w[:, None]).T @ J, J.T @ (w * each.residual_m)
        for i, sign_i in blocks:
            g[twist_of(i)] += sign_i * Jwr
            for k, sign_k in blocks:
                H[twist_of(i), twist_of(k)] += sign_i * sign_k * JwJ
        dof += len(w)
        chi2 += float((w * each.residual_m**2).sum())
    return H, g, dof, chi2
