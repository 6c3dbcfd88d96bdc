"""Views of recordings for Rerun, the robots that have a lane, and the legend."""

import numpy as np
import pytest
import rerun.blueprint as rrb
from rerun.chunk import RrdReader
from support.swarm_recording import make_frames, make_scene, write

from iswarm_mj.output.rerun_swarm import shown_lanes, swarm_views


def test_lanes_by_default_are_of_living_robots_from_the_first_to_the_last():
    scene = make_scene(40)._replace(is_alive=np.arange(40) > 9)
    chosen = shown_lanes(scene)
    assert len(chosen) == 8 and (chosen[0], chosen[-1]) == (10, 39)
    assert shown_lanes(make_scene(3)) == (0, 1, 2)
    assert shown_lanes(make_scene(3)._replace(is_alive=np.zeros(3, bool))) == ()


def test_views_hide_what_others_show():
    views = swarm_views(make_scene()).contents[0].contents
    hidden = {
        view.name: {n for n, own in view.visualizer_overrides.items() if isinstance(own, rrb.EntityBehavior)}
        for view in views
    }
    dust, dump, links, trails = "world/memory/dust", "world/memory/dump", "world/links", "world/trails"
    bare = {dust, dump, links, trails, "world/balls/marker"}
    assert hidden == {
        "Arena (mm)": {dust, dump},
        "Vectors: dust (mm)": {dump, links, trails},
        "Vectors: dump (mm)": {dust, links, trails},
        **{f"Hop counts: {name}": bare for name in ("dust", "dump")},
        "Links and ids": {dust, dump, trails},
    }
    coloured = {view.name: view.visualizer_overrides.get("world/robots/body") for view in views}
    for name in ("dust", "dump"):
        assert coloured[f"Hop counts: {name}"].mappings[0].source_component == f"{name}_hop_colour"


@pytest.mark.parametrize("teams", [(), ("home", "guests")])
def test_the_legend_names_teams(tmp_path, teams):
    scene = make_scene(6, 1)._replace(team_names=teams, team_sizes=(4, 2)[: len(teams)])
    write(tmp_path / "a.rrd", scene, make_frames(scene, 2), cuts=())
    chunks = RrdReader(tmp_path / "a.rrd").stream().to_chunks()
    (row,) = (row for c in chunks if c.entity_path == "/legend" for row in c.to_record_batch().to_pylist())
    text = row["TextDocument:text"][0]
    assert ("by group: home, guests; darker: loaded" in text) == bool(teams)
    assert ("orange empty" in text) != bool(teams)
