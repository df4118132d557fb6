"""Pixels where a measured disparity and a reference are both known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import Bool, Float64, Int64, check_array
from pseudolidar.structures.disparity import DisparityMap

MRAD = 1e-3  # rad, the unit of angles that samples are told against


@dataclass(frozen=True, eq=False)
class DisparitySamples:
    """Measured disparities with their references, as columns; uncorrected.

    Args:
        measured: (N,) float64 px.
        reference: (N,) float64 px, the true disparity.
        u: (N,) float64 column of the left image, px.
        v: (N,) float64 row, px.
        frame: (N,) int64 number of the frame that each sample comes from.
        size_px: (width, height) of the images.
        sigma: (N,) float64 px, one standard deviation as the matcher estimates it, or None.
        per_pitch: (N,) float64 px, by how much too small the reference is for each mrad that its
            LiDAR is placed pitched too far down; None where it is of no LiDAR.
    """

    measured: Float64
    reference: Float64
    u: Float64
    v: Float64
    frame: Int64
    size_px: tuple[int, int]
    sigma: Float64 | None = None
    per_pitch: Float64 | None = None

    def __post_init__(self) -> None:
        check_array("DisparitySamples", "measured", self.measured, (None,), np.float64)
        for name in ("reference", "u", "v", "sigma", "per_pitch"):
            column = getattr(self, name)
            if column is not None:
                check_array("DisparitySamples", name, column, self.measured.shape, np.float64)
        check_array("DisparitySamples", "frame", self.frame, self.measured.shape, np.int64)

    def __len__(self) -> int:
        return len(self.measured)

    def __getitem__(self, index: Bool | Int64 | slice) -> DisparitySamples:
        """The chosen samples."""
        return replace(
            self,
            measured=self.measured[index],
            reference=self.reference[index],
            u=self.u[index],
            v=self.v[index],
            frame=self.frame[index],
            sigma=None if self.sigma is None else self.sigma[index],
            per_pitch=None if self.per_pitch is None else self.per_pitch[index],
        )

    @classmethod
    def of_maps(
        cls, measured: DisparityMap, reference: DisparityMap, *, frame: int, most: int | None = None
    ) -> DisparitySamples:
        """Samples of the pixels where both maps of one frame have a value.

        Args:
            measured: the estimate.
            reference: of the same shape.
            frame: number of the frame.
            most: keep at most so many, evenly spread.
        """
        height, width = measured.values.shape
        row, column = np.nonzero(measured.valid & reference.valid)
        step = 1 if most is None else max(1, -(-len(row) // most))
        row, column = row[::step], column[::step]
        sigma = None if measured.sigma is None else measured.sigma[row, column].astype(np.float64)
        return cls(
            measured=measured.values[row, column].astype(np.float64),
            reference=reference.values[row, column].astype(np.float64),
            u=column.astype(np.float64),
            v=row.astype(np.float64),
            frame=np.full(len(row), frame, np.int64),
            size_px=(width, height),
            sigma=sigma,
        )

    @classmethod
    def concatenate(cls, parts: Sequence[DisparitySamples]) -> DisparitySamples:
        """All samples of `parts` in order, as seen in images of the size of the first.

        Columns and rows of images of other sizes are stretched to it. Sigma and what a pitch does
        stay only where all parts have them.

        Raises:
            StructureError: no parts.
        """
        if not parts:
            raise StructureError("no samples", want="one part or more", where="DisparitySamples")
        size_px = parts[0].size_px
        return cls(
            measured=np.concatenate([part.measured for part in parts]),
            reference=np.concatenate([part.reference for part in parts]),
            u=np.concatenate([_stretched(p.u, p.size_px[0], size_px[0]) for p in parts]),
            v=np.concatenate([_stretched(p.v, p.size_px[1], size_px[1]) for p in parts]),
            frame=np.concatenate([part.frame for part in parts]),
            size_px=size_px,
            sigma=_joined([part.sigma for part in parts]),
            per_pitch=_joined([part.per_pitch for part in parts]),
        )


def _joined(columns: Sequence[Float64 | None]) -> Float64 | None:
    known = [column for column in columns if column is not None]
    return np.concatenate(known) if len(known) == len(columns) else None


def _stretched(coordinate: Float64, size_px: int, to_px: int) -> Float64:
    return coordinate if size_px == to_px else coordinate * ((to_px - 1) / (size_px - 1))
