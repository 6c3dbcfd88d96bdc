"""What pages say of results in their prose: no number that is not written from them, and verdicts as they are.

Numbers of results stand in blocks, see `test_results.py`. Any other number in prose must be known in
`helpers_numbers.py`, so that none stays behind unnoticed when results are made anew. What stands in code, and number
words, are not looked for.
"""

import csv
import re
from pathlib import Path

import pytest
from helpers_numbers import MEASURED, OTHER_NUMBERS, VERDICTS

from iswarm_mj.experiments.report.blocks import outside
from iswarm_mj.experiments.report.statements import FINDINGS

ROOT = Path(__file__).parents[1]
PAGES = ["README.md", "CONTRIBUTING.md", "results/README.md", *(f"docs/{p.name}" for p in (ROOT / "docs").glob("*.md"))]
NOT_PROSE = (
    r"<!-- made: .*?<!-- made -->",  # tables that the code determines
    r"<!--.*?-->",
    r"^```.*?^```",
    r"^\|.*?$",  # heads of tables are known to test_results.py
    r"(`+)(?:(?!\n\n).)+?\1",
    r"(?<=\])\([^)]*\)",  # targets of links
    r"^ *\d\. ",  # of lists
)
NAMES = (
    r"\b(?:(?:Fig\.|Eq\.|Table|[Ss]ection) \d[\d.]*\b|[Tt]ypes? [12]\b"
    r"|(?:Figs\.|Eqs\.|Tables|[Ss]ections) \d[\d.]*\b(?: (?:and|to) \d[\d.]*\b)*)"
)
"""Places in the paper, and its types of robots."""
NUMBER = r"(?<![^\W_])\d[\d.,]*"
COMMAND = r"`(?:iswarm|python|pytest|taskset) |tests/\w|^```(?:bash|sh)$"
REMEDY = "say it in words and leave numbers to a block of results; if it is not of results: tests/helpers_numbers.py"


def sections(text):
    """Sections of a page by their headings, without the contents of its blocks of results."""
    text = re.sub(r"^```.*?^```", lambda code: code[0].replace("\n#", "\n #"), outside(text), flags=re.M | re.S)
    found = {}
    for part in filter(None, re.split(r"^(?=#+ )", text, flags=re.MULTILINE)):
        name = part.split("\n", 1)[0].lstrip("# ")
        found[name] = found.get(name, "") + part
    return found


def prose(section):
    """What is written in words, in one line."""
    for pattern in NOT_PROSE:
        section = re.sub(pattern, " ", section, flags=re.MULTILINE | re.DOTALL)
    return " ".join(section.split())


def numbers(section):
    """Numbers in the prose of a section that are not known, each with the words around it."""
    text = prose(section)
    for known in OTHER_NUMBERS:
        text = text.replace(known, " ")
    text = re.sub(NAMES, " ", text)
    return [text[max(0, found.start() - 30) : found.end() + 30] for found in re.finditer(NUMBER, text)]


def unmeasured(page):
    """Sections of a page in which each number has to be known."""
    found = sections((ROOT / page).read_text())
    return {name: part for name, part in found.items() if (page, name) not in MEASURED}


@pytest.mark.parametrize("page", PAGES)
def test_numbers_in_prose_are_known(page):
    unknown = {name: numbers(part) for name, part in unmeasured(page).items()}
    assert {name: found for name, found in unknown.items() if found} == {}, REMEDY


@pytest.mark.parametrize("page", PAGES)
def test_another_number_is_noticed(page):
    for words in ("The swarm takes 299 steps.", "- 299 steps", "**299**", "*299 steps*", "## 299 steps"):
        assert {name for name, part in unmeasured(page).items() if len(numbers(f"{part}\n{words}\n")) != 1} == set()


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("Table 2 and Figs. 15 and 17 (section 4.6.1), type 1, on an H200", 0),
        ("`299` steps, [steps](299.md)\n<!-- results: types -->\n\n| 299 |\n\n<!-- end -->\n", 0),
        ("```sh\n# 299\n```\n\n2. steps", 0),
        ("In Fig. 15, 299 steps", 1),
        ("1,299.5 steps (95 % of 72)", 3),
        ("# A\n\n299\n\n# B\n\n# A\n\nsteps", 1),
        ("[299 steps](x.md), a lone ` and\n\n299 steps ` too", 2),
    ],
)
def test_what_counts_as_a_number_in_prose(text, found):
    assert sum(len(numbers(part)) for part in sections(text).values()) == found


def test_known_numbers_are_there():
    text = "\n".join(prose(part) for page in PAGES for part in unmeasured(page).values())
    assert [known for known in OTHER_NUMBERS if known not in text or not re.search(NUMBER, known)] == []


@pytest.mark.parametrize(("page", "name"), sorted(MEASURED))
def test_what_measures_stands_beside_the_numbers(page, name):
    part = sections((ROOT / page).read_text())[name]
    assert re.search(COMMAND, part, re.MULTILINE) and re.search(NUMBER, prose(part))
    assert "<!-- results" not in part, "numbers of results and of other measurements stand in sections of their own"


@pytest.mark.parametrize(
    ("page", "results", "words", "claim", "verdict"), [(*of, *said) for of, each in VERDICTS.items() for said in each]
)
def test_prose_says_what_the_verdict_is(page, results, words, claim, verdict):
    assert words in " ".join((ROOT / page).read_text().split())
    with (ROOT / results / FINDINGS).open(encoding="utf-8", newline="") as file:
        (found,) = [row for row in csv.DictReader(file) if row["claim"].startswith(claim)]
    if verdict in ("more", "less"):
        one, other = re.findall(r"(\S+) against (\S+)", found["ours"])[0]
        assert (float(one) > float(other)) == (verdict == "more")
        assert found["verdict"] in ("holds", "")
    else:
        assert found["verdict"] == verdict
