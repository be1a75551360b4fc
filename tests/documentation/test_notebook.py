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


def executed(texts: list[str], folder: Path) -> list[Any]:
    """The cells of a notebook of these texts after a kernel has run them."""
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text) for text in texts])
    path = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = f"{ROOT}{os.pathsep}{path}"
    try:
        nbclient.NotebookClient(notebook, timeout=240, kernel_name="python3").execute(cwd=str(folder))
    finally:
        os.environ["PYTHONPATH"] = path
    return list(notebook.cells)


@pytest.fixture(scope="module")
def cells(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    folder = tmp_path_factory.mktemp("notebook")
    cells = executed(CELLS, folder)
    assert (folder / "run.h5").stat().st_size > 1000
    assert (folder / "run.html").stat().st_size > 1000
    return cells


def shown(cell: Any) -> dict[str, str]:
    return {kind: text for output in cell.outputs for kind, text in output.get("data", {}).items()}


@pytest.mark.filterwarnings("ignore")
def test_results_comparisons_and_figures_show_in_a_notebook(cells: list[Any]) -> None:
    assert ">RMSE</th>" in shown(cells[0])["text/html"]
    assert "image/png" in shown(cells[3])
    assert "rmse" in shown(cells[4])["text/html"]
    assert "<table>" in shown(cells[5])["text/html"]
    assert cells[6].outputs[0].text.startswith("\\begin{tabular}")
    errors = [output for cell in cells for output in cell.outputs if output.output_type == "error"]
    assert errors == []


@pytest.mark.filterwarnings("ignore")
def test_every_plot_of_a_notebook_shows_and_the_users_own_after_it(tmp_path: Path) -> None:
    first = "import wsnsim\nresult = wsnsim.simulate('rkf', duration=4)\nresult.plot();"
    own = "from matplotlib import pyplot\npyplot.plot([1, 2]);"
    cells = executed([first, "result.plot.error();", "result.plot('states');", own], tmp_path)
    assert [list(shown(cell)) for cell in cells] == [["text/plain", "image/png"]] * 4


BAR = """
import time
from wsnsim.api import arguments
arguments.WAIT = 1e-3
print("before")
with arguments.shown(True, "compare", "runs", lambda now: now) as step:
    for done in range(1, {done} + 1):
        time.sleep(0.2)
        step((done, 3))
"""


@pytest.mark.filterwarnings("ignore")
def test_a_bar_leaves_nothing_in_a_saved_notebook_whether_the_work_is_done_or_not(tmp_path: Path) -> None:
    for cell in executed([BAR.format(done=2), BAR.format(done=3)], tmp_path):
        text, bar = cell.outputs
        assert (text.text, bar.data) == ("before\n", {"text/plain": ""})
