"""Starts: robots beyond walls, in obstacles or in each other are refused by number."""

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
"""Poses of three robots that stand free: x, y [mm] and yaw [deg]."""
ROBOT = read_robot()
LONG_ROBOT = replace(ROBOT, half_edges=(1.2, 0.8, 0.4))

WITH_OBSTACLES = replace(
    SMALL,
    arena=replace(
        SMALL.arena,
        obstacles=((5.0, 5.0, 1.0, 0.5, 45.0),),
        boxes=((5.0, -5.0, 1.0, 0.5, 45.0, 1e-5, 0.1),),
    ),
)
"""An arena with an obstacle of 5.7 x 2.8 mm at 45 degrees, 14.1 mm east and north of the middle.

To the south of the middle is a box of the same size that can be pushed."""


@dataclass(frozen=True)
class Placed(Cleaning):
    """Cleaning whose four robots begin at `FREE` and at one more place."""

    last: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def lay_out(self, config, n_robots, rng, shared, cell):
        _, balls = super().lay_out(config, n_robots, rng, shared, cell)
        return place(*FREE, self.last), balls


IN_OBSTACLE = r"no robot stands in an obstacle or a box \(got 'robot 3 at "
REFUSED = {
    "beyond the walls": (
        SMALL,
        (EDGE - 0.9, 3, 0),
        r"robots stand within the walls, 21\.2\d* mm .*robot 3 at \[20\.3",
    ),
    "far away": (
        SMALL,
        (1000, 0, 0),
        r"robots stand within the walls.*robot 3 at \[1000\.0, 0\.0\] mm",
    ),
    "with a corner beyond": (
        SMALL,
        (3, 1.3 - EDGE, 45),
        r"robots stand within the walls.*robot 3 at \[3\.0, -19\.9",
    ),
    "in an obstacle": (WITH_OBSTACLES, (15.5, 15.5, 0), rf"{IN_OBSTACLE}\[15\.5, 15\.5\]"),
    "at an obstacle's corner": (WITH_OBSTACLES, (12, 11, 0), rf"{IN_OBSTACLE}\[12\.0, 11"),
    "in a box": (WITH_OBSTACLES, (16, -12.5, 0), rf"{IN_OBSTACLE}\[16\.0, -12\.5"),
    "at one place": (
        SMALL,
        (0, 9, 80),
        r"no robots overlap \(got 'robots 1 at \[0\.0, 9\.0\] and 3 at \[0\.0, 9\.0\]",
    ),
    "corner in corner": (
        SMALL,
        (11.7, 0, 45),
        r"no robots overlap .*robots 2 at \[9\.0, 0\.0\] and 3 at \[11",
    ),
}
"""Arena, pose of robot 3, and what the message says."""


@pytest.mark.parametrize(("config", "last", "says"), REFUSED.values(), ids=REFUSED)
class TestRefusedStarts:
    @pytest.fixture
    def scenario(self, config):
        """Four robots in an arena."""
        return Scenario(config, robots=4, engine=PlanarSettings(1), steps=3)

    def test_of_users(self, scenario, config, last, says):
        start = start_of(config, 4, 0, 0)._replace(poses=place(*FREE, last))
        world = World(PRESETS["type1"], 4, start=start)
        says = f"^start.poses must be such that {says}[^\n]*$"
        with pytest.raises(ConfigError, match=says):
            Run(replace(scenario, worlds=[world]))

    def test_of_tasks(self, scenario, config, last, says):
        scenario = replace(scenario, task=Placed(last))
        says = f"^poses of Placed.lay_out must be such that {says}[^\n]*$"
        with pytest.raises(ConfigError, match=says):
            Run(scenario)
        with pytest.raises(ConfigError, match=says):
            make_env(scenario, n_starts=1)


@pytest.mark.parametrize(
    ("robot", "last"),
    [
        pytest.param(ROBOT, (EDGE - 1, 0, 0), id="at the wall"),
        pytest.param(ROBOT, (2, 9, 20), id="beside a robot whose circle it enters"),
        pytest.param(ROBOT, (11.83, 0, 45), id="corner at corner"),
        pytest.param(LONG_ROBOT, (-8, -6.4, 0), id="long side at long side"),
        pytest.param(LONG_ROBOT, (-5.6, -8, 0), id="short side at short side"),
        pytest.param(LONG_ROBOT, (EDGE - 0.8, -9, 90), id="long side at the wall"),
        pytest.param(ROBOT, (11, 11, 45), id="beside a box whose circle it enters"),
    ],
)
def test_robots_may_touch(robot, last):
    poses = place(FREE[0], (0, 6.9, 20), FREE[2], last)
    check_poses("poses", poses, robot, WITH_OBSTACLES.arena)


@pytest.mark.parametrize(
    "last", [(-8, -6.5, 0), (-5.7, -8, 0), (EDGE - 0.7, -9, 90), (EDGE - 1.1, -9, 0)]
)
def test_hulls_count_as_long_as_they_are(last):
    """Long robots overlap where small ones stand free."""
    poses = place(*FREE, last)
    small_robot = replace(LONG_ROBOT, half_edges=(0.7, 0.7, 0.4))
    check_poses("poses", poses, small_robot, SMALL.arena)
    with pytest.raises(ConfigError, match=r"robot.* 3 at "):
        check_poses("poses", poses, LONG_ROBOT, SMALL.arena)


@pytest.mark.parametrize("seed", range(20))
def test_robots_on_all_cells_are_allowed(seed):
    """Their corners just meet at 45 degrees."""
    n_robots = 96
    arena = ArenaConfig(size=10.7, dump_size=2.2, dust_area_size=2, dust_area_offset=4, n_dust=4)
    poses = start_of(replace(SMALL, arena=arena), n_robots, seed, 0).poses.copy()
    poses[:, 2] = np.pi / 4
    check_poses("poses", poses, ROBOT, arena)
