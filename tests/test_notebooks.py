"""Every notebook runs from top to bottom and draws, and is committed without its results."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nbformat
import pytest

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
FIGURES = {
    "01_disparity_to_depth": (9, 13),
    "02_against_velodyne": (7, 12),
}  # without and with real data
CELL_LIMIT_S = 300  # a cell that hangs; the slowest takes seconds

every_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def code_cells(notebook: nbformat.NotebookNode) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def executed(path: Path, folder: Path) -> list[Any]:
    """All outputs of a notebook that is run in `folder`; a cell that raises fails the test."""
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    where = {"metadata": {"path": str(folder)}}
    client = NotebookClient(notebook, timeout=CELL_LIMIT_S, kernel_name="python3", resources=where)
    client.execute()
    return [output for cell in code_cells(notebook) for output in cell.outputs]


def figures(outputs: list[Any]) -> int:
    return sum("image/png" in output.get("data", {}) for output in outputs)


def printed(outputs: list[Any]) -> str:
    return "".join(o.text for o in outputs if o.output_type == "stream" and o.name == "stdout")


def test_there_are_notebooks():
    assert {path.stem for path in NOTEBOOKS} == set(FIGURES)


@every_notebook
def test_it_is_committed_without_results(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    for cell in code_cells(notebook):
        assert not cell.outputs, cell.source
        assert cell.execution_count is None, cell.source


@every_notebook
def test_it_runs_where_there_is_no_data_and_says_what_it_leaves_out(path, tmp_path, monkeypatch):
    monkeypatch.setenv("PSEUDOLIDAR_DATA", str(tmp_path / "nowhere"))
    outputs = executed(path, tmp_path)
    assert figures(outputs) == FIGURES[path.stem][0]
    assert "Skipped" in printed(outputs)
    assert not list(tmp_path.iterdir())  # nothing left behind


@pytest.mark.real
@every_notebook
def test_it_runs_on_real_data(path, tmp_path, monkeypatch, real_data):
    monkeypatch.setenv("PSEUDOLIDAR_DATA", str(real_data))
    outputs = executed(path, tmp_path)
    assert figures(outputs) == FIGURES[path.stem][1]
    assert "Skipped" not in printed(outputs)
