"""A flag that would have no effect is refused in a sentence that names it and the reason."""

import re
from pathlib import Path

import pytest

import iswarm_mj
from iswarm_mj.commands.main import main, parse
from iswarm_mj.utils.errors import UserError

GLOW = f"{Path(__file__).parents[1]}/data/glow.py:Glow"
BEECLUST = f"{Path(iswarm_mj.__file__).parent}/tasks/aggregation.py:Beeclust"
WARP, CURVE = "--engine planar --impl warp", "--force-curve"


@pytest.mark.parametrize(
    ("arguments", "flag", "why"),
    [
        (f"clean {WARP} --threads 2", "--threads", "with --impl warp"),
        ("clean --no-record --record-worlds 0 1 --worlds 2", "--record-worlds", "with --no-record"),
        ("clean --robots 9 --density-of-robots 0.2", "--density-of-robots", "with --robots or --density"),
        ("clean --density 0.1 --density-of-robots 0.2", "--density-of-robots", "with --robots or --density"),
        ("clean --optics.slots 9", "--optics.slots", "without --optics.baud-rate"),
        ("clean --optics.serial-photodiodes", "--optics.serial-photodiodes", "without --optics.baud-rate"),
        ("clean --optics.capture-ratio 2", "--optics.capture-ratio", "without --optics.baud-rate"),
        ("clean --optics.photodiode-splay 20", "--optics.photodiode-splay", "with --optics.mode sector"),
        (
            "clean --optics.mode power --optics.photodiode-aperture 60",
            "--optics.photodiode-aperture",
            "with --optics.mode power",
        ),
        ("clean --engine mjx --threads 2", "--threads", "with --engine mjx"),
        ("evolve --refinement 3", "--refinement", "with --engine mujoco"),
        ("train --engine mujoco --refinement 3", "--refinement", "with --engine mujoco"),
        ("clean --engine planar --contact-capacity 2", "--contact-capacity", "with --engine planar"),
        ("bench --solver-iterations 20", "--solver-iterations", "with --engine mujoco"),
        ("clean --devices 1", "--devices", "but with --engine mjx, and planar"),
        ("clean --record-grasps 2", "--record-grasps", "without --gripper.resolution dynamic"),
        ("clean --no-record --gripper.resolution dynamic --record-grasps 2", "--record-grasps", "with --no-record"),
        ("bench --chunk 3", "--chunk", "with engines that take one step a call"),
        ("bench --engine planar --impl numba --chunk 3", "--chunk", "with engines that take one step a call"),
        ("bench --what grasp --impl jax", "--impl", "with --engine mujoco"),
        ("grasp --voltages 10 20", "--voltages", "without --force-curve"),
        ("grasp --impl warp", "--impl", "with --engine mujoco"),
        ("grasp --engine mjx --threads 2", "--threads", "with --engine mjx"),
        (f"grasp {CURVE} --repeats 2", "--repeats", "with --force-curve"),
        (f"grasp {CURVE} --record 1", "--record", "with --force-curve"),
        (f"grasp {CURVE} --engine mjx", "--engine", "with --force-curve"),
        (f"grasp {CURVE} --protocol.ramp-rate 50e3", "--protocol.ramp-rate", "with --force-curve"),
        (f"grasp {CURVE} --contacts.leak 1e9", "--contacts.leak", "with --force-curve"),
        (f"grasp {CURVE} --tool.roughness 1e-9", "--tool.roughness", "with --force-curve"),
        (f"grasp {CURVE} --plate.roughness 1e-9", "--plate.roughness", "with --force-curve"),
        ("run --no-record --record-worlds 0 1 --worlds 2", "--record-worlds", "with --no-record"),
        ("run --robots 9 --density-of-robots 0.2", "--density-of-robots", "with --robots or --density"),
        (f"run --task {GLOW} --arena.n-dust 9", "--arena.n-dust", "in the task Glow"),
        (f"run --task {GLOW} --gripper.relative-humidity 30", "--gripper.relative-humidity", "in the task Glow"),
        ("clean --strategy type2 --genome type2", "--genome", "with --strategy"),
        (f"clean --strategy {BEECLUST} --genome=evolved", "--genome", "with --strategy"),
        ("experiment --list --seed 1", "--seed", "with --list"),
        ("experiment types --genome type2", "--genome", "in the experiment types"),
        ("experiment hop-count --engine mjx --workers 2", "--workers", "with runs in batches"),
        ("evolve --method cmaes --operators.span 0.1", "--operators.span", "with --method cmaes"),
        ("evolve --method random --operators.elite 1", "--operators.elite", "with --method random"),
        ("infer --quick --combinations 99", "--combinations", "with --quick"),
        ("reproduce --tables --engine planar", "--engine", "with --tables"),
        ("reproduce --list --again", "--again", "with --list"),
        ("reproduce --quick --trials 3", "--trials", "with --quick"),
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


def test_one_humidity_for_force_curves(capfd):
    with pytest.raises(SystemExit):
        main(["grasp", "--force-curve", "--rh", "10", "50"])
    assert "--rh must be one relative humidity with --force-curve" in capfd.readouterr().err
