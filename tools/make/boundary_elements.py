"""Make the table of electrostatic forces on a ball between plate and flat probe.

    python tools/make/boundary_elements.py        # a few minutes; writes the table of the package

The forces are those of `iswarm_mj.gripper.tips.forces`.
"""

import argparse
from pathlib import Path

from iswarm_mj.gripper.laws import probe_table
from iswarm_mj.gripper.laws.probe_table import FILE, GAP_EXPONENTS, PROBE_EXPONENTS
from iswarm_mj.gripper.tips.forces import shape_factor
from iswarm_mj.gripper.tips.shapes import flat


def table() -> str:
    """Return the table of shape factors."""
    lines = [
        "# F D / (R pi eps0 V^2); made by: python tools/make/boundary_elements.py",
        "# log2_D_over_R,log2_Rm_over_R,release,pick",
    ]
    for gap in GAP_EXPONENTS:
        for probe in PROBE_EXPONENTS:
            tip = flat(2.0**probe)
            release = shape_factor(tip, 1.0, 2.0**gap, "release")
            pick = shape_factor(tip, 1.0, 2.0**gap, "pick")
            lines.append(f"{gap:.4f},{probe:.4f},{release:.6f},{pick:.6f}")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the table beside the module that reads it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    beside_reader = Path(probe_table.__file__).with_name(FILE)
    parser.add_argument("--out", type=Path, default=beside_reader, help="the table")
    arguments = parser.parse_args()
    arguments.out.write_text(table(), encoding="utf-8")


if __name__ == "__main__":
    main()
