"""Starts that cannot be are refused in a sentence that names the robots."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from support.sensing import place
from support.small import SMALL
from support.worlds import start_of

from iswarm_mj import make_env
from iswarm_mj.config.swarm import ArenaConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.layout_checks import check_poses
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.cleaning import Cleaning
from iswarm_mj.utils.errors import ConfigError

EDGE = 21.213
"""Distance of the walls of the small arena from its middle [mm]; robots are 2 mm wide."""
FREE = [(-8, -8, 0), (0, 9, 20), (9, 0, 45)]
LONG = replace(read_robot(), half_edges=(1.2, 0.8, 0.4))
STANDING = {"obstacles": ((5.0, 5.0, 1.0, 0.5, 45.0),), "boxes": ((5.0, -5.0, 1.0, 0.5, 45.0, 1e-5, 0.1),)}
OBSTACLE = replace(SMALL, arena=replace(SMALL.arena, **STANDING))
"""A box of 5.7 x 2.8 mm at 45 degrees, 14.1 mm east and north of the middle; one that can be pushed to the south."""


@dataclass(frozen=True)
class Placed(Cleaning):
    """Cleaning whose robots begin where they are told; of three and this one."""

    last: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def lay_out(self, config, n_robots, rng, shared, cell):
        return place(*FREE, self.last), super().lay_out(config, n_robots, rng, shared, cell)[1]


REFUSED = {
    "beyond the walls": (SMALL, (EDGE - 0.9, 3, 0), r"robots stand within the walls, 21\.2\d* mm .*robot 3 at \[20\.3"),
    "far away": (SMALL, (1000, 0, 0), r"robots stand within the walls.*robot 3 at \[1000\.0, 0\.0\] mm"),
    "with a corner beyond": (SMALL, (3, 1.3 - EDGE, 45), r"robots stand within the walls.*robot 3 at \[3\.0, -19\.9"),
    "in an obstacle": (
        OBSTACLE,
        (15.5, 15.5, 0),
        r"no robot stands in an obstacle or a box \(got 'robot 3 at \[15\.5, 15\.5\]",
    ),
    "at an obstacle's corner": (
        OBSTACLE,
        (12, 11, 0),
        r"no robot stands in an obstacle or a box \(got 'robot 3 at \[12\.0, 11",
    ),
    "in a box": (
        OBSTACLE,
        (16, -12.5, 0),
        r"no robot stands in an obstacle or a box \(got 'robot 3 at \[16\.0, -12\.5",
    ),
    "at one place": (SMALL, (0, 9, 80), r"no robots overlap \(got 'robots 1 at \[0\.0, 9\.0\] and 3 at \[0\.0, 9\.0\]"),
    "corner in corner": (SMALL, (11.7, 0, 45), r"no robots overlap .*robots 2 at \[9\.0, 0\.0\] and 3 at \[11"),
}


@pytest.mark.parametrize(("config", "last", "words"), REFUSED.values(), ids=REFUSED)
def test_is_refused_of_users_and_of_tasks(config, last, words):
    start = start_of(config, 4, 0, 0)._replace(poses=place(*FREE, last))
    scenario = Scenario(config, robots=4, engine=PlanarSettings(1), steps=3)
    with pytest.raises(ConfigError, match=f"^start.poses must be such that {words}[^\n]*$"):
        Run(replace(scenario, worlds=[World(PRESETS["type1"], 4, start=start)]))
    with pytest.raises(ConfigError, match=f"^poses of Placed.lay_out must be such that {words}[^\n]*$"):
        Run(replace(scenario, task=Placed(last)))
    with pytest.raises(ConfigError, match=f"^poses of Placed.lay_out must be such that {words}[^\n]*$"):
        make_env(replace(scenario, task=Placed(last)), n_starts=1)


@pytest.mark.parametrize(
    ("robot", "last"),
    [
        (read_robot(), (EDGE - 1, 0, 0)),  # at the wall
        (read_robot(), (2, 9, 20)),  # at an angle, beside a robot whose circle it enters
        (read_robot(), (11.83, 0, 45)),  # corner at corner
        (LONG, (-8, -6.4, 0)),
        (LONG, (-5.6, -8, 0)),
        (LONG, (EDGE - 0.8, -9, 90)),
        (read_robot(), (11, 11, 45)),  # beside a box of which it would be within the circle
    ],
)
def test_robots_may_touch(robot, last):
    check_poses("poses", place(*FREE[:1], (0, 6.9, 20), FREE[2], last), robot, OBSTACLE.arena)


@pytest.mark.parametrize("last", [(-8, -6.5, 0), (-5.7, -8, 0), (EDGE - 0.7, -9, 90), (EDGE - 1.1, -9, 0)])
def test_hulls_count_as_long_as_they_are(last):
    check_poses("poses", place(*FREE, last), replace(LONG, half_edges=(0.7, 0.7, 0.4)), SMALL.arena)
    with pytest.raises(ConfigError, match=r"robot.* 3 at "):
        check_poses("poses", place(*FREE, last), LONG, SMALL.arena)


def test_all_layouts_of_the_package_are_allowed():
    """Robots on all cells, whose corners just meet."""
    arena = ArenaConfig(size=10.7, dump_size=2.2, dust_area_size=2, dust_area_offset=4)
    n = 96
    for seed in range(20):
        poses = start_of(replace(SMALL, arena=replace(arena, n_dust=4)), n, seed, 0).poses
        check_poses("poses", np.column_stack([poses[:, :2], np.full(n, np.pi / 4)]), read_robot(), arena)
