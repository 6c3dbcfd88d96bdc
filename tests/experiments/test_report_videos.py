"""Videos of a report, which its page links to."""

import re
import shutil
from pathlib import Path
from urllib.parse import unquote

from iswarm_mj.experiments.report.writer import report

ROOT = Path(__file__).parents[2]


def test_the_page_has_links_to_videos_and_stays_small(tmp_path):
    results = tmp_path / "results"
    shutil.copytree(ROOT / "results-initial/types", results / "types")
    film = bytes(6_000_000)
    (results / "types/type1.mp4").write_bytes(film)
    out = tmp_path / "of mine.html"
    report([results], out)
    text = out.read_text()
    (source,) = re.findall('<video[^>]* src="(.*?)">', text)
    assert source == "of%20mine_figures/type1.mp4" and f'<a href="{source}">type1.mp4</a>' in text
    assert (tmp_path / unquote(source)).read_bytes() == film
    assert len(text) < 5_000_000 and text.count("data:image/png") >= 4
