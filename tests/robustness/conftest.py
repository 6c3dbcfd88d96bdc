"""Attacks are given their number of cases, and their counts are told at the end."""

import pytest
from helpers_attack import Attack, numbers

from iswarm_mj import MujocoSettings, Run, RunSettings
from iswarm_mj.workflows.clean import clean

KEY = "attack"


@pytest.fixture
def attack(request):
    """The attack of a test, whose marker `attack` states its number of cases."""
    (n_cases,) = request.node.get_closest_marker("attack").args
    config = request.config.option
    first, alone = numbers(config.case)
    found = Attack(request.node.nodeid, n_cases * config.times, first, alone)
    yield found
    request.node.user_properties.append((KEY, dict(found.counts)))
    found.check()


@pytest.fixture(scope="session")
def recorded_run(small, tmp_path_factory):
    """Directory of a finished run of three steps with two recorded worlds."""
    out, settings = tmp_path_factory.mktemp("recorded"), RunSettings(9, 3, n_worlds=2, record_worlds=(0, 1))
    clean(Run(small, settings=settings, engine=MujocoSettings(1)), settings, out)
    return out


def pytest_terminal_summary(terminalreporter):
    """One line for each attack."""
    for reports in terminalreporter.stats.values():
        for report in reports:
            for counts in (value for name, value in getattr(report, "user_properties", ()) if name == KEY):
                if report.when == "teardown":
                    told = ", ".join(f"{count} {what}" for what, count in sorted(counts.items()))
                    terminalreporter.write_line(f"{report.nodeid}: tried {sum(counts.values())}: {told or 'none'}")
