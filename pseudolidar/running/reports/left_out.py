"""Frames of a comparison that are in no figure: for people and for programs."""

from __future__ import annotations

from typing import Any

from pseudolidar.running.results import RunResult


def left_out_words(result: RunResult, without_reference: int) -> list[str]:
    """How many there are and why; what there is none of is not named."""
    counts = ((without_reference, "without a reference"), (len(result.skipped), "skipped"))
    return [f"{count} {why}" for count, why in counts if count]


def left_out_facts(result: RunResult, without_reference: int) -> dict[str, Any]:
    """The same as plain JSON values, with the error of each skipped frame."""
    skipped = [{"id": each.id, **(each.skipped or {})} for each in result.skipped]
    return {"without_reference": without_reference, "skipped": skipped}
