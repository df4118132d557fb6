"""`compare.json` and `compare.csv`: a comparison for programs and spreadsheets."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from pseudolidar import __version__
from pseudolidar.errors import OutputSettings
from pseudolidar.evaluation.comparison.clouds import CloudComparison
from pseudolidar.evaluation.comparison.comparison import Comparison
from pseudolidar.evaluation.comparison.figures import FIGURES, DepthFigures, RangeFigures
from pseudolidar.evaluation.comparison.pooled import PooledFigures
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.journal.journal_file import ANEW, JOURNAL_NAME, check_same

JSON_NAME, CSV_NAME = "compare.json", "compare.csv"
RESULTS = (CSV_NAME, JSON_NAME)
SCHEMA = 1
# What rows of all frames together are called in the CSV.
POOLED = "all"


def comparison_json(facts: dict[str, Any]) -> bytes:
    """The bytes of `compare.json`.

    Args:
        facts: plain JSON values, the settings among them.
    """
    head = {"schema": SCHEMA, "verb": "compare", "version": __version__}
    return json.dumps(_finite({**head, **facts}), indent=1, allow_nan=False).encode() + b"\n"


def _finite(value: Any) -> Any:
    """The value with null for numbers that are none, such as a slope that nothing tells."""
    if isinstance(value, dict):
        return {name: _finite(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def check_results(folder: Path, settings: dict[str, Any], *, overwrite: bool) -> None:
    """Refuse a folder with the results of something else, for comparisons without a journal.

    Args:
        folder: output folder.
        settings: of the comparison, plain JSON values.
        overwrite: whether these may be replaced.

    Raises:
        OutputSettings: there are the results of a run, or of other settings.
    """
    if overwrite:
        return
    if (folder / JOURNAL_NAME).exists():
        want = "a folder without one: these results would replace some of its own"
        raise OutputSettings("the folder holds another run", want=want, fix=ANEW, path=folder)
    path = folder / JSON_NAME
    if not path.exists():
        return
    try:
        before = json.loads(path.read_bytes())["settings"]
    except (ValueError, KeyError, TypeError):
        got, want = "results that cannot be read", "those of this version, or none"
        raise OutputSettings(got, want=want, fix=ANEW, path=path) from None
    check_same(before, json.loads(json.dumps(settings)), folder)


def comparison_csv(compared: Comparison) -> bytes:
    """The bytes of `compare.csv`: a row for every frame and bin, then the pooled ones.

    Each frame's last row, and the last of all, are of all its points from the first bin to the
    last. Intervals are known of pooled figures alone.
    """
    return _table(("frame", "index", "timestamp_ns"), _rows(compared))


def drives_csv(drives: Mapping[str, Comparison], every: PooledFigures) -> bytes:
    """The bytes of `compare.csv` of several drives: a row for every drive and bin, then pooled."""
    named: list[tuple[str, Comparison | PooledFigures]] = [*drives.items(), (POOLED, every)]
    rows = [
        row
        for name, each in named
        for row in _bin_rows([name], each.by_range, each.overall, each.bins.range_m)
    ]
    return _table(("drive",), rows)


def clouds_csv(compared: CloudComparison) -> bytes:
    """The bytes of `compare.csv` of clouds: a row for every bin, then all of them."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = list(compared.overall.figures)
    bounds = [f"{name}_{end}" for name in names for end in ("low", "high")]
    writer.writerow(["from_m", "to_m", "reference_points", "n", *names, *bounds])
    bins, each = (*compared.bins, compared.bins.range_m), (*compared.by_range, compared.overall)
    for (low, high), figures in zip(bins, each, strict=True):
        ends = (figures.intervals.get(name, ("", "")) for name in names)
        values = (figures.figures[name] for name in names)
        row = [low, high, figures.reference, figures.n, *values]
        writer.writerow([*row, *(end for pair in ends for end in pair)])
    return text.getvalue().encode()


def _table(names: tuple[str, ...], rows: Iterable[list[Any]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    bounds = [f"{name}_{end}" for name in FIGURES for end in ("low", "high")]
    writer.writerow([*names, "from_m", "to_m", "reference_points", "n", *FIGURES, *bounds])
    writer.writerows(rows)
    return text.getvalue().encode()


def write_comparison(folder: Path, table: bytes, facts: dict[str, Any]) -> list[Path]:
    """Write both files, the table first: where there is a `compare.json`, all is there.

    Args:
        folder: output folder.
        table: the bytes of `compare.csv`.
        facts: plain JSON values.

    Raises:
        OutputError: the disk is full or gone.
    """
    paths = [folder / name for name in RESULTS]
    for path, data in zip(paths, (table, comparison_json(facts)), strict=True):
        write_atomic(path, data)
    return paths


def _rows(compared: Comparison) -> Iterator[list[Any]]:
    for frame in compared.per_frame:
        names = [frame.id, frame.index, frame.timestamp_ns]
        yield from _bin_rows(names, frame.by_range, frame.overall, compared.bins.range_m)
    pooled = [POOLED, "", ""]
    yield from _bin_rows(pooled, compared.by_range, compared.overall, compared.bins.range_m)


def _bin_rows(
    names: list[Any],
    by_range: tuple[RangeFigures, ...],
    overall: DepthFigures,
    range_m: tuple[int, int],
) -> Iterator[list[Any]]:
    for each in (*by_range, RangeFigures(*range_m, overall)):
        figures = each.figures
        bounds = (figures.intervals.get(name, ("", "")) for name in FIGURES)
        yield [
            *names,
            each.from_m,
            each.to_m,
            figures.reference,
            figures.n,
            *(getattr(figures, name) for name in FIGURES),
            *(end for pair in bounds for end in pair),
        ]
