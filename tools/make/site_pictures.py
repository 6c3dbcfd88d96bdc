"""Hook of the documentation site: pages show figures of results/, which lies beside docs/."""

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[2]
_LINK = re.compile(r"\]\(\.\./(results/[\w/.-]+\.png)\)")


def on_files(files: Files, *, config: Any) -> Files:
    """Add the figures that pages show, and return the files of the site."""
    pages = [
        Path(page.abs_src_path).read_text(encoding="utf-8") for page in files.documentation_pages()
    ]
    for name in sorted({name for text in pages for name in _LINK.findall(text)}):
        files.append(File.generated(config, f"figures/{name}", abs_src_path=str(ROOT / name)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Return the text of a page with links to the figures of the site."""
    return _LINK.sub(r"](figures/\1)", markdown)
