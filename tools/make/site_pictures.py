"""Hook of the documentation site: figures of results/, which lies beside docs/, and dark pictures.

A picture NAME.svg beside which there is NAME-dark.svg is shown in the colours of the page; so are
pictures of other types.
"""

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
_PICTURE_OF_RESULTS = re.compile(r"\]\(\.\./(results/[\w/.-]+\.(?:png|svg))\)")
_PICTURE = re.compile(r"!\[([^\]]*)\]\(([\w/.-]+)\.(png|svg|webp)\)")


def on_files(files: Files, *, config: Any) -> Files:
    """Add the figures that pages show, and return the files of the site."""
    texts = [
        Path(page.abs_src_path).read_text(encoding="utf-8") for page in files.documentation_pages()
    ]
    names = {name for text in texts for name in _PICTURE_OF_RESULTS.findall(text)}
    for name in sorted(names):
        for path in (ROOT / name, _dark(ROOT / name)):
            if path.is_file():
                place = f"figures/{path.relative_to(ROOT)}"
                files.append(File.generated(config, place, abs_src_path=str(path)))
    return files


def _dark(path: Path) -> Path:
    """Return the path of a picture's dark variant."""
    return path.with_name(f"{path.stem}-dark{path.suffix}")


def on_page_markdown(markdown: str, *, page: Page, files: Files, **_: Any) -> str:
    """Return the text of a page with links to the figures of the site, and dark variants."""
    text = _PICTURE_OF_RESULTS.sub(r"](figures/\1)", markdown)
    directory = Path(page.file.src_uri).parent

    def with_dark_variant(picture: re.Match[str]) -> str:
        title, name, suffix = picture.groups()
        if files.get_file_from_path(f"{directory / name}-dark.{suffix}") is None:
            return picture[0]
        light = f"![{title}]({name}.{suffix}#only-light)"
        return f"{light}![{title}]({name}-dark.{suffix}#only-dark)"

    return _PICTURE.sub(with_dark_variant, text)
