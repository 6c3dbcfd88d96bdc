"""Make the meshes of models/meshes/.

    python tools/make/make_meshes.py

Only the bent piezo leg needs one; every other part of the robot is a primitive. Lengths are in mm.
"""

import argparse
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float

FOLDER = Path(__file__).resolve().parents[2] / "models" / "meshes"

LEG_SPAN = 0.60
"""Length from the root to the foot, along x [mm]."""
LEG_HEIGHT = 0.30
"""Height of the top of the root's clamp above the foot [mm]."""
LEG_WIDTHS = (0.34, 0.14)
"""Widths of root and foot, along y [mm]."""
LEG_THICKNESS = 0.03
"""Thickness of the strip [mm]."""
LEG_CLAMP = 0.25
"""Share of the span that lies flat against the substrate."""
N_SECTIONS = 14
"""Number of cross-sections of the leg."""
_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))
"""Corners of a cross-section (along y, along the normal), counter-clockwise seen along -x."""


def leg_centre_line(n_sections: int) -> Float[np.ndarray, "n 2"]:
    """Return points (x, z) of the leg: flat at the clamp, then bent down, level at the foot."""
    share = np.linspace(0.0, 1.0, n_sections)
    bend = np.clip((share - LEG_CLAMP) / (1.0 - LEG_CLAMP), 0.0, 1.0)
    # A cantilever's smooth step, sharpened towards the foot.
    drop = bend**2 * (3.0 - 2.0 * bend)
    top = LEG_HEIGHT - LEG_THICKNESS / 2
    bottom = LEG_THICKNESS / 2
    return np.stack([LEG_SPAN * share, top + (bottom - top) * drop], axis=1)


def leg_vertices() -> Float[np.ndarray, "n 4 3"]:
    """Return the corners of the leg's cross-sections."""
    line = leg_centre_line(N_SECTIONS)
    tangent = np.gradient(line, axis=0)
    tangent[[0, -1]] = [1.0, 0.0]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    half_width = np.linspace(*LEG_WIDTHS, N_SECTIONS) / 2

    vertices = np.zeros((N_SECTIONS, 4, 3))
    for corner, (side, face) in enumerate(_CORNERS):
        vertices[:, corner, [0, 2]] = line + face * normal * LEG_THICKNESS / 2
        vertices[:, corner, 1] = side * half_width
    return vertices


def strip_faces(n_sections: int) -> list[list[int]]:
    """Return triangles of a strip, by the indices of its vertices: root, sides, foot."""
    faces = [[0, 2, 1], [0, 3, 2]]
    for section in range(n_sections - 1):
        first = 4 * section
        for corner in range(4):
            a = first + corner
            b = first + (corner + 1) % 4
            faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    last = 4 * (n_sections - 1)
    return [*faces, [last, last + 1, last + 2], [last, last + 2, last + 3]]


def leg() -> trimesh.Trimesh:
    """Return the piezo leg: a tapered strip along a bent line, root at x = 0, foot on z = 0.

    Raises:
        ValueError: it is not a closed body.
    """
    vertices = leg_vertices().reshape(-1, 3)
    mesh = trimesh.Trimesh(vertices, strip_faces(N_SECTIONS), process=False)
    mesh.fix_normals()
    if not mesh.is_watertight or mesh.volume <= 0:
        raise ValueError("The leg's mesh is not a closed body: check the order of its corners.")
    return mesh


def write(folder: Path) -> None:
    """Write every mesh as .obj, vertices to 0.1 um."""
    folder.mkdir(parents=True, exist_ok=True)
    text = leg().export(
        file_type="obj", include_normals=False, include_texture=False, digits=4, header=None
    )
    head = "# Bent piezo leg, mm; made by tools/make/make_meshes.py\n"
    (folder / "leg.obj").write_text(f"{head}{text}\n")


def main() -> None:
    """Write the meshes into a folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, nargs="?", default=FOLDER, help="for the meshes")
    write(parser.parse_args().folder)


if __name__ == "__main__":
    main()
