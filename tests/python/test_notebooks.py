"""The notebooks run from beginning to end."""

import os
import subprocess
from pathlib import Path

import pytest

from conftest import ROOT

FOLDER = ROOT / "coupling" / "python" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
DOLFINX = ["/usr/bin/python3", "-c", "import dolfinx"]


def has_dolfinx() -> bool:
    try:
        return subprocess.run(DOLFINX, capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def test_there_are_notebooks_with_results():
    nbformat = pytest.importorskip("nbformat", reason="tests/python-setup installs nbformat")
    assert len(NOTEBOOKS) >= 3
    for file in NOTEBOOKS:
        assert file.stat().st_size < 300_000, f"{file}: its outputs are large"
        cells = nbformat.read(file, as_version=4).cells
        codes = [cell for cell in cells if cell.cell_type == "code"]
        assert all(cell.execution_count for cell in codes), f"{file} was not executed"
        pictures = [out for cell in codes for out in cell.outputs if "image/png" in out.get("data", {})]
        assert pictures, f"{file} shows no picture"


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_runs(file: Path, tmp_path: Path, monkeypatch):
    nbformat = pytest.importorskip("nbformat", reason="tests/python-setup installs nbformat")
    nbclient = pytest.importorskip("nbclient", reason="tests/python-setup installs nbclient")
    pytest.importorskip("matplotlib", reason="tests/python-setup installs matplotlib")
    if "fenicsx" in file.stem and not has_dolfinx():
        pytest.skip("there is no dolfinx for /usr/bin/python3; tests/python-setup installs it")
    path = os.pathsep.join([str(ROOT / "coupling" / "python"), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", path)
    book = nbformat.read(file, as_version=4)
    # An error in a cell is an error here.
    nbclient.NotebookClient(
        book, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
