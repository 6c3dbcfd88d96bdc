"""The learned strategy against the paper's, in the same fresh worlds, on the planar engine.

    python tools/compare_policies.py --seeds 24 --steps 400
    python tools/compare_policies.py --paper --robots 283 --steps 800 --only neural

Rows: the paper's type 1, the network, the network that says nothing (the weights of its signals are 0), and the
untrained network with which training began. Columns: means over worlds with 95 % bootstrap intervals; how many worlds
were clean. The arena is that of the training, unless --paper or --size and the others say otherwise.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.experiments.analysis.statistics import difference, interval
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.network import load_weights
from iswarm_mj.strategy.neural import SHAPE, SHIPPED, SIGNALS, untrained
from iswarm_mj.workflows.rollout import rollout

FRESH = 2**31
"""Seed of the first world; trainings have others, unless they were given such."""


def silent(weights):
    """Weights with those of the signals 0."""
    split = (SHAPE.inputs + 1) * SHAPE.hidden
    outputs = weights[split:].reshape(-1, SHAPE.outputs).copy()
    outputs[:, -len(SIGNALS) :] = 0
    return np.concatenate([weights[:split], outputs.ravel()])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--robots", type=int, default=30)
    parser.add_argument("--size", type=float, default=20.0)
    parser.add_argument("--dust-area-size", type=float, default=5.0)
    parser.add_argument("--dust-area-offset", type=float, default=6.5)
    parser.add_argument("--n-dust", type=int, default=36)
    parser.add_argument("--paper", action="store_true", help="the paper's arena")
    parser.add_argument(
        "--refinement", type=int, default=PlanarSettings.refinement, help="of the engine's physics steps"
    )
    parser.add_argument("--only", nargs="+", help="rows beside type 1")
    parser.add_argument("--weights", type=Path, default=SHIPPED)
    parser.add_argument("--threads", type=int, default=0)
    args = parser.parse_args()
    own = {name: getattr(args, name) for name in ("size", "dust_area_size", "dust_area_offset", "n_dust")}
    config = SwarmConfig() if args.paper else SwarmConfig(ArenaConfig(**own))
    keys = jax.random.split(jax.random.key(FRESH), args.seeds)
    network = untrained(config, read_robot(), load_weights(args.weights))
    strategies = {
        "type 1": PRESETS["type1"],
        "neural": network,
        "neural, silent": replace(network, weights=jax.numpy.asarray(silent(np.asarray(network.weights)))),
        "untrained": untrained(config, read_robot()),
    }
    strategies = {name: one for name, one in strategies.items() if args.only is None or name in ("type 1", *args.only)}
    engine, found = PlanarSettings(args.threads, args.refinement), {}
    print("| | delivered | picked up | collisions | clean worlds | steps until clean |\n|---|---|---|---|---|---|")
    for name, strategy in strategies.items():
        result = rollout(config, strategy, keys, n_robots=args.robots, steps=args.steps, engine=engine, every=25)
        found[name] = result.delivered.astype(float)
        cells = [told(values) for values in (result.delivered, result.picked, result.collisions)]
        when = result.finished_at[result.is_finished]
        median = f"{np.median(when):.0f}" if len(when) else "-"
        clean = f"{result.is_finished.sum()} of {args.seeds}"
        print(f"| {name} | {' | '.join(cells)} | {clean} | {median} |" + " faults!" * bool(result.faults), flush=True)
    for name in [name for name in found if name.startswith("neural")]:
        value, low, high = difference(found[name], found["type 1"], np.mean)
        print(f"delivered, {name} minus type 1: {value:.1f} ({low:.1f} to {high:.1f})")
    print("\nSteps until clean: medians of the worlds that were.")


def told(values):
    estimate, low, high = interval(values.astype(float))
    return f"{estimate:.1f} ({low:.1f} to {high:.1f})"


if __name__ == "__main__":
    main()
