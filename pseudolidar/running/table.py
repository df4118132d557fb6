"""Tables for the terminal, and for files that a terminal's output is sent to."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence

from pseudolidar.errors import printable

# Columns where no terminal wraps lines: programs that read a table want whole rows.
_UNLIMITED = 1000


def ruled_text(rows: Sequence[Sequence[str]], *, header: Sequence[str]) -> str:
    """Columns of numbers, flush right, the last row under a line; as wide as they are.

    Args:
        rows: texts, one sequence a row, all of one length.
        header: names of the columns.
    """
    every = [header, *rows]
    widths = [max(map(len, column)) for column in zip(*every, strict=True)]
    lines = [
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        for row in every
    ]
    return "\n".join([*lines[:-1], "-" * len(lines[0]), lines[-1]])


def table_text(rows: Iterable[Sequence[str]], *, header: Sequence[str] = ()) -> str:
    """Aligned columns; cells are wrapped at the terminal's width.

    Args:
        rows: texts, one sequence a row, all of one length.
        header: names of the columns, if they need any.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    terminal = Console()
    console = Console(
        file=io.StringIO(), width=terminal.width if terminal.is_terminal else _UNLIMITED
    )
    table = Table(box=box.SIMPLE_HEAD if header else None, show_header=bool(header))
    rows = list(rows)
    for i in range(len(rows[0]) if rows else 0):
        table.add_column(header[i] if header else "", overflow="fold", no_wrap=False)
    for row in rows:
        table.add_row(*(printable(cell).replace("[", r"\[") for cell in row))
    with console.capture() as captured:
        console.print(table)
    return "\n".join(line.rstrip() for line in captured.get().splitlines())
