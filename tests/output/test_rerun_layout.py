"""Views of recordings for Rerun, the robots that have a lane, and the legend."""

import numpy as np
import pytest
import rerun.blueprint as rrb
from rerun.chunk import RrdReader
from support.swarm_recording import make_frames, make_scene, write

from iswarm_mj.output.message_columns import payload_json
from iswarm_mj.output.rerun_swarm import legend_text, shown_lanes, swarm_views
from iswarm_mj.sensors.messages import Payload


def test_lanes_are_of_living_robots_from_the_first_to_the_last():
    scene = make_scene(40)._replace(is_alive=np.arange(40) > 9)
    lanes = shown_lanes(scene)
    assert len(lanes) == 8 and (lanes[0], lanes[-1]) == (10, 39)


def test_a_small_swarm_has_a_lane_for_each_living_robot():
    scene = make_scene(3)
    assert shown_lanes(scene) == (0, 1, 2)
    assert shown_lanes(scene._replace(is_alive=np.zeros(3, bool))) == ()


@pytest.fixture
def arena_views():
    """Views of the arena by name."""
    tabs = swarm_views(make_scene()).contents[0]
    return {view.name: view for view in tabs.contents}


def test_views_hide_what_others_show(arena_views):
    hidden = {}
    for name, view in arena_views.items():
        overrides = view.visualizer_overrides.items()
        hidden[name] = {
            entity for entity, look in overrides if isinstance(look, rrb.EntityBehavior)
        }

    dust = "world/memory/dust"
    dump = "world/memory/dump"
    links = "world/links"
    trails = "world/trails"
    all_but_robots = {dust, dump, links, trails, "world/balls/marker"}
    assert hidden == {
        "Arena (mm)": {dust, dump},
        "Vectors: dust (mm)": {dump, links, trails},
        "Vectors: dump (mm)": {dust, links, trails},
        "Hop counts: dust": all_but_robots,
        "Hop counts: dump": all_but_robots,
        "Links and ids": {dust, dump, trails},
    }


@pytest.mark.parametrize("name", ["dust", "dump"])
def test_hop_counts_colour_the_robots(arena_views, name):
    overrides = arena_views[f"Hop counts: {name}"].visualizer_overrides
    (mapping,) = overrides["world/robots/body"].mappings
    assert mapping.source_component == f"{name}_hop_colour"


@pytest.mark.parametrize("teams", [(), ("home", "guests")])
def test_the_legend_names_teams(tmp_path, teams):
    sizes = (4, 2)[: len(teams)]
    scene = make_scene(6, 1)._replace(team_names=teams, team_sizes=sizes)
    write(tmp_path / "a.rrd", scene, make_frames(scene, 2), cuts=())

    chunks = RrdReader(tmp_path / "a.rrd").stream().to_chunks()
    (legend,) = [chunk for chunk in chunks if chunk.entity_path == "/legend"]
    (row,) = legend.to_record_batch().to_pylist()
    text = row["TextDocument:text"][0]
    assert ("by group: home, guests; darker: loaded" in text) == bool(teams)
    assert ("orange empty" in text) != bool(teams)


def test_the_legend_leaves_out_what_the_swarm_does_not_have():
    scene = make_scene(6, 1)._replace(
        ball_radius=np.zeros(0),
        dump=np.zeros(4),
        dust_areas=np.zeros((0, 4)),
        payload=payload_json(Payload()),
        memory_names=(),
        memory_units=(),
        memory_sizes=(),
    )
    text = legend_text(scene)
    assert text.startswith("**Robots**: orange empty")
    for absent in (
        "Balls",
        "blue loaded",
        "priority",
        "yellow the dump",
        "trail of",
        "Hop counts**",
    ):
        assert absent not in text
    assert "**States**: colours as robots, greyer if it stands." in text
