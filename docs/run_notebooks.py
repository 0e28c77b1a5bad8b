"""Runs the notebooks and stores their outputs and pictures: python docs/run_notebooks.py [NAME ...]

Stored notebooks hold no times of execution and no paths of this machine.
"""
from __future__ import annotations

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).resolve().parent / "notebooks"
SECONDS = 300       # of one cell, on a busy machine


def executed(path: Path) -> nbformat.NotebookNode:
    """The notebook with new outputs.

    Raises
    ------
    nbclient.exceptions.CellExecutionError
        If a cell fails.
    """
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=SECONDS, kernel_name="python3", record_timing=False).execute()
    notebook.metadata = {"kernelspec": notebook.metadata["kernelspec"],
                         "language_info": {"name": "python"}}
    for cell in notebook.cells:     # without progress bars, which come and go
        if cell.cell_type == "code":
            cell.outputs = [one for one in cell.outputs if one.get("name") != "stderr" and (
                one.output_type != "display_data" or "image/png" in one["data"])]
    return notebook


if __name__ == "__main__":
    for one in sorted(NOTEBOOKS.glob("*.ipynb")):
        if len(sys.argv) == 1 or one.stem in sys.argv[1:]:
            nbformat.write(executed(one), one)
            print(f"{one.name} run and stored")
