"""What the command line refuses: exit code 2, one sentence that names the flag and the remedy,
nothing written."""

import importlib.util
import io
import sys
from pathlib import Path

import pytest
from support.cli import code_of, refused
from support.small import FLAGS

from iswarm_mj.commands.command_settings import ineffective_settings, settings
from iswarm_mj.commands.flags import in_flags
from iswarm_mj.commands.main import parse
from iswarm_mj.utils.errors import ConfigError, FaultKind, SimulationFault, UserError

SMALL = " ".join(FLAGS)
GLOW = f"{Path(__file__).parents[1]}/data/glow.py:Glow"
OWN, WARP, CURVE = (
    "run --strategy beeclust --task aggregation",
    "--engine planar --impl warp",
    "grasp --force-curve",
)
REFUSED = [
    ("clean --stepz 10", ["--stepz", "--steps"]),
    ("clean --no-recrod", ["--no-recrod", "--record"]),
    ("clean --robotz 5", ["perhaps you meant --robots"]),
    ("clean --robts 5", ["perhaps you meant --robots"]),
    ("clean extra", ["extra"]),
    (f"{OWN} --robotss 3", ["--robotss", "--robots"]),
    ("clean --seed -1", ["--seed", "(got -1)"]),
    ("clean --arena.size 12 8", ["8"]),
    ("experiment hopcount", ["perhaps you meant hop-count"]),
    ("report --strategy neural --task x", ["--strategy"]),
    ("clean --steps abc", ["--steps", "abc"]),
    (
        "clean --gripper.resolution lunch",
        ["--gripper.resolution", "lunch", "quasi-static", "dynamic"],
    ),
    ("clean --out=", ["--out", "name of a file"]),
    ("clean --config --steps 3", ["--config has no value", "TOML"]),
    ("clean --strategy --steps 3", ["--strategy has no value", "FILE.py:CLASS"]),
    ("clean --engine=", ["--engine must be FILE.py:CLASS", "(got '')"]),
    ("clean --robots 5 --robots 7", ["--robots is given twice"]),
    ("clean --record --no-record", ["--record is given twice"]),
    ("clean --arena.n_dust 5 --arena.n-dust 7", ["is given twice"]),
    ("claen", ["perhaps you meant clean", "Commands: clean, run, "]),
    ("", ["no command was given. Commands: clean, "]),
    (
        f"clean {SMALL} --robots 217",
        ["--robots must be between 1 and 216", "(got 217); use fewer", "--arena.size"],
    ),
    (f"clean {SMALL} --density 0", ["--density must be above 0 and at most 1 (got 0.0)"]),
    (f"clean {SMALL} --density 0.1 --robots 10", ["--robots and --density exclude each other"]),
    (
        f"clean {SMALL} --stop-at 100",
        ["--stop-at must be between 1 and the number of balls, 24", "(got 100)"],
    ),
    ("clean --genome type3", ["--genome must be a preset (type1, type2, evolved)", "got 'type3'"]),
    ("clean --robot 5", ["perhaps you meant --robots 5"]),
    ("bench --engine planar --impl jax", ["'jax' for argument '--impl'"]),
    (
        "clean --out file/far/below",
        ["--out must be a writable directory (got file/far/below); choose another ("],
    ),
    (
        "grasp --radius 15e-6:25e-6",
        ["--radius must be radii from 10e-6 to 50e-6 m", "(got '15e-6:25e-6')"],
    ),
    ("grasp --no-contact-gap 1", ["--no-contact-gap must be ", "(got 1.0)"]),
    ("grasp --record 75", ["--record must be the index of a trial, 0 to 74", "(got 75)"]),
    (f"{CURVE} --rh 10 50", ["--rh must be one relative humidity with --force-curve"]),
    (f"{CURVE} --voltages", ["--voltages must be such that there are 1 to 100 curves"]),
    (
        "grasp --protocol.step-voltage 100",
        ["--protocol.step-voltage must be below --protocol.grasp-limit, 80 "],
    ),
    (
        "grasp --radius 10e-6 25e-6 --gap 45e-6",
        ["--gap must be at most 4 times the least radius (got 4.5e-05)"],
    ),
    ("report --out r.pdf", ["--out must be a name ending in .html"]),
    ("report --results", ["--results must be at least one directory"]),
    ("report --results nowhere", ["--results must be an existing directory"]),
    ("reproduce --only densty", ["--only must be grasp or hop-count or density or"]),
    ("reproduce --replicates 0", ["--replicates must be"]),
    (
        "reproduce --results file",
        ["--results must be a writable directory (got file); choose another ("],
    ),
    (
        "evolve --engine mjx --backend ray",
        ["--backend must be processes with --engine mjx and --impl jax (got 'ray')"],
    ),
    (
        "evolve --generations 0",
        ["--generations must be a whole number between 1 and 100000 (got 0)"],
    ),
    ("evolve --population 2", ["--operators.elite must be below --population (got 2)"]),
    ("clean --tyro-print-completion x", ["bash, zsh"]),
]
IDLE = [
    (f"clean {WARP} --threads 2", "--threads", "with --impl warp"),
    ("clean --no-record --record-worlds 0 1 --worlds 2", "--record-worlds", "with --no-record"),
    (
        "clean --robots 9 --density-of-robots 0.2",
        "--density-of-robots",
        "with --robots or --density",
    ),
    ("clean --optics.slots 9", "--optics.slots", "without --optics.baud-rate"),
    (
        "clean --optics.photodiode-splay 20",
        "--optics.photodiode-splay",
        "with --optics.mode sector",
    ),
    ("evolve --refinement 3", "--refinement", "with --engine mujoco"),
    ("clean --record-grasps 2", "--record-grasps", "without --gripper.resolution dynamic"),
    ("bench --engine planar --impl numba --devices 1", "--devices", "with --impl numba"),
    ("bench --chunk 3", "--chunk", "with --engine mujoco"),
    ("grasp --voltages 10 20", "--voltages", "without --force-curve"),
    (f"{CURVE} --protocol.ramp-rate 50e3", "--protocol.ramp-rate", "with --force-curve"),
    (f"run --task {GLOW} --arena.n-dust 9", "--arena.n-dust", "in the task Glow"),
    ("clean --strategy type2 --genome type2", "--genome", "with --strategy"),
    ("experiment --list --seed 1", "--seed", "with --list"),
    ("experiment types --genome type2", "--genome", "in the experiment types"),
    ("experiment hop-count --engine mjx --workers 2", "--workers", "with runs in batches"),
    ("evolve --method cmaes --operators.span 0.1", "--operators.span", "with --method cmaes"),
    (
        "experiment time-step --drive.walk-substeps 12",
        "--drive.walk-substeps",
        "in the experiment time-step",
    ),
    (
        "experiment infer --strategy.random-turn 60",
        "--strategy.random-turn",
        "in the experiment infer",
    ),
    ("experiment resolved-grasps --genome type2", "--genome", "in the experiment resolved-grasps"),
    ("experiment hop-count --optics.slots 9", "--optics.slots", "without --optics.baud-rate"),
    ("clean --energy.capacitance 0.001", "--energy.capacitance", "with --energy.model none"),
    ("clean --gripper.bench c", "--gripper.bench", "with --gripper.resolution quasi-static"),
    ("sweep --over seed=1,2 --optics.slots 9", "--optics.slots", "without --optics.baud-rate"),
    (
        "sweep --over seed=1,2 --worlds 2 --record-worlds 1",
        "--record-worlds",
        "on the runs of a sweep",
    ),
    ("reproduce --tables --engine planar", "--engine", "with --tables"),
    ("reproduce --tables --quick", "--quick", "with --tables"),
    ("reproduce --tables --out x", "--out", "with --tables"),
    ("reproduce --list --again", "--again", "with --list"),
]


@pytest.mark.parametrize(
    ("line", "facts"),
    [
        *REFUSED,
        *(
            (line, [f"iswarm: {flag} has no effect {why}", "; leave it out"])
            for line, flag, why in IDLE
        ),
    ],
)
def test_is_refused(line, facts, capfd, here):
    (here / "file").touch()
    error = refused(capfd, here, *line.split())
    assert "Traceback" not in error and [fact for fact in facts if fact not in error] == []


@pytest.mark.parametrize(
    "line",
    [
        "message-time --optics.slots 16",
        "resolved-grasps --gripper.bench c",
        "types --strategy.random-turn 60",
    ],
)
def test_what_some_runs_of_an_experiment_need_has_an_effect(line):
    command = parse(["experiment", *line.split()])
    assert not ineffective_settings(command) and command.configs


def test_what_a_small_arena_needs_has_an_effect():
    """Dust areas lie within the walls, in tasks without dust, too."""
    assert parse(
        f"run --task {GLOW} --robots 4 {SMALL}".replace("--arena.n-dust=24", "").split()
    ).number_of_robots()
    assert parse(f"run --task {GLOW} --reading initial".split()).config.arena.dust_area_offset == 16
    with pytest.raises(UserError, match=r"`arena.n_dust` has no effect in the task Glow"):
        parse(f"run --task {GLOW} --robots 4 {SMALL}".split()).number_of_robots()


def test_warp_that_is_not_installed(capfd, here, monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "warp" else found(name, *a)
    )
    error = refused(capfd, here, "clean", *FLAGS, "--robots=30", *WARP.split())
    assert (
        error
        == "iswarm: --impl warp needs the package warp-lang; run pip install 'iswarm-mj[warp]'.\n"
    )


@pytest.mark.parametrize(
    "line",
    [
        ["replay", "--title", "a\udcff"],
        ["sweep", "clean", "--over", "seed=1,2", "--out", "a\udcff"],
        ["\udc80"],
    ],
)
def test_arguments_that_are_no_text(capfd, here, line):
    assert "must be text in UTF-8 (got" in refused(capfd, here, *line)


@pytest.mark.parametrize("line", [["clean", "--config"], ["clean", "--steps"], ["clean"], []])
@pytest.mark.parametrize("word", ["x" * 5000, "\x1b[31mred", "\x1b[31m" * 2000])
def test_what_is_echoed_is_short_and_controls_no_terminal(line, word, capfd):
    assert code_of(*line, word) == 2
    error = capfd.readouterr().err
    assert "\x1b" not in error and len(error) < 3000
    assert "--config" not in line or error.endswith("or a result.json.\n")


def test_one_sentence_where_the_output_is_not_utf_8(monkeypatch):
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), "latin-1"))
    with pytest.raises(
        UserError, match=r"^--steps: [^-]*; `iswarm clean --help-all` explains the flags$"
    ):
        parse(["clean", "--steps", "x"])


@pytest.mark.parametrize(
    "error, text",
    [
        (ConfigError("arena.dump_size", 7, "small"), "--arena.dump-size must be small (got 7)"),
        (
            ConfigError("n_robots", 0, "at least `n_worlds`"),
            "--robots must be at least --worlds (got 0)",
        ),
        (
            ConfigError("worlds", 2, "1", "use `jax.pmap`"),
            "--worlds must be 1 (got 2); use `jax.pmap`",
        ),
        (ConfigError("strategy", "x", "known"), "--strategy must be known (got 'x')"),
        (
            SimulationFault(kind=FaultKind.TOO_MANY_CONTACTS),
            "contact buffer full; use fewer robots, or with mjx increase --contact-capacity",
        ),
    ],
)
def test_settings_in_messages_are_flags(error, text):
    assert (
        in_flags(error, [name for name, *_ in settings(parse(["clean", "--engine", "mjx"]))])
        == text
    )
