"""Every notebook runs from top to bottom and draws, and is committed without its results."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
import pytest

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
FIGURES = {
    "01_disparity_to_depth": (9, 13),
    "02_against_velodyne": (7, 12),
    "03_obstacles": (6, 11),
    "04_mapping": (5, 7),
}  # without and with real data
CELL_LIMIT_S = 300  # a cell that hangs; the slowest takes seconds

every_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def code_cells(notebook: nbformat.NotebookNode) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


class Run:
    """A notebook in a kernel of its own, which stays for cells that are run again."""

    def __init__(self, path: Path, folder: Path) -> None:
        from nbclient import NotebookClient

        self.path, self.folder = path, folder
        self.notebook = nbformat.read(path, as_version=4)
        where = {"metadata": {"path": str(folder)}}
        self.client = NotebookClient(
            self.notebook, timeout=CELL_LIMIT_S, kernel_name="python3", resources=where
        )

    def outputs(self, cells: list[Any]) -> list[Any]:
        """Run cells in turn; one that raises fails the test."""
        for cell in cells:
            self.client.execute_cell(cell, self.notebook.cells.index(cell))
        return [output for cell in cells for output in cell.outputs]

    def tell(self, line: str) -> None:
        """Run a line that is not in the notebook."""
        self.notebook.cells.append(nbformat.v4.new_code_cell(line))
        self.outputs(self.notebook.cells[-1:])


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


@pytest.fixture(scope="module", params=NOTEBOOKS, ids=lambda path: path.stem)
def ran(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Run, list[Any]]]:
    """A notebook that was run from top to bottom where there is no data, and its cells."""
    run = Run(request.param, tmp_path_factory.mktemp("run"))
    cells = code_cells(run.notebook)
    with run.client.setup_kernel():
        run.tell(f"%env PSEUDOLIDAR_DATA={run.folder / 'nowhere'}")
        run.outputs(cells)
        yield run, cells


def test_it_runs_where_there_is_no_data_and_says_what_it_leaves_out(ran):
    run, cells = ran
    outputs = [output for cell in cells for output in cell.outputs]
    assert figures(outputs) == FIGURES[run.path.stem][0]
    assert "Skipped" in printed(outputs)
    assert not list(run.folder.iterdir())  # nothing left behind


@pytest.mark.real
def test_it_runs_on_real_data(ran, real_data):
    """Where the data begins: what comes before is as it was without."""
    run, cells = ran
    begin = next(i for i, cell in enumerate(cells) if "Skipped" in printed(cell.outputs))
    before = sum(figures(cell.outputs) for cell in cells[:begin])
    run.tell(f"%env PSEUDOLIDAR_DATA={real_data}")
    outputs = run.outputs(cells[begin:])
    assert before + figures(outputs) == FIGURES[run.path.stem][1]
    assert "Skipped" not in printed(outputs)
    assert not list(run.folder.iterdir())
