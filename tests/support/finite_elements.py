"""Force on a ball between plate and tip by finite elements, on a mesh of triangles.

Independent of the package's boundary elements: another formulation (the field in the space between
the bodies), another kind of force (the stress through a volume), and another library. Lengths are
in radii of the ball, and eps0 = 1.
"""

import numpy as np
from scipy.spatial import Delaunay
from skfem import Basis, BilinearForm, ElementTriP2, Functional, MeshTri, condense, solve
from skfem.helpers import dot, grad

from iswarm_mj.gripper.tips.profile import seat_of

BOX = 14.0
"""Radius and height of the space."""
WEB = 0.25
"""Distance from the axis up to which bodies that touch are one body."""


class Bodies:
    """Ball, tip and plate, as distances from points."""

    def __init__(self, profile, ball_radius, gap, task):
        seat = seat_of(profile, ball_radius)
        self.task = task
        self.ball_height = 1 + (gap if task == "release" else 0.0)
        tip = profile.with_wall(2 * BOX * ball_radius).scaled(1 / ball_radius)
        raised = self.ball_height - seat.height / ball_radius + (gap if task == "pick" else 0.0)
        self.tip = tip.raised(raised)
        self.wall = profile.radius / ball_radius
        self.face_length = profile.face.total / ball_radius
        s = np.linspace(0, self.face_length, 20001)
        self.face = self.tip.at(s)

    def distances(self, r, z):
        """Return the distances from ball, tip and plate, and from the tip's last edge."""
        from_ball = np.abs(np.hypot(r, z - self.ball_height) - 1)
        from_tip, _ = self.tip.nearest(r, z)
        edge_r, edge_z = self.face[0][-1], self.face[1][-1]
        return from_ball, from_tip, z, np.hypot(r - edge_r, z - edge_z)

    def size(self, r, z):
        """Return the length of an edge of the mesh: shorter where bodies are near each other."""
        *distances, from_edge = self.distances(r, z)
        between = np.sort(np.stack(distances), axis=0)[1]
        far = 0.12 + 0.25 * np.maximum(np.hypot(r, z - self.ball_height) - 1.5, 0)
        return np.clip(np.minimum.reduce([0.22 * between, far, 0.2 * from_edge]), 0.006, 1.5)

    def is_solid(self, r, z):
        """Whether points are inside of ball, tip, or the web between bodies that touch."""
        in_ball = np.hypot(r, z - self.ball_height) < 1
        face_z = np.interp(r, *self.face)
        in_tip = (r < self.wall) & (z > face_z)
        if self.task == "pick":
            in_web = (r < WEB) & (z < self.ball_height)
        else:
            in_web = (r < WEB) & (z > self.ball_height)
        return in_ball | in_tip | in_web

    def boundary(self):
        """Return points along all boundaries, as far apart as `size` says."""
        top = BOX
        side = np.array([0.0, np.pi])
        edge = np.arcsin(WEB)
        side += (edge, 0.0) if self.task == "pick" else (0.0, -edge)
        web_r, web_z = np.full(2, WEB), np.array([0.0, self.ball_height - np.cos(edge)])
        if self.task == "release":
            web_z = np.array([self.ball_height + np.cos(edge), np.interp(WEB, *self.face)])
        to_top = self.face_length + top - self.face[1][-1]
        first = 0.0 if self.task == "pick" else np.searchsorted(self.face[0], WEB) / 20000
        curves = [
            (lambda s: (np.sin(s), self.ball_height - np.cos(s)), *side),
            (self.tip.at, first * self.face_length, to_top),
            (lambda s: (s, 0 * s), WEB if self.task == "pick" else 0.0, BOX),
            (lambda s: (0 * s + BOX, s), 0.0, top),
            (lambda s: (s, 0 * s + top), self.wall, BOX),
            (lambda s: (0 * s + web_r[0], s), *web_z),
        ]
        if self.task == "pick":
            curves.append((lambda s: (0 * s, s), self.ball_height + 1, self.face[1][0]))
        else:
            curves.append((lambda s: (0 * s, s), 0.0, self.ball_height - 1))
        return np.unique(np.round(np.vstack([self._spread(*curve) for curve in curves]), 9), axis=0)

    def _spread(self, curve, first, last):
        fine = np.linspace(first, last, 40001)
        r, z = curve(fine)
        way = np.hypot(np.diff(r), np.diff(z))
        steps = way / self.size((r[1:] + r[:-1]) / 2, (z[1:] + z[:-1]) / 2)
        count = np.concatenate([[0.0], np.cumsum(steps)])
        n = max(1, int(np.ceil(count[-1])))
        places = np.interp(np.linspace(0, count[-1], n + 1), count, fine)
        return np.stack(curve(places), axis=1)

    def interior(self):
        """Return points between the bodies: centres of squares, halved until they are small."""
        n = 8
        corner = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), -1).reshape(-1, 2)
        corners, width, kept = corner * (BOX / n), BOX / n, []
        while len(corners):
            centres = corners + width / 2
            is_small = self.size(*centres.T) >= width
            kept.append(centres[is_small])
            width /= 2
            steps = width * np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
            corners = (corners[~is_small][:, None] + steps).reshape(-1, 2)
        points = np.concatenate(kept)
        r, z = points.T
        clearance = np.minimum.reduce([*self.distances(r, z)[:3], r, BOX - r, BOX - z])
        is_clear = (clearance > 0.5 * self.size(r, z)) & ~self.is_solid(r, z)
        return points[is_clear]

    def mesh(self):
        """Return the mesh of the space between the bodies."""
        points = np.concatenate([self.boundary(), self.interior()])
        triangles = Delaunay(points).simplices
        a, b, c = (points[triangles[:, k]] for k in range(3))
        area = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
        is_space = ~self.is_solid(*((a + b + c) / 3).T) & (area > 1e-12)
        triangles = triangles[is_space]
        used, renumbered = np.unique(triangles, return_inverse=True)
        return MeshTri(points[used].T.copy(), renumbered.reshape(-1, 3).T.copy())


def force(profile, ball_radius, gap, task):
    """Return the force on the ball at 1 V over eps0, positive upwards, and the mesh's triangles.

    Args:
        profile: of the tip.
        ball_radius: [m].
        gap: in radii of the ball.
        task: "pick" or "release".
    """
    bodies = Bodies(profile, ball_radius, gap, task)
    mesh = bodies.mesh()
    basis = Basis(mesh, ElementTriP2(), intorder=4)

    @BilinearForm
    def laplace(u, v, w):
        return 2 * np.pi * w.x[0] * dot(grad(u), grad(v))

    facets = mesh.boundary_facets()
    r, z = mesh.p[:, mesh.facets[:, facets]].mean(axis=1)
    from_ball, from_tip, _, _ = bodies.distances(r, z)
    is_free = (r < 1e-9) | (r > BOX - 1e-6) | (z > BOX - 1e-6)
    is_plate = ~is_free & (z < 1e-9)
    is_web = ~is_free & ~is_plate & (np.abs(r - WEB) < 1e-6) & (from_ball > 1e-3)
    is_ball = ~is_free & ~is_plate & ~is_web & (from_ball < from_tip)
    is_tip = ~is_free & ~is_plate & ~is_web & ~is_ball
    if task == "release":
        is_tip |= is_web
    else:
        is_plate |= is_web

    matrix = laplace.assemble(basis)

    def solved(ball, tip):
        values = basis.zeros()
        groups = ((is_plate, 0.0), (is_tip, tip), (is_ball, ball))
        for group, value in groups:
            values[basis.get_dofs(facets[group]).all()] = value
        fixed = np.concatenate([basis.get_dofs(facets[group]).all() for group, _ in groups])
        return solve(*condense(matrix, x=values, D=np.unique(fixed)))

    potential = basis.interpolate(solved(1.0 if task == "release" else 0.0, 1.0))
    weight = basis.interpolate(solved(1.0, 0.0))

    @Functional
    def stress(w):
        field_r, field_z = w["potential"].grad
        weight_r, weight_z = w["weight"].grad
        pressure = (field_z**2 - field_r**2) / 2
        return -2 * np.pi * w.x[0] * (weight_r * field_r * field_z + weight_z * pressure)

    return float(stress.assemble(basis, potential=potential, weight=weight)), mesh.t.shape[1]
