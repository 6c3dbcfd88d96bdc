"""Execute the notebooks and store their outputs.

    python tools/make/run_notebooks.py [NAME ...]     # pip install nbclient ipykernel

Neither stderr nor the times of cells are stored, so that outputs differ only where results do.
Notebooks run in a new directory, beside which lie the tables of examples/.
"""

import argparse
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[2] / "notebooks"


def execute(path: Path) -> None:
    """Run a notebook from top to bottom in a new directory, and replace its outputs."""
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as directory:
        (Path(directory) / "examples").symlink_to(FOLDER.parent / "examples")
        folder = Path(directory) / "notebooks"
        folder.mkdir()
        resources = {"metadata": {"path": str(folder)}}
        client = NotebookClient(notebook, timeout=600, record_timing=False, resources=resources)
        client.execute()
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
    notebook.metadata = {
        "kernelspec": notebook.metadata["kernelspec"],
        "language_info": {"name": "python"},
    }
    nbformat.write(notebook, path)


def main() -> None:
    """Execute the notebooks that are named."""
    notebook_of = {path.stem: path for path in sorted(FOLDER.glob("*.ipynb"))}
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(notebook_of))
    names = parser.parse_args().names
    unknown = set(names) - set(notebook_of)
    if unknown:
        parser.error(f"there is no notebook {min(unknown)}")
    for name in names or notebook_of:
        execute(notebook_of[name])
        print(notebook_of[name].relative_to(FOLDER.parent))


if __name__ == "__main__":
    main()
