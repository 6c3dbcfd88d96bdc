"""Files that the command lines on the page of refusals name: most have one mistake each."""

import json
from pathlib import Path

from iswarm_mj.engines.robot_file import models_directory
from support.recorded import write_run
from support.robots import around, robot_xml
from support.small import FLAGS

DATA = Path(__file__).parents[1] / "data"
WALK = (DATA / "walk.py").read_text()

SMALL = "\n".join(
    [
        'engine = "planar"',
        'impl = "numba"',
        "threads = 1",
        "[arena]",
        *(flag.removeprefix("--arena.") for flag in FLAGS),
    ]
)
"""Settings of the small arena, as TOML."""

MISTAKES = {
    "other_class": ("@dataclass\n", "class Base:\n    pass\n\n\n@dataclass\n"),
    "no_colon": ("def picks(self, memory):", "def picks(self, memory)"),
    "fails_at_once": (
        "@dataclass\nclass Walk(Strategy):",
        "class Walk(Strategy):\n    def __init__(self):\n        self.speed = 1 / 0\n",
    ),
    "field_steps": ("    turn: ", "    steps: int = 3\n    turn: "),
    "asks_an_array": (
        "        count = jnp.maximum",
        "        if seen.at_dust.any():\n            turn = 0\n        count = jnp.maximum",
    ),
    "uses_numpy": (
        "        count = jnp.maximum",
        "        import numpy\n\n        turn = numpy.sin(turn)\n        count = jnp.maximum",
    ),
    "turns_two_robots": ("Command(turn, ", "Command(turn[:2], "),
    "memory_of_other_type": ('"turned": turned}', '"turned": count}'),
    "picks_numbers": ('return memory["turned"] < jnp.inf', 'return memory["count"]'),
    "records_what_is_not_there": ('"turned": "rad"', '"turn": "rad"'),
    "memory_of_three_robots": ("jnp.zeros(n_robots)", "jnp.zeros(3)"),
    "records_pose": ('"turned"', '"pose"'),
    "records_file": ('"turned"', '"file"'),
    "says_too_much": ("Integer(bits=4)", "Integer(bits=21)"),
    "says_led": ('"count": Integer', '"led": Integer'),
    "says_too_little": ("for name in self.payload}", 'for name in ("heat", "aim")}'),
    "says_whole_numbers": ("{name: memory[name] ", '{name: memory["count"] '),
    "misspelt_payload": ("    payload: ", "    payloads: "),
    "not_derived": ("class Walk(Strategy):", "class Walk:"),
}
"""What replaces a part of walk.py, by the names of the files."""

TOML = {
    "small": SMALL,
    "broken": "steps = ",
    "wings": "wings = 2",
    "misspelt": "[arena]\nsise = 3\nwings = 1",
    "digits": f"steps = 0x{'f' * 4000}",
    "deep": f"{'.'.join('a' * 2000)} = 1",
    "twice": "[arena]\nn-dust = 5\nn_dust = 7",
    "flag_as_value": 'record_worlds = ["--seed=3"]',
    "no_value": "optics.baud-rate = []",
    "many_keys": "\n".join(f"key{number} = 1" for number in range(20_000)),
    "with_task": 'task = "aggregation"',
    "with_steps": "steps = 3",
}
"""Files of --config."""

RESULTS = {
    "no_result": {},
    "odd_result": {"settings": {}, "config": 5},
    "no_strategy": {"settings": {}, "config": {}, "strategy": None},
    "walked": {"settings": {}, "config": {}, "strategy": {"class": "Walk", "turn": 40.0}},
    "grasped": {"grasp": {"ball_material": "silica"}},
    "aggregated": {
        "settings": {"seed": 3},
        "config": {},
        "task": {
            "class": "Aggregation",
            "spot_radius": 8.0,
            "spot_offset": 14.0,
            "dim": 0.25,
            "error_light": 0.05,
        },
    },
    "odd_genome": {"p_vector_forget": 3},
    "wrong_genome": {"p_vector_forgets": 0.3},
}
"""Files of JSON."""


def write_files(directory):
    """Write all files into a directory."""
    for name, content in TOML.items():
        (directory / f"{name}.toml").write_text(content)
    for name, content in RESULTS.items():
        (directory / f"{name}.json").write_text(json.dumps(content))
    for name in ("walk.py", "glow.py", "teleport.py"):
        (directory / name).write_text((DATA / name).read_text())
    for name, (old, new) in MISTAKES.items():
        assert old in WALK, name
        (directory / f"{name}.py").write_text(WALK.replace(old, new))

    # Robots: two kinds of the same build, one with six sides, one of 12 x 12 mm, and no robot.
    four_sides = (models_directory() / "robot.xml").read_text()
    (directory / "a.xml").write_text(four_sides)
    (directory / "b.xml").write_text(four_sides)
    (directory / "six_sides.xml").write_text((models_directory() / "robot6.xml").read_text())
    large = robot_xml((6, 6), around((6, 6), (0, 90, 180, 270)))
    (directory / "large.xml").write_text(large)
    (directory / "empty.xml").write_text("<mujoco><worldbody/></mujoco>")

    (directory / "file").touch()
    (directory / "empty").mkdir()
    recorded = directory / "runs" / "clean"
    recorded.mkdir(parents=True)
    write_run(recorded)
