"""What `reconstruct` tells, for people, for programs, and as a page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import ALL_DONE, SOME_SKIPPED
from pseudolidar.evaluation.cloud_views import Eye, from_above, perspective
from pseudolidar.evaluation.page import KeyFigure, Picture, PictureRow, Section, render_page
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.views import SparseModel


@dataclass(frozen=True, eq=False)
class ReconstructReport:
    """What was found.

    Args:
        out: output folder.
        model: cameras and points.
        dense: of pairs their clouds.
        notes: what is odd.
        unread: pictures that cannot be read, and why.
        files: what there is to open.
    """

    out: Path
    model: SparseModel
    dense: PointCloud | None
    notes: tuple[str, ...]
    unread: tuple[str, ...]
    files: tuple[Path, ...]

    @property
    def exit_code(self) -> int:
        """0 all pictures are in the model, 4 some are not, or cannot be read."""
        return SOME_SKIPPED if self.model.left_out or self.unread else ALL_DONE

    def as_dict(self) -> dict[str, Any]:
        """Counts, error, whether lengths are metres, files."""
        return {
            "pictures": len(self.model.names) + len(self.model.left_out),
            "placed": list(self.model.names),
            "left_out": list(self.model.left_out),
            "unread": list(self.unread),
            "points": len(self.model.points),
            "dense_points": None if self.dense is None else len(self.dense),
            "error_px": self.model.error_px,
            "metres": self.model.scaled,
            "notes": list(self.notes),
            "files": [str(file) for file in self.files],
        }

    @property
    def points_shown(self) -> PointCloud:
        """What the pictures are drawn of."""
        return self.model.points if self.dense is None else self.dense

    @property
    def placed(self) -> list[tuple[str, np.ndarray]]:
        """Each picture with its (4, 4) pose."""
        return list(zip(self.model.names, self.model.T_world_camera, strict=True))

    @property
    def size_m(self) -> float:
        """How far points are apart, most of them."""
        xyz = self.points_shown.xyz
        return float(np.linalg.norm(np.quantile(xyz, 0.9, axis=0) - np.quantile(xyz, 0.1, axis=0)))

    @property
    def eye(self) -> Eye:
        """Behind and above the first picture."""
        size = self.size_m
        middle = np.median(self.points_shown.xyz, axis=0)
        x, y, z = (float(value) for value in middle)
        return Eye((-0.3 * size, 0.0, 0.3 * size), (x, y, z))

    def text(self) -> str:
        """The same for people."""
        model = self.model
        every = len(model.names) + len(model.left_out)
        lines = [
            f"{len(model.names)} of {every} pictures placed, {len(model.points):,} points, "
            f"reprojection error {model.error_px:.2f} px"
        ]
        lines += [f"  left out: {name}" for name in model.left_out]
        lines += [f"  not read: {fault}" for fault in self.unread]
        if self.dense is not None:
            lines.append(f"  {len(self.dense):,} points of pairs in one cloud")
        lines += [f"  note: {note}" for note in self.notes]
        return "\n".join([*lines, *(f"  {file}" for file in self.files)])


def page_of(report: ReconstructReport) -> bytes:
    """The page: from above, and as the first camera sees it."""
    cloud = report.points_shown
    above, per_px = from_above(cloud, point_m=report.size_m / 300)
    seen = perspective(cloud, report.eye, point_m=report.size_m / 300)
    model = report.model
    unit = "m" if model.scaled else "of no unit"
    rows = [(name, *(f"{x:.3f}" for x in T[:3, 3])) for name, T in report.placed]
    pictures = PictureRow(
        (
            Picture.photo(above, f"from above, {per_px:.3g} {unit} a pixel"),
            Picture.photo(seen, "from behind the first picture"),
        )
    )
    header = ("picture", f"x, {unit}", "y", "z")
    return render_page(
        f"{len(model.names)} pictures",
        "where they were taken, and what they share",
        [
            Section("From above and from behind", pictures=[pictures]),
            Section("Where they were taken", header=header, table=rows),
        ],
        keys=[
            KeyFigure("pictures", str(len(model.names)), f"{len(model.left_out)} left out"),
            KeyFigure("points", f"{len(model.points):,}", "that two or more show"),
            KeyFigure("error", f"{model.error_px:.2f} px", "mean, reprojected"),
        ],
    )
