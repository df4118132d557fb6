"""Relative errors: of motions over so many frames, or so many metres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.evaluation.trajectory.motions import path_lengths
from pseudolidar.structures.arrays import Float64, Int64

# A motion counts as one over so many metres if its path is as long to this share, where every
# pose begins one.
LENGTH_TOLERANCE = 0.1
ALL = ":all"


@dataclass(frozen=True)
class RpeSteps:
    """The motions that relative errors are of, as written on the command line.

    Args:
        delta: how many frames, or metres of path, a motion is over.
        unit: of `delta`.
        every: whether a motion begins at every pose; else the next begins where the last ended.
    """

    delta: float = 1
    unit: Literal["frames", "m"] = "frames"
    every: bool = False

    def __post_init__(self) -> None:
        whole = self.unit == "m" or self.delta == int(self.delta)
        if not (0 < self.delta < 1e9 and whole):
            raise UsageError(f"motions over {self}", want="1 or more whole frames, or metres")

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `1` (frames), `10m`, `10m:all`.

        Raises:
            UsageError: no number.
        """
        body, every = (text[: -len(ALL)], True) if text.endswith(ALL) else (text, False)
        number = body.removesuffix("m").strip()
        try:
            delta = float(number)
            if not np.isfinite(delta):
                raise ValueError
        except ValueError:
            raise UsageError(
                f"{text!r}", want="frames such as 1, metres such as 10m, or of all poses 10m:all"
            ) from None
        return cls(delta, "m" if body.endswith("m") else "frames", every)

    def __str__(self) -> str:
        unit = "m" if self.unit == "m" else ""
        return f"{self.delta:g}{unit}{ALL if self.every else ''}"

    @property
    def words(self) -> str:
        """For people."""
        unit = "m" if self.unit == "m" else "frame" if self.delta == 1 else "frames"
        return f"{self.delta:g} {unit}{', from every pose' if self.every else ''}"

    def pairs(self, T_world_body: Float64) -> Int64:
        """(M, 2) first and last pose of every motion.

        Args:
            T_world_body: (N, 4, 4) the poses whose path is measured: evo takes the estimate's.
        """
        if self.unit == "frames":
            return _over_frames(len(T_world_body), int(self.delta), every=self.every)
        path_m = path_lengths(T_world_body)
        return _from_every(path_m, self.delta) if self.every else _end_to_end(path_m, self.delta)


@dataclass(frozen=True)
class RpeChoice:
    """One or more of them, as written on the command line.

    Args:
        each: in the order that they are told in.
    """

    each: tuple[RpeSteps, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `1,10m`.

        Raises:
            UsageError: one is none.
        """
        return cls(tuple(RpeSteps.parse(part.strip()) for part in text.split(",")))

    def __str__(self) -> str:
        return ",".join(map(str, self.each))


# One frame, as evo has it where nothing is said; ten metres tell more of slow things.
DEFAULT_STEPS = RpeChoice((RpeSteps(), RpeSteps(10, "m")))


def _over_frames(poses: int, delta: int, *, every: bool) -> Int64:
    first = np.arange(0, max(0, poses - delta), 1 if every else delta)
    return np.stack((first, first + delta), axis=1).astype(np.int64)


def _end_to_end(path_m: Float64, delta_m: float) -> Int64:
    """Each ends at the first pose that is far enough, where the next begins."""
    found, begin, gone_m = [], 0, 0.0
    for pose, step_m in enumerate(np.diff(path_m).tolist(), start=1):
        # Summed anew for each motion: the same digits as where the steps are added one by one.
        gone_m += step_m
        if gone_m >= delta_m:
            found.append((begin, pose))
            begin, gone_m = pose, 0.0
    return np.array(found, np.int64).reshape(-1, 2)


def _from_every(path_m: Float64, delta_m: float) -> Int64:
    """From every pose to the one whose path is nearest to the length, if it is near enough."""
    begins = np.arange(len(path_m) - 1)
    wanted_m = path_m[:-1] + delta_m
    beyond = np.clip(np.searchsorted(path_m, wanted_m), begins + 1, len(path_m) - 1)
    # Of poses at one place, the first; none before the next.
    short = np.maximum(np.searchsorted(path_m, path_m[beyond - 1]), begins + 1)
    is_short = np.abs(path_m[short] - wanted_m) <= np.abs(path_m[beyond] - wanted_m)
    ends = np.where(is_short, short, beyond)
    near = np.abs(path_m[ends] - wanted_m) <= LENGTH_TOLERANCE * delta_m
    return np.stack((begins, ends), axis=1)[near].astype(np.int64)
