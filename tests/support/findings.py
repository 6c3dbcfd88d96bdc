"""Tables of made-up results, for findings and reports."""

from dataclasses import asdict

import numpy as np

from iswarm_mj.paper.analysis.evolution import evolutions
from iswarm_mj.paper.analysis.evolution_statements import STATEMENTS
from iswarm_mj.search.search import Search
from iswarm_mj.strategy.genome import Genome


def search_rows(generations=120, population=10, learns=True, seed=0):
    """Return the rows of a made-up search.

    Fitness rises up to generation 35. Of the genomes that count hops nine in ten clean the arena,
    of the others one in 25.
    """
    rng = np.random.default_rng(seed)
    rows = []
    n_without_hops = 0
    for generation in range(generations):
        level = min(generation, 35) / 35 if learns else 0.5
        for individual in range(population):
            # The genome: hop counts spread, and scouts and forgetting depend on each other.
            scouts = rng.uniform(0, 0.4)
            counts_hops = bool(rng.random() < 0.3 + 0.6 * level)
            if counts_hops:
                cleans = bool(rng.random() < 0.9)
            else:
                n_without_hops += 1
                cleans = n_without_hops % 25 == 13
            genome = Genome(
                fraction_scouts=scouts,
                p_vector_forget=float(np.clip(0.4 - 0.7 * scouts + rng.normal(0, 0.04), 0, 1)),
                use_hop_count=counts_hops,
                density_of_robots=float(np.clip(rng.normal(0.125, 0.002), 0.1, 0.2)),
            )

            # What its run measured.
            fitness = (4000 if cleans else 1500) + 3500 * level + rng.normal(0, 100)
            rows.append(
                {
                    "generation": generation,
                    "individual": individual,
                    **asdict(genome),
                    "n_robots": 297,
                    "delivered": 72 if cleans else 40,
                    "fitness": float(fitness),
                    "finished_at": 320 if cleans else None,
                }
            )
    return rows


def replicated(n, seed=0, **options):
    """Return the rows of n made-up searches in one table."""
    rows = []
    for number in range(n):
        for row in search_rows(seed=[seed, number], **options):
            rows.append({"replicate": number, **row})
    return rows


def grasp_rows(grasp=25.0, release=42.0, slope=0.0, repeats=10, noise=1.0, dry=-0.4):
    """Return rows of made-up trials on the bench, of 5 radii and 4 humidities.

    Args:
        grasp: mean voltage that lifts a ball at 10 % RH [V].
        release: mean voltage that releases one there [V].
        slope: change of the voltage that lifts with the radius [V/um].
        repeats: trials of each radius and humidity.
        noise: standard deviation of the voltages [V].
        dry: change of the voltages per % RH below 10 [V].
    """
    rng = np.random.default_rng(0)
    rows = []
    for radius in np.linspace(15e-6, 25e-6, 5):
        for humidity in (10.0, 30.0, 50.0, 5.0):
            by_humidity = (humidity - 10) / 8 if humidity > 10 else (humidity - 10) * dry
            by_radius = slope * (radius * 1e6 - 20)
            for repeat in range(repeats):
                lift = grasp + by_humidity + by_radius + noise * rng.normal()
                drop = release + by_humidity + noise * rng.normal()
                rows += _rows_of_trial(
                    float(lift),
                    float(drop),
                    radius=float(radius),
                    relative_humidity=humidity,
                    repeat=repeat,
                )
    return rows


def _rows_of_trial(grasp, release, **condition):
    """Return the three rows of a trial: without contact, the grasp, and the release."""
    common = {
        **condition,
        "seed": 0,
        "melted": False,
        "work_tool_object": 1.4e-3,
        "work_object_substrate": 14.7e-3,
        "flight_time": None,
        "landing_speed": None,
        "landed": None,
        "transport": None,
        "off_target": None,
        "quasi_static_voltage": 25.0,
        "faulty": False,
        "engine": "mujoco",
        "impl": "c",
        "step_voltage": 0.25,
    }
    no_contact = {
        "experiment": "no_contact",
        "gap": 1e-6,
        "voltage": None,
        "limit_voltage": 50.0,
    }
    lift = {
        "experiment": "grasp",
        "gap": 0.0,
        "voltage": grasp,
        "limit_voltage": 80.0,
    }
    drop = {
        "experiment": "release",
        "gap": 5e-6,
        "voltage": release,
        "limit_voltage": 80.0,
        "landed": True,
        "transport": 50e-6,
        "off_target": 0.1e-6,
    }
    return [common | no_contact, common | lift, common | drop]


GRASP_SETTINGS = {
    "radii": [15e-6, 25e-6],
    "humidities": [10.0, 30.0],
    "repeats": 5,
    "seed": 4,
    "engine": "mujoco",
    "impl": "jax",
    "calibration": {},
}


def settings_of(method="paper", **changes):
    """Return the settings of a search by a method, with some changes."""
    return Search(method=method).settings | changes


class FindingsByClaim(dict):
    """Findings by the texts of their claims, made when they are asked for."""

    def __init__(self, samples):
        self.samples = samples

    def __missing__(self, claim):
        (statement,) = (statement for statement in STATEMENTS if statement.claim == claim)
        return statement.finding(self.samples)


def found_in(paper_rows, **rows_of_methods):
    """Return the findings in rows of searches by the paper's method and by further ones."""
    rows_of_methods = {"paper": paper_rows} | rows_of_methods
    samples = {method: evolutions(rows, 72) for method, rows in rows_of_methods.items()}
    return FindingsByClaim(samples)


def changed(rows, change):
    """Return rows with columns that depend on the number of the replicate."""
    return [row | change(row, row["replicate"]) for row in rows]
