"""A notebook made of the page about notebooks runs in a Jupyter kernel, and its results show as HTML and figures."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/how-to/notebooks.md").read_text(encoding="utf-8")
CELLS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(scope="module")
def cells(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    folder = tmp_path_factory.mktemp("notebook")
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text) for text in CELLS])
    path = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = f"{ROOT}{os.pathsep}{path}"
    try:
        nbclient.NotebookClient(notebook, timeout=240, kernel_name="python3").execute(cwd=str(folder))
    finally:
        os.environ["PYTHONPATH"] = path
    assert (folder / "run.h5").stat().st_size > 1000
    assert (folder / "run.html").stat().st_size > 1000
    return list(notebook.cells)


def shown(cell: Any) -> dict[str, str]:
    return {kind: text for output in cell.outputs for kind, text in output.get("data", {}).items()}


@pytest.mark.filterwarnings("ignore")
def test_results_comparisons_and_figures_show_in_a_notebook(cells: list[Any]) -> None:
    assert "time-averaged RMSE" in shown(cells[0])["text/html"]
    assert "image/png" in shown(cells[3])
    assert "rmse" in shown(cells[4])["text/html"]
    assert "<table>" in shown(cells[5])["text/html"]
    errors = [output for cell in cells for output in cell.outputs if output.output_type == "error"]
    assert errors == []
