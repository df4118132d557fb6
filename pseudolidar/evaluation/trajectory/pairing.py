"""Which pose of an estimate belongs to which of the reference: by time, or by place in the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pseudolidar.errors import PoseFileError, SequenceTime, UsageError
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.formats.trajectory_file import PoseRecord
from pseudolidar.geometry.quaternion import quaternion_wxyz, rotation_of, slerp
from pseudolidar.structures.arrays import Float64, Int64

PairedBy = Literal["auto", "nearest", "interpolate", "index"]
FEWEST_PAIRS = 2
# Sources whose times count from 0 are moved to begin at 1 s, as a stamp of 0 means "no time" to
# many tools; files of the same frames may count from 0.
BEGIN_NS = NS_PER_S
# Later times are no count from the start of something, s.
LATEST_COUNT_S = 1_000_000
# Times that are the same but for the last digit of a file.
SAME_NS = 1_000


@dataclass(frozen=True)
class TimePairing:
    """How poses of two files are paired.

    Args:
        by: time, with the nearest pose of the denser file, or one interpolated between its
            neighbours; or place in the file. `auto`: nearest time where both files have times,
            else place.
        max_difference_s: poses further apart in time are left out.
        offset_s: added to the estimate's times.
    """

    by: PairedBy = "auto"
    max_difference_s: float = 0.01
    offset_s: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.max_difference_s < np.inf or not np.isfinite(self.offset_s):
            raise UsageError(
                f"a difference of {self.max_difference_s:g} s, an offset of {self.offset_s:g} s",
                want="a difference of 0 or more, and a number",
            )


@dataclass(frozen=True, eq=False)
class PairedPoses:
    """Poses that belong together, row by row.

    Args:
        T_world_estimate: (N, 4, 4) metres, in the estimate's world.
        T_world_reference: (N, 4, 4) metres, in the reference's.
        times_ns: (N,) of the sparser file's poses; None where paired by place without times.
        by: how they were paired.
        estimates: poses in the estimate's file.
        references: poses in the reference's.
        largest_difference_s: between the times of a pair; None without times.
        notes: what people should know.
    """

    T_world_estimate: Float64
    T_world_reference: Float64
    times_ns: Int64 | None
    by: Literal["nearest", "interpolate", "index"]
    estimates: int
    references: int
    largest_difference_s: float | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def of_frames(
        cls, T_world_estimate: Float64, T_world_reference: Float64, times_ns: Int64 | None = None
    ) -> PairedPoses:
        """Poses (N, 4, 4) of the same frames, at (N,) times."""
        n = len(T_world_estimate)
        return cls(T_world_estimate, T_world_reference, times_ns, "index", n, n)

    def __len__(self) -> int:
        return len(self.T_world_estimate)


def paired(estimate: PoseRecord, reference: PoseRecord, pairing: TimePairing) -> PairedPoses:
    """Pair the poses of two files; those without a partner are left out.

    By time every pose of the file that has fewer looks for one of the other, as evo does.

    Raises:
        SequenceTime: fewer than two pairs.
        PoseFileError: by place, and the counts differ; or by time, and a file has none.
    """
    timed = estimate.times_ns is not None and reference.times_ns is not None
    by = pairing.by
    if by == "auto":
        by = "nearest" if timed else "index"
    if by == "index":
        return _by_index(estimate, reference)
    if estimate.times_ns is None or reference.times_ns is None:
        raise _timeless(estimate if estimate.times_ns is None else reference)
    return _by_time(
        estimate,
        reference,
        pairing,
        estimate.times_ns + round(pairing.offset_s * NS_PER_S),
        reference.times_ns,
        interpolate=by == "interpolate",
    )


def _by_index(estimate: PoseRecord, reference: PoseRecord) -> PairedPoses:
    counts = len(estimate), len(reference)
    if counts[0] != counts[1]:
        shorter = estimate if counts[0] < counts[1] else reference
        raise PoseFileError(
            f"{counts[0]} poses of the estimate, {counts[1]} of the reference",
            want="as many of each, as poses without times are paired by their place",
            fix="Pass the files' times: --times FILE, --reference-times FILE.",
            path=shorter.path,
            where=f"pose {min(counts) + 1}",
        )
    _check_enough(estimate, reference, min(counts), "poses in each file")
    times = reference.times_ns if reference.times_ns is not None else estimate.times_ns
    return PairedPoses(
        estimate.T_world_body, reference.T_world_body, times, "index", *counts,
    )  # fmt: skip


def _timeless(file: PoseRecord) -> PoseFileError:
    return PoseFileError(
        "poses without times",
        want="times to pair them by",
        fix="Pass them: --times FILE, --reference-times FILE; or pair by place: --pair.by index.",
        path=file.path,
    )


def _by_time(
    estimate: PoseRecord,
    reference: PoseRecord,
    pairing: TimePairing,
    own_ns: Int64,
    other_ns: Int64,
    *,
    interpolate: bool,
) -> PairedPoses:
    """Every pose of the sparser file with the nearest of the denser one, or between two of it."""
    limit_ns = round(pairing.max_difference_s * NS_PER_S)
    shift_ns = 0 if pairing.offset_s else _moved_begin_ns(own_ns, other_ns, limit_ns)
    own_ns = own_ns + shift_ns
    sparse_is_own = len(own_ns) < len(other_ns)
    sparse_ns, dense_ns = (own_ns, other_ns) if sparse_is_own else (other_ns, own_ns)
    nearest = nearest_in(dense_ns, sparse_ns)
    apart_ns = np.abs(dense_ns[nearest] - sparse_ns)
    kept = np.flatnonzero(apart_ns <= limit_ns)
    if len(kept) < FEWEST_PAIRS:
        raise _nothing_in_common(estimate, reference, own_ns, other_ns, len(kept), apart_ns)
    sparse, dense = (estimate, reference) if sparse_is_own else (reference, estimate)
    sparse_poses = sparse.T_world_body[kept]
    if interpolate:
        dense_poses = interpolated(dense_ns, dense.T_world_body, sparse_ns[kept])
    else:
        dense_poses = dense.T_world_body[nearest[kept]]
    own, other = (sparse_poses, dense_poses) if sparse_is_own else (dense_poses, sparse_poses)
    left = len(sparse_ns) - len(kept)
    return PairedPoses(
        own,
        other,
        sparse_ns[kept],
        "interpolate" if interpolate else "nearest",
        len(estimate),
        len(reference),
        float(apart_ns[kept].max()) / NS_PER_S,
        _moved_note(shift_ns)
        + _left_out(sparse, left, pairing)
        + _used_twice(dense, nearest[kept], interpolate),
    )


def _moved_begin_ns(own_ns: Int64, other_ns: Int64, limit_ns: int) -> int:
    """What the estimate's times are to be moved by: 1 s where only then they are the reference's.

    Both must count from the start of something. More poses must find a partner, or as many find
    one of exactly their time; else nothing is moved.
    """
    if max(own_ns[0], other_ns[0]) > LATEST_COUNT_S * NS_PER_S:
        return 0

    def fits(shift_ns: int) -> tuple[int, int]:
        moved_ns = own_ns + shift_ns
        apart_ns = np.abs(other_ns[nearest_in(other_ns, moved_ns)] - moved_ns)
        return int((apart_ns <= limit_ns).sum()), int((apart_ns <= SAME_NS).sum())

    return max((0, -BEGIN_NS, BEGIN_NS), key=fits)  # of equals, the first


def _moved_note(shift_ns: int) -> tuple[str, ...]:
    if not shift_ns:
        return ()
    later = "later" if shift_ns < 0 else "earlier"
    return (
        f"times of the estimate are {abs(shift_ns) / NS_PER_S:g} s {later} than the reference's "
        "throughout, as where one counts from 0 and the other from 1 s: taken for the same",
    )


def _left_out(sparse: PoseRecord, left: int, pairing: TimePairing) -> tuple[str, ...]:
    if not left:
        return ()
    return (
        f"{left} of {len(sparse)} poses of {sparse.path.name} left out: nothing within "
        f"{pairing.max_difference_s:g} s in the other file",
    )


def _used_twice(dense: PoseRecord, chosen: Int64, interpolate: bool) -> tuple[str, ...]:
    twice = len(chosen) - len(np.unique(chosen))
    if interpolate or not twice:
        return ()
    return (f"{twice} poses of {dense.path.name} are the nearest of more than one pose",)


def _check_enough(estimate: PoseRecord, reference: PoseRecord, pairs: int, what: str) -> None:
    if pairs < FEWEST_PAIRS:
        raise PoseFileError(
            f"{pairs} {what}",
            want=f"at least {FEWEST_PAIRS}, as errors are of motions",
            path=estimate.path if len(estimate) <= len(reference) else reference.path,
        )


def _nothing_in_common(
    estimate: PoseRecord,
    reference: PoseRecord,
    own_ns: Int64,
    other_ns: Int64,
    pairs: int,
    apart_ns: Int64,
) -> SequenceTime:
    spans = [f"{ns[0] / NS_PER_S:.6f} to {ns[-1] / NS_PER_S:.6f} s" for ns in (own_ns, other_ns)]
    apart_s = float(apart_ns.min()) / NS_PER_S
    if own_ns[-1] < other_ns[0] or other_ns[-1] < own_ns[0]:
        begin_s = (int(other_ns[0]) - int(own_ns[0])) / NS_PER_S
        fix = f"If both begin together: --pair.offset-s {begin_s:.6f}; or --pair.by index."
    else:
        fix = f"The nearest are {apart_s:.3g} s apart: raise --pair.max-difference-s, or take "
        fix += "--pair.by index."
    return SequenceTime(
        f"{pairs} common times: the estimate is of {spans[0]}, the reference of {spans[1]}",
        want=f"at least {FEWEST_PAIRS}",
        fix=fix,
        path=estimate.path,
        where=f"against {reference.path}",
    )


def nearest_in(dense_ns: Int64, at_ns: Int64) -> Int64:
    """(N,) index of the nearest of increasing times to each; of two as near, the earlier."""
    after = np.clip(np.searchsorted(dense_ns, at_ns), 0, len(dense_ns) - 1)
    before = np.maximum(after - 1, 0)
    earlier = np.abs(at_ns - dense_ns[before]) <= np.abs(dense_ns[after] - at_ns)
    return np.asarray(np.where(earlier, before, after), np.int64)


def interpolated(times_ns: Int64, T_world_body: Float64, at_ns: Int64) -> Float64:
    """(N, 4, 4) poses at other times; before the first and after the last stays the end's pose.

    Positions go straight, rotations along the shortest arc.
    """
    if len(times_ns) == 1:
        return np.repeat(T_world_body, len(at_ns), axis=0)
    after = np.clip(np.searchsorted(times_ns, at_ns), 1, len(times_ns) - 1)
    step_ns = times_ns[after] - times_ns[after - 1]
    share = np.clip((at_ns - times_ns[after - 1]) / step_ns, 0.0, 1.0)
    poses = np.tile(np.eye(4), (len(at_ns), 1, 1))
    start, end = T_world_body[after - 1], T_world_body[after]
    poses[:, :3, 3] = start[:, :3, 3] + share[:, None] * (end[:, :3, 3] - start[:, :3, 3])
    poses[:, :3, :3] = _turned(start[:, :3, :3], end[:, :3, :3], share)
    return poses


def _turned(start: Float64, end: Float64, share: Float64) -> Sequence[Float64]:
    return [
        rotation_of(slerp(quaternion_wxyz(a), quaternion_wxyz(b), float(s)))
        for a, b, s in zip(start, end, share, strict=True)
    ]
