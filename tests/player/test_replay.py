"""A replay is one HTML file with a recorded run in it."""

import base64
import re
from dataclasses import replace

import msgspec
import numpy as np
import pytest
import zstandard
from support.cli import code_of
from support.page import SCENARIO

from iswarm_mj.output.loading import load, scene_of
from iswarm_mj.player import replay
from iswarm_mj.player.film import Film
from iswarm_mj.player.replay import swarm_film, write_replay
from iswarm_mj.simulation.run import Run
from iswarm_mj.utils.errors import UserError
from iswarm_mj.workflows.clean import run_swarm

N_ROBOTS = 20
LENGTH_BYTES = 8
"""Size of a length in the data of a replay [bytes]; buffers begin at its multiples, too."""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A recorded run of 12 control steps."""
    out = tmp_path_factory.mktemp("run")
    run_swarm(Run(replace(SCENARIO, steps=12)), out)
    return load(out)


def unpack(text):
    """Return what viser embeds in the HTML of a replay: its description, and its buffers.

    A length is followed by compressed data: the length of the description, the description as
    MessagePack, and the buffers at the end.
    """
    embedded = re.search(r'__VISER_EMBED_DATA__="([^"]+)"', text)[1]
    packed = base64.b64decode(embedded)
    size = int.from_bytes(packed[:LENGTH_BYTES], "little")
    data = zstandard.ZstdDecompressor().decompress(packed[LENGTH_BYTES:], max_output_size=size)

    size = int.from_bytes(data[:LENGTH_BYTES], "little")
    description = msgspec.msgpack.decode(data[LENGTH_BYTES : LENGTH_BYTES + size])

    lengths = description["binaryBufferLengths"]
    padded_lengths = [-(-length // LENGTH_BYTES) * LENGTH_BYTES for length in lengths]
    start = len(data) - sum(padded_lengths)
    buffers = []
    for length, padded_length in zip(lengths, padded_lengths, strict=True):
        buffers.append(data[start : start + length])
        start += padded_length
    return description, buffers


def vectors_of_robots(buffers):
    """Return the buffers that may have a place of each robot, as arrays (N, 3)."""
    size = N_ROBOTS * 3 * np.dtype(np.float32).itemsize
    distinct = {bytes(buffer) for buffer in buffers if len(buffer) == size}
    return [np.frombuffer(buffer, np.float32).reshape(N_ROBOTS, 3) for buffer in distinct]


def test_a_replay_loads_nothing_and_escapes_its_title(run, tmp_path):
    write_replay(run, Film(2, 10, speed=4.0, title="A <b> & c"), tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert "<title>A &lt;b&gt; &amp; c</title>" in text
    assert not re.findall(r"""(?:src|href)=["']?(?:https?:)?//""", text)


def test_a_replay_has_the_poses_of_the_run(run, tmp_path):
    film = Film(2, 10, speed=4.0)
    write_replay(run, film, tmp_path / "page.html")
    description, buffers = unpack((tmp_path / "page.html").read_text())

    # Two pictures for each of eight steps, and one at the end.
    assert description["durationSeconds"] == pytest.approx((8 * 2 + 1) / 8)

    last_pose = run.arrays["pose"][film.last]
    heights = np.full(N_ROBOTS, 0.5)
    expected = np.column_stack([last_pose[:, :2] * 1e3, heights])
    differences = [np.abs(places - expected).max() for places in vectors_of_robots(buffers)]
    assert min(differences) <= 1 / 128 + 1e-4  # places are rounded


def test_the_last_step_is_that_of_the_run_or_some_after_the_first(run, monkeypatch):
    assert swarm_film(run, Film(2)).last == 12
    monkeypatch.setattr(replay, "MOST_STEPS", 3)
    assert swarm_film(run, Film(2)).last == 5


def test_the_command_says_what_it_leaves_out(run, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(replay, "MOST_STEPS", 3)
    command = ("replay", str(run.path), f"--out={tmp_path / 'replay.html'}")
    assert code_of(*command) == 0
    assert code_of(*command, "--last=4") == 0
    assert code_of(*command, "--first=9") == 0

    cut, chosen, whole = capsys.readouterr().out.splitlines()
    assert "steps 0 to 3 of" in cut
    assert cut.endswith("--last 12 shows all")
    assert "shows all" not in chosen
    assert "steps 9 to 12 of" in whole
    assert "shows all" not in whole


@pytest.mark.parametrize(
    "film", [Film(0, 99), Film(5, 5), Film(colour_by="red"), Film(draw=("links", "foo"))]
)
def test_a_film_that_does_not_fit_the_run_is_refused(run, film, tmp_path):
    with pytest.raises(UserError):
        write_replay(run, film, tmp_path / "page.html")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("link_sender", lambda senders: senders + 30),
        ("dust_hop", lambda hops: hops.astype("U3")),
        ("scene_area_shapes", lambda _: np.array(["disc"])),
    ],
)
def test_arrays_that_do_not_fit_each_other_are_refused(run, name, change, tmp_path):
    arrays = run.arrays | {name: change(run.arrays[name])}
    odd = replace(run, scenes={0: scene_of(arrays)}, _arrays={0: arrays})
    with pytest.raises(UserError, match="the recorded arrays do not fit each other"):
        write_replay(odd, Film(2, 10), tmp_path / "page.html")
    assert not list(tmp_path.iterdir())
