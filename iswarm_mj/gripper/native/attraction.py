"""The gap between a ball and a surface, and a pull across it, as functions that Numba compiles."""

import numpy as np

from iswarm_mj.gripper.native.abi import PLANE, compiled


@compiled
def gap_to(f, ball, surface):
    """Gap from a plane or cylinder to a ball [um], and the unit vector that points along it to the ball."""
    b, s, r = 3 * ball, 3 * surface, 9 * surface
    x, y, z = f.geom_xpos[b], f.geom_xpos[b + 1], f.geom_xpos[b + 2]
    x, y, z = x - f.geom_xpos[s], y - f.geom_xpos[s + 1], z - f.geom_xpos[s + 2]
    ux, uy, uz = f.geom_xmat[r + 2], f.geom_xmat[r + 5], f.geom_xmat[r + 8]
    along = x * ux + y * uy + z * uz
    radius = f.geom_size[b]
    if f.geom_type[surface] == PLANE:
        return along - radius, ux, uy, uz
    # The part of the vector beyond the cylinder's half length and radius.
    x, y, z = x - along * ux, y - along * uy, z - along * uz
    aside = np.sqrt(x * x + y * y + z * z)
    beyond = along - min(max(along, -f.geom_size[s + 1]), f.geom_size[s + 1])
    share = 1 - f.geom_size[s] / aside if aside > f.geom_size[s] else 0.0
    x, y, z = share * x + beyond * ux, share * y + beyond * uy, share * z + beyond * uz
    distance = np.sqrt(x * x + y * y + z * z)
    scale = 1 / distance if distance > 0 else 0.0
    return distance - radius, scale * x, scale * y, scale * z


@compiled
def attract(f, ball, surface, gap, nx, ny, nz, force):
    """Pull a ball and a surface together, each at the middle of the gap between them."""
    b = 3 * ball
    reach = f.geom_size[b] + gap / 2
    px, py, pz = f.geom_xpos[b] - reach * nx, f.geom_xpos[b + 1] - reach * ny, f.geom_xpos[b + 2] - reach * nz
    _push(f, f.geom_bodyid[ball], px, py, pz, -force * nx, -force * ny, -force * nz)
    _push(f, f.geom_bodyid[surface], px, py, pz, force * nx, force * ny, force * nz)


@compiled
def _push(f, body, px, py, pz, fx, fy, fz):
    """Add a force at a point to the generalised forces of the joints that move a body."""
    while body > 0 and f.body_dofnum[body] == 0:
        body = f.body_parentid[body]
    if body == 0:
        return
    c = 3 * f.body_rootid[body]
    rx, ry, rz = px - f.subtree_com[c], py - f.subtree_com[c + 1], pz - f.subtree_com[c + 2]
    tx, ty, tz = ry * fz - rz * fy, rz * fx - rx * fz, rx * fy - ry * fx
    dof = f.body_dofadr[body] + f.body_dofnum[body] - 1
    while dof >= 0:
        a = 6 * dof
        turn = f.cdof[a] * tx + f.cdof[a + 1] * ty + f.cdof[a + 2] * tz
        f.qfrc_passive[dof] += turn + f.cdof[a + 3] * fx + f.cdof[a + 4] * fy + f.cdof[a + 5] * fz
        dof = f.dof_parentid[dof]
