"""Files of a training: no interruption changes them, and those of another training are refused."""

import json
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pyarrow.csv
import pytest
from support.search import contents
from support.training import SMALL, TRAINING, Three, pretend, trained

from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.search.training import CHECKPOINT, CURVE, WEIGHTS, policy, train
from iswarm_mj.strategy.network import load_weights
from iswarm_mj.strategy.neural import N_WEIGHTS, Neural
from iswarm_mj.tasks.aggregation import Aggregation
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.utils.errors import UserError

pytestmark = pytest.mark.usefixtures("few_pixels")
PLANAR = PlanarSettings(1)


@pytest.fixture
def whole(monkeypatch, tmp_path):
    """Return the directory of a training that was not interrupted."""
    pretend(monkeypatch)
    trained(tmp_path / "whole")
    return tmp_path / "whole"


def test_the_files_are_complete(monkeypatch, tmp_path):
    pretend(monkeypatch)
    weights = trained(tmp_path)
    files = contents(tmp_path)
    assert set(files) == {CHECKPOINT, CURVE, WEIGHTS, "learning.png", "learning.svg"}
    assert weights.any()  # the latest mean, without a validation
    np.testing.assert_array_equal(load_weights(tmp_path / WEIGHTS), weights)
    generations = pyarrow.csv.read_csv(tmp_path / CURVE)["generation"].to_pylist()
    assert generations == [1, 2, 3, 4, 5]

    _, first_entry = files[CHECKPOINT][-1]
    settings = json.loads(first_entry)["settings"]
    assert settings["engine"] == "planar"
    assert settings["population"] == 4
    assert settings["strategy"]["class"] == "Three"


@pytest.mark.parametrize("n_before", [0, 1, 3])
def test_an_interruption_changes_nothing(monkeypatch, tmp_path, whole, n_before):
    out = tmp_path / "interrupted"
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        pretend(patch, breaks_after=n_before)
        trained(out)
    assert (out / CURVE).exists() == (out / WEIGHTS).exists() == (n_before > 0)

    rollouts = pretend(monkeypatch)
    trained(out)
    assert len(rollouts) == 5 - n_before
    assert contents(out) == contents(whole)


def test_a_finished_training_may_go_on(monkeypatch, tmp_path, whole):
    longer = replace(TRAINING, generations=7)
    trained(tmp_path / "long", longer)
    rollouts = pretend(monkeypatch)
    trained(whole, longer)
    assert len(rollouts) == 2
    assert contents(whole) == contents(tmp_path / "long")


class TestOtherTrainings:
    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"task": Aggregation()}, r"different settings \(.*task"),
            ({"training": replace(TRAINING, seed=4)}, r"different settings \(.*seed"),
            ({"engine": MujocoSettings(1)}, "different settings"),
            ({"weights": [0.0, 1.0, 0.0]}, "different settings"),
            (
                {"training": replace(TRAINING, generations=4)},
                "generations must be at least 5, which",
            ),
        ],
        ids=["task", "seed", "engine", "weights", "generations"],
    )
    def test_their_directories_are_refused_and_stay_as_they_were(self, whole, change, message):
        before = contents(whole)
        wanted = {
            "training": TRAINING,
            "weights": [0.0, 0.0, 0.0],
            "engine": PLANAR,
            "task": CLEANING,
            **change,
        }
        strategy = Three(jnp.array(wanted["weights"]))
        with pytest.raises(UserError, match=message):
            train(wanted["training"], strategy, whole, wanted["engine"], task=wanted["task"])
        assert contents(whole) == before

    def test_they_are_replaced_on_request(self, whole):
        weights = trained(whole, replace(TRAINING, seed=4), again=True)
        np.testing.assert_array_equal(load_weights(whole / WEIGHTS), weights)


def test_weights_of_another_strategy_are_refused(whole):
    assert len(policy(Neural(), SMALL, 4).weights) == N_WEIGHTS
    with pytest.raises(UserError, match=r"has 3 weights, but"):
        policy(Neural(whole / WEIGHTS), SMALL, 4)
