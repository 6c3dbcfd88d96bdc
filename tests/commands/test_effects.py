"""A flag that would have no effect is refused in a sentence that names it and the reason."""

import re
from pathlib import Path

import pytest

from iswarm_mj.commands.main import main, parse
from iswarm_mj.utils.errors import UserError

GLOW = f"{Path(__file__).parents[1]}/data/glow.py:Glow"
WARP, CURVE = "--engine planar --impl warp", "--force-curve"


@pytest.mark.parametrize(
    ("arguments", "flag", "why"),
    [
        (f"clean {WARP} --threads 2", "--threads", "with --impl warp"),
        ("clean --no-record --record-worlds 0 1 --worlds 2", "--record-worlds", "with --no-record"),
        ("clean --robots 9 --density-of-robots 0.2", "--density-of-robots", "with --robots or --density"),
        ("clean --optics.slots 9", "--optics.slots", "without --optics.baud-rate"),
        ("clean --optics.photodiode-splay 20", "--optics.photodiode-splay", "with --optics.mode sector"),
        ("evolve --refinement 3", "--refinement", "with --engine mujoco"),
        ("clean --engine planar --contact-capacity 2", "--contact-capacity", "with --engine planar"),
        ("clean --record-grasps 2", "--record-grasps", "without --gripper.resolution dynamic"),
        ("clean --no-record --gripper.resolution dynamic --record-grasps 2", "--record-grasps", "with --no-record"),
        ("bench --engine planar --impl numba --devices 1", "--devices", "with --impl numba"),
        ("bench --chunk 3", "--chunk", "with --engine mujoco"),
        ("grasp --voltages 10 20", "--voltages", "without --force-curve"),
        (f"grasp {CURVE} --repeats 2", "--repeats", "with --force-curve"),
        (f"grasp {CURVE} --protocol.ramp-rate 50e3", "--protocol.ramp-rate", "with --force-curve"),
        (f"run --task {GLOW} --arena.n-dust 9", "--arena.n-dust", "in the task Glow"),
        ("clean --strategy type2 --genome type2", "--genome", "with --strategy"),
        ("experiment --list --seed 1", "--seed", "with --list"),
        ("experiment types --genome type2", "--genome", "in the experiment types"),
        ("experiment hop-count --engine mjx --workers 2", "--workers", "with runs in batches"),
        ("evolve --method cmaes --operators.span 0.1", "--operators.span", "with --method cmaes"),
        ("reproduce --tables --engine planar", "--engine", "with --tables"),
        ("reproduce --list --again", "--again", "with --list"),
    ],
)
def test_is_refused(arguments, flag, why, capfd, tmp_path):
    with pytest.raises(SystemExit) as end:
        main(arguments.split())
    error = capfd.readouterr().err
    assert end.value.code == 2 and list(tmp_path.iterdir()) == []
    assert re.match(rf"iswarm: {flag} has no effect {re.escape(why)}\b.*; leave it out\n", error), error


def test_what_a_small_arena_needs_has_an_effect():
    """Dust areas lie within the walls, in tasks without dust, too."""
    arena = "--arena.size 15 --arena.dump-size 3 --arena.dust-area-size 3 --arena.dust-area-offset 5"
    command = parse(f"run --task {GLOW} --robots 4 {arena}".split())
    assert command.checked()[0].arena.dust_area_offset == 5
    assert parse(f"run --task {GLOW} --reading initial".split()).checked()[0].arena.dust_area_offset == 16
    with pytest.raises(UserError, match=r"`arena.n_dust` has no effect in the task Glow"):
        parse(f"run --task {GLOW} --robots 4 {arena} --arena.n-dust 9".split()).checked()
