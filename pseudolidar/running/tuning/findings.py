"""What a search found: figures of the first settings and of the best, and the file of settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import ALL_DONE, SOME_SKIPPED, printable
from pseudolidar.evaluation.disparity import mean_known
from pseudolidar.evaluation.matching_loss import Judgement
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.crew.attempt import Skipped
from pseudolidar.running.settings_json import settings_differences, to_json, tuned_file
from pseudolidar.running.table import table_text
from pseudolidar.running.tuning.space import Candidate

# Measured on rendered worlds and Middlebury's motorcycle; docs/decisions.md has the figures.
PAIRS_TELL_LITTLE = (
    "pairs alone hardly tell outliers of {kind}: use these settings on scenes like SOURCE only, or "
    "tune by truth or scans, or --matcher census"
)


@dataclass(frozen=True)
class Figures:
    """Means over frames.

    Args:
        loss: by the measure that was tuned.
        density: share of the judged pixels that have a disparity.
        d1_est: share of D1 outliers among them; None without a reference.
        d1_filled: the same of all pixels, gaps filled.
        seconds: that a map takes, the quickest.
    """

    loss: float
    density: float
    d1_est: float | None
    d1_filled: float | None
    seconds: float

    @classmethod
    def of(cls, judgements: Sequence[Judgement], *, seconds: float) -> Figures:
        """Means of what was judged."""
        return cls(
            float(np.mean([each.loss for each in judgements])),
            float(np.mean([each.density for each in judgements])),
            mean_known([each.d1_est for each in judgements]),
            mean_known([each.d1_filled for each in judgements]),
            seconds,
        )

    def as_dict(self) -> dict[str, float | None]:
        """For JSON."""
        return dict(vars(self))


@dataclass(frozen=True)
class Found:
    """The best settings, and how good they are.

    Args:
        candidate: the settings.
        start: the settings that the search started from.
        tuned: loss on the frames that were tuned on, as a share of the first settings'.
        held: the same on the frames that were held back.
        first: figures of the first settings on those.
        best: figures of the best settings on those.
    """

    candidate: Candidate
    start: Candidate
    tuned: float
    held: float
    first: Figures
    best: Figures

    @property
    def improved(self) -> bool:
        """Whether they are other settings than the first."""
        return self.candidate != self.start

    def doubts(self, by: str) -> tuple[str, ...]:
        """What speaks against settings that were judged so.

        Args:
            by: what they were compared with: truth, scan or pairs.
        """
        matcher = self.candidate.matcher
        if not self.improved or by != "pairs" or not matcher.compares_brightness:
            return ()
        return (PAIRS_TELL_LITTLE.format(kind=type(matcher).__name__.upper()),)

    @property
    def losses(self) -> dict[str, Any]:
        """How good they are, for JSON."""
        return {
            "loss_tuned_on": self.tuned,
            "loss_held": self.held,
            "held_first": self.first.as_dict(),
            "held_best": self.best.as_dict(),
        }

    @property
    def changes(self) -> list[tuple[str, Any, Any]]:
        """Settings that differ: name, before, now."""
        return settings_differences(to_json(self.start), to_json(self.candidate))


def write_settings(path: Path, found: Found, about: dict[str, Any]) -> None:
    """Write the settings in the form that `--settings` of every command takes.

    Args:
        path: the file.
        found: the settings, with their figures.
        about: what they were tuned on.
    """
    settings, told = to_json(found.candidate), {**about, **found.losses}
    write_atomic(path, tuned_file(settings, told))


@dataclass(frozen=True, eq=False)
class TuneReport:
    """What came of it.

    Args:
        subject: what was tuned on, one line.
        by: what settings were compared with.
        found: the best.
        tuned_on: ids of the frames that were tuned on.
        held: ids of those that were held back.
        candidates: settings that were tried.
        trials: maps that were judged, those of earlier runs included.
        restored: how many of them an earlier run did.
        seconds: that this run took.
        out: the file of settings.
        journal: of the trials.
        picture: of them, if it was asked for.
        warnings: what is odd about the pairs.
        skipped: frames that cannot be read, of those that were to be judged.
    """

    subject: str
    by: str
    found: Found
    tuned_on: tuple[str, ...]
    held: tuple[str, ...]
    candidates: int
    trials: int
    restored: int
    seconds: float
    out: Path
    journal: Path
    picture: Path | None = None
    warnings: tuple[str, ...] = ()
    skipped: tuple[Skipped, ...] = ()

    @property
    def exit_code(self) -> int:
        """4 if frames were skipped, else 0."""
        return SOME_SKIPPED if self.skipped else ALL_DONE

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        found = self.found
        return {
            "subject": self.subject,
            "by": self.by,
            "improved": found.improved,
            **found.losses,
            "settings": to_json(found.candidate),
            "changes": [
                {"name": name, "before": before, "now": now} for name, before, now in found.changes
            ],
            "frames_tuned_on": list(self.tuned_on),
            "frames_held": list(self.held),
            "candidates": self.candidates,
            "trials": self.trials,
            "restored": self.restored,
            "seconds": round(self.seconds, 1),
            "out": str(self.out),
            "journal": str(self.journal),
            "picture": None if self.picture is None else str(self.picture),
            "warnings": list(self.warnings),
            "skipped": [{"id": each.id, **each.error.as_dict()} for each in self.skipped],
        }

    def text(self) -> str:
        """For people."""
        found = self.found
        before = f", {self.restored} of them earlier" if self.restored else ""
        lines = [
            self.subject,
            f"{self.candidates} settings in {self.seconds:.0f} s, {self.trials} maps judged"
            f"{before}, by {_BY[self.by]}",
        ]
        if not found.improved:
            lines.append("nothing better than the first settings was found; these are written")
        rows = [
            (name, _short(before), _short(now))
            for name, before, now in found.changes
            if not isinstance(before, dict) or not isinstance(now, dict)
        ]
        if rows:
            lines.append(table_text(rows, header=("setting", "first", "best")))
        lines.append(f"on frames that were not tuned on ({', '.join(self.held)}):")
        lines.append(table_text(_figure_rows(found), header=("", "first", "best")))
        lines += [f"left out: {each.id}: {printable(str(each.error))}" for each in self.skipped]
        lines.append(f"{self.out}: pass it to other commands with --settings")
        lines.append(f"{self.journal}: every trial; the same command goes on with it")
        if self.picture is not None:
            lines.append(str(self.picture))
        return "\n".join(lines)


_BY = {
    "truth": "ground-truth disparities",
    "scan": "LiDAR scans",
    "pairs": "the pairs themselves: left against right, photometric error, the next frame",
}


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(str(each) for each in value.values())
    return "none" if value is None else str(value)


def _figure_rows(found: Found) -> list[tuple[str, str, str]]:
    rows = [("loss", f"{found.first.loss:.4f}", f"{found.best.loss:.4f}")]
    for name, words in (
        ("density", "density"),
        ("d1_est", "D1 of matched pixels"),
        ("d1_filled", "D1 with gaps filled"),
    ):
        first, best = getattr(found.first, name), getattr(found.best, name)
        if first is not None and best is not None:
            rows.append((words, f"{100 * first:.2f} %", f"{100 * best:.2f} %"))
    first_s, best_s = found.first.seconds, found.best.seconds
    return [*rows, ("time a map", f"{1e3 * first_s:.0f} ms", f"{1e3 * best_s:.0f} ms")]
