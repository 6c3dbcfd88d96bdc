"""Makes the meshes of `models/meshes/`: `python tools/make/make_meshes.py [folder]`.

Only the bent piezo leg needs one; every other part of the robot is a primitive. Lengths are in mm.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh

FOLDER = Path(__file__).resolve().parents[2] / "models" / "meshes"

LEG_SPAN = 0.60  # from the root to the foot, along x
LEG_HEIGHT = 0.30  # the root's clamp lies this high above the foot
LEG_WIDTHS = (0.34, 0.14)  # root, foot, along y
LEG_THICKNESS = 0.03
LEG_CLAMP = 0.25  # share of the span that lies flat against the substrate
LEG_SECTIONS = 14


def _leg_centre_line(n_sections: int) -> np.ndarray:
    """Centre line (x, z) of the leg [n, 2]: flat at the clamp, then bent down, level again at the
    foot."""
    s = np.linspace(0.0, 1.0, n_sections)
    bend = np.clip((s - LEG_CLAMP) / (1.0 - LEG_CLAMP), 0.0, 1.0)
    # A cantilever's smooth step, sharpened towards the foot.
    drop = bend**2 * (3.0 - 2.0 * bend)
    top, bottom = LEG_HEIGHT - LEG_THICKNESS / 2, LEG_THICKNESS / 2
    return np.stack([LEG_SPAN * s, top + (bottom - top) * drop], axis=1)


def leg() -> trimesh.Trimesh:
    """The piezo leg: a tapered strip swept along its bent centre line, root at x = 0, foot on z =
    0."""
    line = _leg_centre_line(LEG_SECTIONS)
    tangent = np.gradient(line, axis=0)
    tangent[[0, -1]] = [1.0, 0.0]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    half_width = np.linspace(*LEG_WIDTHS, LEG_SECTIONS) / 2

    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]  # (y, normal), counter-clockwise seen along -x
    vertices = np.zeros((LEG_SECTIONS, 4, 3))
    for k, (side, face) in enumerate(corners):
        vertices[:, k, [0, 2]] = line + face * normal * LEG_THICKNESS / 2
        vertices[:, k, 1] = side * half_width

    faces = [[0, 2, 1], [0, 3, 2]]
    for i in range(LEG_SECTIONS - 1):
        for k in range(4):
            a, b = 4 * i + k, 4 * i + (k + 1) % 4
            faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    last = 4 * (LEG_SECTIONS - 1)
    faces += [[last, last + 1, last + 2], [last, last + 2, last + 3]]

    mesh = trimesh.Trimesh(vertices.reshape(-1, 3), faces, process=False)
    mesh.fix_normals()
    if not mesh.is_watertight or mesh.volume <= 0:
        raise ValueError("The leg's mesh is not a closed body: check the order of its corners.")
    return mesh


def main(folder: Path = FOLDER) -> None:
    """Writes every mesh as .obj, vertices to 0.1 um."""
    folder.mkdir(parents=True, exist_ok=True)
    text = leg().export(
        file_type="obj", include_normals=False, include_texture=False, digits=4, header=None
    )
    (folder / "leg.obj").write_text(
        "# Bent piezo leg, mm; made by tools/make/make_meshes.py\n" + text + "\n"
    )


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
