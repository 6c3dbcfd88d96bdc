"""Worlds shared among processes: the results are those of one process, and none is left waiting for one that failed."""

import json
import os
import re
import socket
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from helpers_mjx import RECORDED, SEED, TINY, WORLDS, N

from iswarm_mj.commands.clean import Clean
from iswarm_mj.commands.main import main
from iswarm_mj.commands.swarm import GenomeOverrides
from iswarm_mj.config import ArenaConfig
from iswarm_mj.simulation.distributed import HEARTBEAT_S, Hosts, devices, join
from iswarm_mj.simulation.faults import decode
from iswarm_mj.simulation.state import Fault
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.errors import FaultKind, SimulationFault, UserError

SIZES = ("size", "dump_size", "dust_area_size", "dust_area_offset", "n_dust")
RUN = {"engine": "mjx", "worlds": WORLDS, "robots": N, "seed": SEED, "steps": 20}
FLAGS = [
    "clean",
    *(f"--{k}={v}" for k, v in RUN.items()),
    *("--record-worlds", *map(str, RECORDED)),
    *(f"--arena.{size.replace('_', '-')}={getattr(TINY.arena, size)}" for size in SIZES),
]
QUIET = {"JAX_PLATFORMS": "cpu", "TF_CPP_MIN_LOG_LEVEL": "3"}


def free_port():
    with socket.create_server(("", 0)) as server:
        return server.getsockname()[1]


def started(arguments, index=None, count=2, port=0):
    """One process of a job, or a process on its own."""
    env = os.environ | QUIET
    if index is not None:
        env |= {"JAX_COORDINATOR_ADDRESS": f"localhost:{port}", "JAX_NUM_PROCESSES": str(count)}
        env |= {"JAX_PROCESS_ID": str(index)}
    return subprocess.Popen(
        [sys.executable, *arguments], env=env, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )


def two(arguments):
    port = free_port()
    return [started(arguments, index, 2, port) for index in range(2)]


def ended(processes):
    """Exit code, output and errors of each, once all have ended."""
    said = [process.communicate(timeout=600) for process in processes]
    return [(process.returncode, *texts) for process, texts in zip(processes, said, strict=True)]


def test_two_processes_find_what_one_finds(tmp_path):
    """Not a bit differs, though each has a program for other numbers of worlds and of recorded ones."""
    one, both = tmp_path / "one", tmp_path / "both"
    processes = two(["-m", "iswarm_mj", *FLAGS, "--hosts", "--out", str(both)])
    main([*FLAGS, "--devices=1", "--out", str(one)])
    ran = ended(processes)
    assert [code for code, _, _ in ran] == [0, 0], ran
    assert "delivered" in ran[0][1] and ran[1][1:] == ("", "")  # process 0 alone says something
    results = [json.loads((out / "result.json").read_text()) for out in (one, both)]
    assert [r.pop("devices") for r in results] == [["cpu"], ["cpu", "cpu"]]
    for result in results:
        del result["wall_s"], result["seconds"]
    assert results[0] == results[1]
    assert len(set(zip(results[0]["picked"], results[0]["collisions"], strict=True))) == 3
    for place in (Path(), Path(f"world-{RECORDED[1]}")):
        frames = [np.load(out / place / "trajectory.npz") for out in (one, both)]
        assert frames[0]["pose"].shape == (21, N, 3)
        for name in frames[0].files:
            np.testing.assert_array_equal(frames[0][name], frames[1][name])


WAIT = """
import os, signal, sys
from iswarm_mj.utils.errors import SimulationFault
from iswarm_mj.simulation.distributed import join
hosts = join(300)
with hosts.together():
    hosts.gathered("first", 0)
    if hosts.index == 1:
        FAIL
    hosts.gathered("second", 0)
"""


def test_a_fault_of_one_process_ends_the_others():
    fault = "step 3, world 1: robot 7 left the arena"
    first, second = ended(two(["-c", WAIT.replace("FAIL", f"raise SimulationFault({fault!r})")]))
    assert first[0] == second[0] == 1
    assert first[2].endswith(f"SimulationFault: process 1 of 2 failed: {fault}\n")
    assert second[2].endswith(f"SimulationFault: {fault}\n")


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (KeyboardInterrupt(), "it was interrupted"),
        (UserError("--out was x."), "--out was x."),
        (SimulationFault("step 3"), "step 3"),
        (KeyError("a"), "KeyError('a')"),
    ],
)
def test_what_the_others_hear_of_an_error(error, said, monkeypatch):
    heard = []
    monkeypatch.setattr(Hosts, "_report", lambda _, reason: heard.append(reason))
    for count in (1, 2):
        with pytest.raises(type(error)), Hosts(0, count).together():
            raise error
    assert heard == [said]


@pytest.mark.slow
def test_a_process_that_is_killed_ends_the_others():
    """Within a minute or so, by JAX's heartbeat."""
    assert HEARTBEAT_S <= 60
    first, second = ended(two(["-c", WAIT.replace("FAIL", "os.kill(os.getpid(), signal.SIGKILL)")]))
    assert second[0] == -9 and first[0] == -6
    assert "another task died" in first[2]


def test_a_process_alone_gives_up(tmp_path):
    arguments = ["-m", "iswarm_mj", *FLAGS, "--hosts", "--hosts-timeout", "1", "--out", str(tmp_path)]
    for code, output, errors in ended([started(arguments, index, 2, free_port()) for index in range(2)]):
        assert (code, output) == (2, "")
        assert re.fullmatch(
            r"iswarm: cannot join the other processes .*answered within 1 s\); .*JAX_PROCESS_ID\n", errors
        )


SETTINGS = {"seed": 5, "arena": {"size": 12.0}, "record_worlds": [0], "versions": {"jax": "1"}}


@dataclass(frozen=True)
class Stand(Hosts):
    """Processes that hand in what is given here."""

    handed_in: tuple = ()

    def gathered(self, name, mine):
        return list(self.handed_in)


@pytest.mark.parametrize(
    ("other", "says"),
    [
        ({"seed": 6}, "seed 6 instead of 5,"),
        ({"arena": {"size": 13.0}}, r"arena\.size 13\.0 instead of 12\.0,"),
        ({"record_worlds": [1]}, r"record_worlds \[1\] instead of \[0\],"),
        ({"versions": {"jax": "2"}, "seed": 7}, r"seed 7 instead of 5, versions\.jax 2 instead of 1,"),
        ({name: i for i, name in enumerate("abcd")}, "a 0 instead of None, b .*, c 2 instead of None and 1 more,"),
    ],
)
def test_processes_of_different_runs_all_refuse_them(other, says):
    said = []
    for index in range(3):
        stand = Stand(index, 3, (SETTINGS, SETTINGS, SETTINGS | other))
        with pytest.raises(UserError, match=f"process 2 of 3 has {says} unlike process 0; start all") as refusal:
            stand.agree(stand.handed_in[index])
        said.append(str(refusal.value))
    assert len(set(said)) == 1


def test_processes_of_one_run_agree():
    Stand(0, 2, (SETTINGS, SETTINGS)).agree(SETTINGS)
    Hosts().agree(SETTINGS)


def test_what_decides_a_run():
    """A flag that changes the results is among it, one of a process alone is not; values count, not their spelling."""

    def deciding(**flags):
        command = Clean(**{"engine": "mjx", "hosts": True, **flags})
        _, genome, n_robots = command.checked()
        return json.loads(json.dumps(command._shared(genome, n_robots)))

    same = deciding()
    assert deciding(out=Path("elsewhere"), devices="1", hosts_timeout=9.0) == same
    assert deciding(robots=same["robots"]) == same
    for flags in (
        {"seed": 1},
        {"worlds": 2},
        {"robots": 7},
        {"density": 0.05},
        {"genome": "type2"},
        {"steps": 9},
        {"stop_at": 3},
        {"solver_iterations": 20},
        {"contact_capacity": 2.0},
        {"record_worlds": ()},
        {"record": False},
        {"override": GenomeOverrides(fraction_scouts=0.4)},
        {"arena": ArenaConfig(n_dust=10)},
    ):
        assert deciding(**flags) != same, flags
    assert same["versions"].keys() >= {"iswarm_mj", "jax", "mujoco"} and same["command"] == "clean"


@pytest.mark.slow
def test_two_processes_with_different_settings_end(tmp_path):
    port = free_port()
    arguments = ["-m", "iswarm_mj", *FLAGS, "--hosts", "--out", str(tmp_path / "out")]
    ran = ended([started([*arguments, f"--contact-capacity={1 + index}"], index, 2, port) for index in range(2)])
    for code, output, errors in ran:
        assert (code, output) == (2, "")
        assert errors.startswith("iswarm: process 1 of 2 has contact_capacity 2.0 instead of 1.0,")
    assert not list(tmp_path.iterdir())


def test_shares():
    hosts = [Hosts(index, 3) for index in range(3)]
    assert [h.share(7) for h in hosts] == [[0, 1, 2], [3, 4], [5, 6]]
    assert [h.share(7, (6, 2)) for h in hosts] == [[0, 2, 6], [1, 3], [4, 5]]
    assert Hosts().share(4, (0, 1, 2, 3)) == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("n_worlds", "recorded", "says"),
    [
        (2, (), r"worlds must be at least 3, one for each process.*\(got 2\)"),
        (4, (0, 1, 3), r"record_worlds must be at most 2 worlds, the share.*\(got \(0, 1, 3\)\)"),
    ],
)
def test_worlds_that_cannot_be_shared_are_refused(n_worlds, recorded, says):
    for index in range(3):
        with pytest.raises(UserError, match=says):
            Hosts(index, 3).share(n_worlds, recorded)


@pytest.mark.parametrize(
    ("address", "count", "index", "says"),
    [
        ("node1", "2", "0", r"JAX_COORDINATOR_ADDRESS must be host:port .*\(got node1\)"),
        ("node1:99999", "2", "0", r"JAX_COORDINATOR_ADDRESS must be host:port .*\(got node1:99999\)"),
        ("node1:4321", "two", "0", r"JAX_NUM_PROCESSES must be a whole number.*\(got two\)"),
        ("node1:²", "2", "0", r"JAX_COORDINATOR_ADDRESS must be host:port .*\(got node1:²\)"),
        ("node1:٤٣٢١", "2", "0", r"JAX_COORDINATOR_ADDRESS must be host:port .*\(got node1:٤٣٢١\)"),
        ("node1:4321", "²", "0", r"JAX_NUM_PROCESSES must be a whole number.*\(got ²\)"),
        ("node1:4321", "2", "²", r"JAX_PROCESS_ID must be a whole number.*\(got ²\)"),
        ("node1:4321", "2", "-1", r"JAX_PROCESS_ID must be a whole number.*\(got -1\)"),
    ],
)
def test_an_environment_that_makes_no_sense_is_refused(address, count, index, says, monkeypatch):
    monkeypatch.setenv("JAX_COORDINATOR_ADDRESS", address)
    monkeypatch.setenv("JAX_NUM_PROCESSES", count)
    monkeypatch.setenv("JAX_PROCESS_ID", index)
    with pytest.raises(UserError, match=says):
        join(1)


@pytest.mark.parametrize("count", ["²", "٣", "0", "-1", "1.0", "", "two", "1000"])
def test_devices_that_are_not_there_are_refused(count):
    with pytest.raises(UserError, match=r"^devices must be all, or between 1 and \d+, .*JAX sees \(cpu\) \(got "):
        devices(count)
    assert len(devices("1")) == 1 and devices("all")[:1] == devices("1")


def test_a_port_in_use_is_refused(monkeypatch):
    with socket.create_server(("", 0)) as server:
        monkeypatch.setenv("JAX_COORDINATOR_ADDRESS", f"localhost:{server.getsockname()[1]}")
        monkeypatch.setenv("JAX_PROCESS_ID", "0")
        with pytest.raises(UserError, match=r"cannot bind port \d+: Address already in use"):
            join(1)


def test_faults_name_worlds_by_their_numbers_in_the_run():
    """Not by those within the share of a process."""
    worlds = [World(PRESETS["type1"], N, SEED, index) for index in (4, 17)]
    fault = Fault(*np.array([[FaultKind.OUTSIDE, FaultKind.TOO_MANY_PAIRS], [9, 3], [7, 0]]))
    assert [(f.world, f.step) for f in decode(fault, worlds)] == [(4, 9), (17, 3)]
    assert str(decode(fault, worlds)[0]).startswith("step 9, world 4: robot 7 left the arena")
