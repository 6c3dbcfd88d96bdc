"""Two kinds of robots gather in light: small ones of 2 x 2 mm, and large ones of 2.8 x 2.4 mm.

    python examples/two_kinds.py large.xml
    iswarm run --task examples/two_kinds.py:ByKind --strategy beeclust \
        --robot models/robot.xml:60 large.xml:40 --steps 600

The first command writes the file of the large robots, a copy of models/robot.xml with other sizes
and a mass of 17 mg.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import jax.numpy as jnp

from iswarm_mj import Aggregation, Quantity, models_directory

CHANGES = {
    # The hull that touches, and the body that is seen.
    'class="hull" size="1 1 0.5" mass="10"': 'class="hull" size="1.4 1.2 0.5" mass="17"',
    'pos="0 0 0.35" size="1 1 0.05"': 'pos="0 0 0.35" size="1.4 1.2 0.05"',
    # LEDs and photodiodes: front, back, left, right.
    'pos="1.001 ': 'pos="1.401 ',
    'pos="-1.001 ': 'pos="-1.401 ',
    " 1.001 0": " 1.201 0",
    " -1.001 0": " -1.201 0",
    # The tip of the probe.
    'site name="probe_tip" pos="0.9 ': 'site name="probe_tip" pos="1.3 ',
}
"""Text of the small robot's file, and what stands in its place in that of the large one."""


def write_large(path):
    """Write the file of the large robots."""
    text = (models_directory() / "robot.xml").read_text()
    for small, large in CHANGES.items():
        text = text.replace(small, large)
    Path(path).write_text(text)


@dataclass(frozen=True)
class ByKind(Aggregation):
    """The task `aggregation`, with the share of each kind of robots in the brighter spot.

    The progress is the share of the first kind.
    """

    measured: ClassVar = {
        "small": Quantity("share of the first kind in the brighter spot", high=1.0),
        "large": Quantity("share of the second kind in the brighter spot", high=1.0),
    }

    def advance(self, state, inputs, key):
        _, sensed = super().advance(state, inputs, key)
        is_bright = self.light(inputs.poses, state.east)[:, 0] > 0

        shares = []
        for kind in (0, 1):
            is_of_kind = inputs.is_present & (inputs.kind == kind)
            shares.append((is_of_kind & is_bright).sum() / is_of_kind.sum())
        return state._replace(shares=jnp.stack(shares).astype(jnp.float32)), sensed

    def metrics(self, state):
        return {"small": state.shares[0], "large": state.shares[1]}


if __name__ == "__main__":
    write_large(sys.argv[1])
