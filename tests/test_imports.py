"""What importing a part of the package loads. Who may import whom: the contracts of import-linter in pyproject.toml."""

import subprocess
import sys

LAWS = ["adhesion", "boundary_elements", "detachment", "electrostatics", "humidity", "maugis", "probe_table"]
"""Files of `gripper/laws/`."""


def test_laws_and_settings_are_light():
    """Importing the gripper's laws, the genome and the configuration loads neither engine, nor JAX, nor a viewer."""
    light = [
        *(f"gripper.laws.{name}" for name in [*LAWS, "sphere_plane"]),
        *("config", "output.trajectory", "strategy.genome", "commands.main"),
        *(f"utils.{name}" for name in ("arrays", "errors", "units", "jax_setup")),
    ]
    heavy = {"jax", "mujoco", "rerun", "scipy", "matplotlib", "trimesh"}
    code = "import sys\n" + "\n".join(f"import iswarm_mj.{name}" for name in light)
    code += f"\nprint(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
