"""The Python that pages show runs."""

import re

import numpy as np
import pytest
import voidage
from test_simulation import BED

from conftest import ROOT

PYTHON = "coupling/python/README.md"


def blocks(page: str) -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
    found = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    assert found, f"{page} shows no Python"
    return found


@pytest.mark.parametrize("page", ["README.md", PYTHON])
def test_the_solver_of_a_page_blows_its_stream(page):
    (source,) = (block for block in blocks(page) if block.startswith("# stream.py"))
    assert len(source.splitlines()) <= 20
    names: dict[str, type] = {}
    exec(source, names)
    simulation = voidage.Simulation(BED, fluid=names["Stream"]())
    report = simulation.run(until=0.003)
    assert report["momentum_exchange_defect"] < 1e-12
    np.testing.assert_array_equal(simulation.fluid["velocity"], 0.1)


def test_the_script_of_a_page_drives_a_scene(monkeypatch):
    (source,) = (block for block in blocks(PYTHON) if block.startswith("import voidage"))
    assert "until=0.5" in source
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    exec(source.replace("until=0.5", "until=0.01"), names)
    bed = names["bed"]
    assert isinstance(bed, voidage.Simulation)
    assert bed.time == pytest.approx(0.01)
    assert np.shape(names["velocity"]) == (len(bed.grains["velocity"]), 2)
    assert np.all(np.isfinite(names["pressure"]))
