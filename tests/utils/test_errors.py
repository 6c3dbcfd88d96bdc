"""Messages of the errors, their fields, and that both survive a pickle (workers send them)."""

import pickle

import pytest

from iswarm_mj.utils.errors import ConfigError, FaultKind, SimulationFault, UserError


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("arena.size", 7, "between 10 and 150 rd"),
            "arena.size must be between 10 and 150 rd (got 7)",
        ),
        (("engine", "xyz", "mujoco or mjx"), "engine must be mujoco or mjx (got 'xyz')"),
        (("worlds", 0, "at least 1", "use one"), "worlds must be at least 1 (got 0); use one"),
    ],
)
def test_a_setting_that_is_not_allowed(arguments, message):
    error = ConfigError(*arguments)
    assert isinstance(error, UserError)
    assert str(error) == message
    assert (error.field, error.value, error.constraint) == arguments[:3]

    copy = pickle.loads(pickle.dumps(error))
    assert str(copy) == message
    assert copy.field == error.field


SUBSTEPS = "increase `drive.walk_substeps` and `drive.turn_substeps`, or use fewer robots"
TEN_AND_TWO = "robots 0, 1, 2, 3, 4, 5, 6, 7, 8, 9 and 2 more"


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"step": 12, "world": 3, "robots": [5], "kind": FaultKind.OUTSIDE},
            f"step 12, world 3: robot 5 left the arena; {SUBSTEPS}",
        ),
        (
            {
                "step": 1,
                "kind": FaultKind.TOO_MANY_PAIRS | FaultKind.TOO_MANY_CONTACTS,
                "detail": "2 worlds more",
            },
            "step 1: buffer of robot pairs full and contact buffer full; "
            "use fewer robots, or with mjx increase `contact_capacity`; 2 worlds more",
        ),
        (
            {
                "world": 2,
                "robots": range(12),
                "kind": FaultKind.POSE_NOT_FINITE | FaultKind.OUTSIDE,
            },
            f"world 2: the pose of {TEN_AND_TWO} is not finite "
            f"and {TEN_AND_TWO} left the arena; {SUBSTEPS}",
        ),
        ({"detail": "a worker died"}, "a worker died"),
    ],
)
def test_a_world_that_cannot_go_on(fields, message):
    fault = SimulationFault(**fields)
    assert str(fault) == message

    copy = pickle.loads(pickle.dumps(fault))
    assert vars(copy) == vars(fault)
    assert str(copy) == message
