"""The Python that pages show runs."""

import re

import numpy as np
import pytest
import voidage
from test_simulation import BED

from conftest import ROOT

PYTHON = "coupling/python/README.md"
#: Folders of the repository with pages in them or cited by them.
FOLDERS = ("cases", "coupling", "dem", "fluid", "tests")


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


def cited(page, text: str) -> list[str]:
    """Links and pictures of a page that are files, and paths in its code spans, that are not there."""
    text = re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text) + re.findall(r'src="([^"]+)"', text)
    gone = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    words = (word.strip(",.;:") for span in re.findall(r"`([^`\n]+)`", text) for word in span.split())
    paths = [word for word in words if re.fullmatch(r"(?:%s)/[\w./-]+" % "|".join(FOLDERS), word)]
    return gone + [path for path in paths if not (ROOT / path).exists()]


def test_the_files_that_pages_cite_are_there():
    pages = [ROOT / "README.md", *(page for folder in FOLDERS for page in (ROOT / folder).rglob("*.md"))]
    assert len(pages) > 20
    gone = {str(page.relative_to(ROOT)): cited(page, page.read_text(encoding="utf-8")) for page in pages}
    assert not any(gone.values()), {page: paths for page, paths in gone.items() if paths}


def test_a_file_that_is_not_there_is_found():
    text = "[a](no.md) [b](README.md#x) `tests/verification/bed.rs` `cargo run tests/run` ![c](lost.png)"
    assert cited(ROOT / "README.md", text) == ["no.md", "lost.png", "tests/verification/bed.rs"]
