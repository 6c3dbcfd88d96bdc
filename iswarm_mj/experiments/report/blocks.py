"""Marked blocks of Markdown pages, whose content is written from results; nothing outside of them is touched.

A block begins with a line `<!-- DIRECTORY: NAME -->`, where the directory is `results` or another one whose name begins
so, and the name one that `tables` knows; it ends with a line `<!-- end -->`. `<!-- DIRECTORY: NAME beside OTHER -->`
has the results of two directories, such as those of two configurations.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, check_file

START = re.compile(r"^<!-- (results[\w./-]*): *([\w-]+)(?: +beside +(results[\w./-]*))? *-->$")
END = "<!-- end -->"

Fill = Callable[[str, str, str | None], str | None]
"""Content of a block from its directory, its name, and the other directory if it has one; None leaves the block as it
is, a `UserError` means that it cannot be filled."""


def filled(text: str, page: str, fill: Fill) -> str:
    """Return the text of a page with its blocks filled anew.

    Args:
        text: of the page.
        page: its name, for errors.
        fill: gives the content of a block.

    Raises:
        UserError: a block does not end or begin, or it names something that is not there; the message names the line.
    """
    kept, begun, new = [], 0, None
    for number, line in enumerate(text.splitlines(), 1):
        start = START.match(line)
        if begun and start:
            raise UserError(f"{page}:{begun}: the block of results has no line {END!r} before line {number}; add one.")
        if line == END and not begun:
            raise UserError(f"{page}:{number}: this line ends no block of results; remove it.")
        if not begun or line == END or new is None:
            kept.append(line)
        if start:
            try:
                new = fill(*start.groups())
            except UserError as error:
                raise UserError(f"{page}:{number}: {error}") from None
            kept += [] if new is None else ["", new.strip("\n"), ""]
        begun = number if start else 0 if line == END else begun
    if begun:
        raise UserError(f"{page}:{begun}: the block of results has no line {END!r}; add one.")
    return "\n".join(kept) + "\n"


def outside(text: str) -> str:
    """Return a page without the contents of its blocks."""
    return filled(text, "", lambda *block: "")


def new_texts(pages: Iterable[Path], fill: Fill) -> dict[Path, str]:
    """Texts of those pages that change if their blocks are filled anew; writes nothing.

    Raises:
        UserError: a page cannot be read, or as `filled` does.
    """
    found = {}
    for page in pages:
        try:
            check_file(page)
            text = page.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            raise UserError(f"{page} is not a readable page; give Markdown files.") from None
        if (new := filled(text, str(page), fill)) != text:
            found[page] = new
    return found


def write(texts: Mapping[Path, str]) -> None:
    """Replace these files.

    Raises:
        UserError: one of them cannot be written.
    """
    for path, text in texts.items():
        with atomic_write(path) as part:
            part.write_text(text, encoding="utf-8")
