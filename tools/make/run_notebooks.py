"""Execute the notebooks and store their outputs.

`python tools/make/run_notebooks.py [NAME ...]` needs nbclient and ipykernel.

What is written to stderr, and when each cell ran, is not stored, so that outputs differ only where
results do.
"""

import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[2] / "notebooks"


def execute(path: Path) -> None:
    """Run a notebook from top to bottom in a new directory, and replace its outputs."""
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as directory:
        client = NotebookClient(
            notebook, timeout=600, record_timing=False, resources={"metadata": {"path": directory}}
        )
        client.execute()
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
    notebook.metadata = {
        "kernelspec": notebook.metadata["kernelspec"],
        "language_info": {"name": "python"},
    }
    nbformat.write(notebook, path)


if __name__ == "__main__":
    for found in sorted(FOLDER.glob("*.ipynb")):
        if not sys.argv[1:] or found.stem in sys.argv[1:]:
            execute(found)
            print(found.relative_to(FOLDER.parent))
