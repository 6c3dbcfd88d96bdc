"""Each control has the range that its setting declares, and takes no other value."""

from dataclasses import replace

import pytest
from support.page import CONFIG

from iswarm_mj.config.swarm import ArenaConfig, OpticsConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.player.controls import Control, controls, in_page_units, may_change_at_once
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.strategy.genome import PRESETS, TYPE1
from iswarm_mj.tasks.aggregation import Aggregation, Beeclust
from iswarm_mj.utils.constraints import Above, Within
from iswarm_mj.utils.errors import ConfigError, UserError

SCENARIO = PageScenario(CONFIG, robots=20, seed=3, engine=PlanarSettings())
NAN = float("nan")
INFINITY = float("inf")
HUGE = 10**400
"""A whole number that no float can have."""

FLOAT = Control("width", "", 0.5, limits=Within(0.0, 2.0, "rd"))
POSITIVE = Control("radius", "", 0.5, limits=Above(0.0, 2.0, "rd"))
WHOLE = Control("count", "", 3, limits=Within(1, 9))
UNLIMITED = Control("free", "", 1.0)
SWITCH = Control("switch", "", True)
WORD = Control("word", "", "red", choices=("red", "blue"))

REFUSED = [
    (FLOAT, [-0.1, 2.1, NAN, INFINITY, HUGE, "1", None, True, [1.0], {}]),
    (POSITIVE, [0, 0.0, -1, 2.1]),
    (WHOLE, [0, 10, 4.5, NAN, -HUGE, "4", True, b"4"]),
    (UNLIMITED, [NAN, -INFINITY, HUGE, "1"]),
    (SWITCH, [1, 0, "true", None]),
    (WORD, ["green", "", 1, None, ["red"], "/tmp/red.py:X"]),
]
"""Values that each kind of control refuses."""


def by_name(scenario):
    """Return the controls of a scenario by their names."""
    return {control.name: control for control in controls(scenario)}


@pytest.mark.parametrize(
    ("control", "sent", "expected"),
    [
        (FLOAT, 1, 1.0),
        (FLOAT, 0.25, 0.25),
        (POSITIVE, 2, 2.0),
        (WHOLE, 4.0, 4),
        (UNLIMITED, -1e300, -1e300),
        (SWITCH, False, False),
        (WORD, "blue", "blue"),
    ],
)
def test_a_control_takes_values_of_its_range_as_values_of_its_type(control, sent, expected):
    value = control.convert(sent)
    assert value == expected
    assert type(value) is type(control.value)


@pytest.mark.parametrize(
    ("control", "sent"), [(control, value) for control, values in REFUSED for value in values]
)
def test_a_control_refuses_other_values(control, sent):
    with pytest.raises(ConfigError, match=f"{control.name} must be"):
        control.convert(sent)


def test_controls_have_the_ranges_that_settings_declare():
    of_cleaning = by_name(SCENARIO)
    forget = of_cleaning["p_vector_forget"]
    assert (forget.low, forget.high, forget.value) == (0, 1, 0.29)
    assert of_cleaning["strategy.priority_repulsion"].choices == ("higher", "scaled")
    assert of_cleaning["robots"].value == 20


def test_controls_are_those_of_the_strategy_and_the_task():
    of_aggregation = by_name(PageScenario(strategy=Beeclust(), task=Aggregation()))
    assert "longest_wait" in of_aggregation
    assert "p_vector_forget" not in of_aggregation
    assert "gripper.drop_rate" not in of_aggregation


def test_settings_that_programs_take_as_arrays_may_change_while_a_run_goes_on():
    of_cleaning = by_name(SCENARIO)
    assert of_cleaning["p_vector_forget"].is_live
    assert not of_cleaning["robots"].is_live
    assert by_name(PageScenario(strategy=Beeclust(), task=Aggregation()))["longest_wait"].is_live
    assert not may_change_at_once(SCENARIO, "fraction_scouts")
    assert not may_change_at_once(SCENARIO, "arena.size")


def test_each_control_takes_its_own_value():
    for control in controls(SCENARIO):
        assert SCENARIO.set(control.name, control.value).get(control.name) == control.value


def test_a_density_takes_the_place_of_a_number_of_robots():
    sparse = replace(TYPE1, density_of_robots=0.1)
    n_robots = SCENARIO.set("density_of_robots", 0.1).n_robots
    assert n_robots == PageScenario(CONFIG, strategy=sparse).n_robots
    assert n_robots != SCENARIO.n_robots


def test_a_strategy_is_chosen_by_its_name():
    scenario = PageScenario(strategy=Beeclust()).set("strategy", "type2")
    assert scenario.strategy == PRESETS["type2"]


@pytest.mark.parametrize(
    "name", ["nothing", "config", "strategy_name", "optics.nothing", "optics", ""]
)
def test_a_name_of_no_setting_is_refused(name):
    with pytest.raises(UserError, match="have no setting"):
        SCENARIO.set(name, 1.0)


def test_a_swarm_that_fills_a_large_arena_is_within_the_range_of_its_control():
    """Density and size of the arena make more robots than the usual limit."""
    large = SwarmConfig(ArenaConfig(size=1000.0))
    dense = PageScenario(large, strategy=replace(TYPE1, density_of_robots=0.9))
    robots = by_name(dense)["robots"]
    assert robots.value == dense.n_robots > 200_000
    assert robots.low <= robots.value <= robots.high


def test_a_whole_number_in_place_of_a_float_may_become_any_float():
    scenario = PageScenario(SwarmConfig(optics=OpticsConfig(wall_range=2)))
    wall_range = by_name(scenario)["optics.wall_range"]
    assert isinstance(wall_range.value, float)
    assert wall_range.convert(2.5) == 2.5


def test_small_quantities_have_readable_units():
    """A value and its limits are those of the setting, which gets back exactly what it was."""
    shown = {name: in_page_units(control) for name, control in by_name(SCENARIO).items()}
    expected = {
        "energy.capacitance": ("capacitance [µF]", 0.001, 1.0, 1000.0),
        "energy.tool_capacitance": ("tool capacitance [pF]", 0.0, 10.0, 1e6),
        "energy.light_power": ("light power [mW]", 0.0, 0.48, 1000.0),
        "energy.message_energy": ("message energy [µJ]", 0.0, 80.0, 1000.0),
        "gripper.work_tool_object": ("work tool object [mJ/m²]", 0.0, 1.41, 10_000.0),
        "gripper.release_gap": ("release gap [µm]", 1.0, 5.0, 20.0),
    }
    for name, (label, low, value, high) in expected.items():
        control = shown[name]
        assert (control.label, control.low, control.value, control.high) == (
            label,
            low,
            value,
            high,
        )
    for name, control in by_name(SCENARIO).items():
        assert shown[name].of_setting(shown[name].value) == control.value
    assert shown["gripper.release_gap"].text.endswith("[µm].")
    assert shown["optics.wall_range"].unit == "rd"


def test_settings_of_others_keep_their_units():
    length = Control("length", "", 2.0, limits=Within(0.0, 5.0, "m"))
    assert in_page_units(length) == length
