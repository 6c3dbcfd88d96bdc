"""Settings come back from files."""

import json
from dataclasses import asdict

import pytest

from iswarm_mj.config import READINGS, OpticsConfig, SwarmConfig
from iswarm_mj.utils.serialization import restored


@pytest.mark.parametrize(
    "config", [*READINGS.values(), SwarmConfig(optics=OpticsConfig(mode="power", baud_rate=5000.0))]
)
def test_configurations_come_back(config):
    assert restored(SwarmConfig, json.loads(json.dumps(asdict(config)))).optics == config.optics
    assert restored(SwarmConfig, asdict(config)) == config


def test_unknown_names_are_refused():
    with pytest.raises(TypeError, match="colour"):
        restored(SwarmConfig, {"arena": {"colour": 1}})
