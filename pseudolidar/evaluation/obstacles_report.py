"""What `evaluate obstacles` tells, for people and as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pseudolidar.errors import ALL_DONE, SOME_SKIPPED
from pseudolidar.evaluation.average_precision import AveragePrecision
from pseudolidar.evaluation.obstacles import (
    JUDGED_FROM,
    BandErrors,
    JudgedObject,
    by_band,
    size_errors,
    usual_by_band,
)

# Sizes are told of cars to this distance, m.
CARS, CARS_TO_M = ("Car",), 30.0
# Frames without labels that are named.
NAMED = 10


@dataclass(frozen=True, eq=False)
class ObstaclesReport:
    """Errors of obstacles against labels.

    Args:
        subject: what was judged, one line.
        objects: every label that counts, with what was measured of it.
        frames: how many frames had labels.
        precisions: KITTI's average precision of boxes, of classes that labels and detector share.
        found_by_labels: the detections are the labels themselves, so recall says nothing.
        without_labels: ids of frames that have none.
        seconds_per_frame: median time of finding and measuring, matching included.
        skipped: id and reason of frames that could not be used.
        warnings: what is odd about the pairs.
        networks: those that were used, as they describe themselves.
        unpaired: labels that belong to no frame, in words.
    """

    subject: str
    objects: Sequence[JudgedObject]
    frames: int
    found_by_labels: bool
    precisions: Sequence[AveragePrecision] = ()
    without_labels: Sequence[str] = ()
    seconds_per_frame: float | None = None
    skipped: Sequence[tuple[str, str]] = ()
    warnings: Sequence[str] = ()
    networks: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    unpaired: Sequence[str] = ()

    @property
    def exit_code(self) -> int:
        """4 if frames were skipped or have no labels, or labels have no frame, else 0."""
        left_out = self.skipped or self.without_labels or self.unpaired
        return SOME_SKIPPED if left_out else ALL_DONE

    @property
    def recall(self) -> float | None:
        """Share of the labels that a detection is of, 0-1; None where labels are the detections."""
        if self.found_by_labels or not self.objects:
            return None
        return sum(o.measured_m is not None for o in self.objects) / len(self.objects)

    @property
    def within_1_sigma(self) -> float | None:
        """Share of all errors within their sigma, 0-1."""
        bands = [band for band in by_band(self.objects) if band.within_1_sigma is not None]
        known = sum(band.n - band.missed for band in bands)
        if not known:
            return None
        shares = ((band.n - band.missed) * (band.within_1_sigma or 0.0) for band in bands)
        return sum(shares) / known

    def as_dict(self) -> dict[str, Any]:
        """Bands first; then the usual script's, sizes of cars, and each object."""
        cars = size_errors(self.objects, names=CARS, nearer_than_m=CARS_TO_M)
        return {
            "subject": self.subject,
            "bands": [band.as_dict() for band in by_band(self.objects)],
            "within_1_sigma": self.within_1_sigma,
            "recall_2d": self.recall,
            "ap40": [one.as_dict() for one in self.precisions],
            "usual_script": [band.as_dict() for band in usual_by_band(self.objects)],
            "cars": cars
            and {
                "n": cars[0],
                "to_m": int(CARS_TO_M),
                **{
                    f"{name}_median_abs_m": float(value)
                    for name, value in zip(("length", "width", "height"), cars[1], strict=True)
                },
            },
            "objects": [dict(vars(o)) for o in self.objects],
            "frames": self.frames,
            "without_labels": len(self.without_labels),
            "unlabelled": list(self.without_labels),
            "seconds_per_frame": self.seconds_per_frame,
            "skipped": [{"id": name, "reason": reason} for name, reason in self.skipped],
            "warnings": list(self.warnings),
            "networks": dict(self.networks),
        }

    def text(self) -> str:
        """Tables for a terminal."""
        lines = [
            self.subject,
            f"{len(self.objects)} objects in {self.frames} frames; error of the nearest face: "
            "median, 90th percentile, bias, within one sigma",
        ]
        lines += [_band_line(band) for band in by_band(self.objects)]
        if self.within_1_sigma is not None:
            lines.append(f"  within one sigma of all     {self.within_1_sigma:.0%}")
        if self.recall is not None:
            lines.append(f"  found of the labelled       {self.recall:.0%}")
        cars = size_errors(self.objects, names=CARS, nearer_than_m=CARS_TO_M)
        if cars is not None:
            length, width, height = cars[1]
            lines.append(
                f"  {cars[0]} cars to {CARS_TO_M:.0f} m: length off by {length:.2f} m, "
                f"width {width:.2f} m, height {height:.2f} m (medians)"
            )
        lines += self._precision_lines()
        lines.append("the usual script, depth at the middle of the box, against the label's z:")
        lines += [_band_line(band) for band in usual_by_band(self.objects)]
        if self.without_labels:
            names = ", ".join(self.without_labels[:NAMED])
            more = ", ..." if len(self.without_labels) > NAMED else ""
            lines.append(f"without labels, and left out: {names}{more}")
        return "\n".join([*lines, *(f"skipped {name}: {why}" for name, why in self.skipped)])

    def _precision_lines(self) -> list[str]:
        known = [one for one in self.precisions if one.n]
        if not known:
            return []
        lines = [
            "KITTI's AP of 40 recalls, from above and in 3D (fewer than 40 labels cannot reach "
            "100 %):"
        ]
        for one in known:
            head = (
                f"  {one.name:12s} IoU {one.min_overlap:.1f}  {one.difficulty:8s} {one.n:4d} labels"
            )
            lines.append(f"{head}  {one.bev or 0.0:6.1%}  {one.space or 0.0:6.1%}")
        return lines


def _band_line(band: BandErrors) -> str:
    head = f"  {band.from_m:2d}-{band.to_m:2d} m  {band.n:3d} objects"
    if band.median_abs_m is None or band.p90_abs_m is None or band.bias_m is None:
        return f"{head}  none measured" if band.n else head
    line = f"{head}  {band.median_abs_m:5.2f}  {band.p90_abs_m:5.2f}  {band.bias_m:+5.2f} m"
    if band.within_1_sigma is not None:
        line += f"  {band.within_1_sigma:4.0%}"
    if band.missed:
        line += f"  {band.missed} without a distance"
    return line if band.n >= JUDGED_FROM else f"{line}  (few: not judged)"
