"""The notebooks run from the first cell to the last, and are kept without what they have shown."""

import os

import nbformat
import pytest
from helpers.problems import ROOT
from nbclient import NotebookClient

NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))
# the same in less time
SHORTER = {
    "seconds=60": "seconds=1",
    "epochs=300": "epochs=3",
    "episodes=10": "episodes=2",
    "episodes=20": "episodes=2",
    "horizon=30": "horizon=4",
    "horizon=40": "horizon=4",
    "horizon = 40": "horizon = 4",
    "iterations_per_call=25": "iterations_per_call=1",
}


def test_there_are_three():
    assert [path.stem for path in NOTEBOOKS] == ["first_hour", "own_model", "own_noise"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_valid_and_kept_without_outputs(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in code)
    compile("\n".join(cell.source for cell in code), path.name, "exec")


@pytest.mark.long  # compiles several planners
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, tmp_path, monkeypatch):
    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        for old, new in SHORTER.items():
            cell.source = cell.source.replace(old, new)
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    resources = {"metadata": {"path": str(tmp_path)}}
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources=resources).execute()
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    outputs = [output for cell in code for output in cell.outputs]
    assert not [output for output in outputs if output.output_type == "error"]
    # the last cell shows what the notebook was for
    assert code[-1].outputs
