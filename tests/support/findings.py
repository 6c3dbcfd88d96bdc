"""Tables of made-up results, for findings and reports."""

from dataclasses import asdict

import numpy as np

from iswarm_mj.paper.analysis.evolution import evolutions
from iswarm_mj.paper.analysis.evolution_statements import STATEMENTS
from iswarm_mj.search.search import Search
from iswarm_mj.strategy.genome import Genome


def search_rows(generations=120, population=10, learns=True, seed=0):
    """A made-up search: fitness rises up to generation 35; most that count hops clean the arena,
    one of 25 others."""
    rng = np.random.default_rng(seed)
    rows, without = [], 0
    for generation in range(generations):
        level = min(generation, 35) / 35 if learns else 0.5
        for individual in range(population):
            scouts = rng.uniform(0, 0.4)
            counts = bool(rng.random() < 0.3 + 0.6 * level)
            without += not counts
            clean = bool(rng.random() < 0.9) if counts else without % 25 == 13
            genome = Genome(
                fraction_scouts=scouts,
                p_vector_forget=float(np.clip(0.4 - 0.7 * scouts + rng.normal(0, 0.04), 0, 1)),
                use_hop_count=counts,
                density_of_robots=float(np.clip(rng.normal(0.125, 0.002), 0.1, 0.2)),
            )
            fitness = (4000 if clean else 1500) + 3500 * level + rng.normal(0, 100)
            measures = {
                "n_robots": 297,
                "delivered": 72 if clean else 40,
                "fitness": float(fitness),
            }
            measures["finished_at"] = 320 if clean else None
            rows.append(
                {"generation": generation, "individual": individual, **asdict(genome), **measures}
            )
    return rows


def replicated(n, seed=0, **options):
    """The rows of n made-up searches in one table."""
    return [
        {"replicate": number, **row}
        for number in range(n)
        for row in search_rows(seed=[seed, number], **options)
    ]


def grasp_rows(grasp=25.0, release=42.0, slope=0.0, repeats=10, noise=1.0, dry=-0.4):
    """Made-up trials: 5 radii, 4 humidities; voltages change by `dry` per % RH below 10."""
    rng = np.random.default_rng(0)
    rows = []
    for radius in np.linspace(15e-6, 25e-6, 5):
        for rh in (10.0, 30.0, 50.0, 5.0):
            for repeat in range(repeats):
                common = {
                    "radius": float(radius),
                    "relative_humidity": rh,
                    "repeat": repeat,
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
                wet = (rh - 10) / 8 if rh > 10 else (rh - 10) * dry
                lift = grasp + wet + slope * (radius * 1e6 - 20) + noise * rng.normal()
                drop = release + wet + noise * rng.normal()
                rows += [
                    {
                        **common,
                        "experiment": "no_contact",
                        "gap": 1e-6,
                        "voltage": None,
                        "limit_voltage": 50.0,
                    },
                    {
                        **common,
                        "experiment": "grasp",
                        "gap": 0.0,
                        "voltage": float(lift),
                        "limit_voltage": 80.0,
                    },
                    {
                        **common,
                        "experiment": "release",
                        "gap": 5e-6,
                        "voltage": float(drop),
                        "limit_voltage": 80.0,
                        "landed": True,
                        "transport": 50e-6,
                        "off_target": 0.1e-6,
                    },
                ]
    return rows


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
    return Search(method=method).settings | changes


class Found(dict):
    """Findings by the texts of their claims, made when they are asked for."""

    def __init__(self, samples):
        self.samples = samples

    def __missing__(self, claim):
        (statement,) = (statement for statement in STATEMENTS if statement.claim == claim)
        return statement.finding(self.samples)


def found_in(rows, **others):
    return Found({name: evolutions(mine, 72) for name, mine in ({"paper": rows} | others).items()})


def changed(rows, change):
    """Rows with columns that depend on the number of the replicate."""
    return [row | change(row, row["replicate"]) for row in rows]
