"""The notebooks of the documentation run as they are stored, with pictures and without paths."""
import re
import runpy
from pathlib import Path

import nbformat
import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))
# Pictures are not compared: a grainy one takes a tenth of the time, and no number is taken from it.
GRAINY = ("spp=256", "spp=4")


def printed(cell):
    """What a cell prints and returns: no pictures, no progress bars."""
    return "".join(output.get("text", "") if output.get("name") == "stdout" else
                   output["data"].get("text/plain", "")
                   for output in cell.get("outputs", ())
                   if output.get("name") == "stdout" or output.output_type == "execute_result")


def words(cell):
    """The same without numbers, which other machines round otherwise."""
    return re.sub(r"[-\d.\s]+", " ", printed(cell))


# from kernels and their sockets, which close when they please
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning",
                            "ignore::RuntimeWarning",
                            "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_prints_what_is_stored(path, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(DOCS.parent))
    (tmp_path / path.name).write_text(path.read_text(encoding="utf-8").replace(*GRAINY),
                                      encoding="utf-8")
    again = runpy.run_path(str(DOCS / "run_notebooks.py"))["executed"](tmp_path / path.name)
    for stored, made in zip(nbformat.read(path, as_version=4).cells, again.cells, strict=True):
        assert words(made) == words(stored), stored.source


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_stored_notebook_has_pictures_and_no_paths_of_a_machine(path):
    notebook = nbformat.read(path, as_version=4)
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 2
    assert not any(output.output_type == "error" for output in outputs)
    for cell in notebook.cells:
        assert not re.search(r"/(tmp|home|root|work|Users)/", printed(cell)), cell.source
    assert notebook.metadata == {"kernelspec": notebook.metadata["kernelspec"],
                                 "language_info": {"name": "python"}}
