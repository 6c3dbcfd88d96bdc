"""The planar engine: MuJoCo's contacts of upright boxes, solved in the plane.

Robots stand upright on the floor, so that a robot, a box or an obstacle is a rectangle that
slides and turns in the plane. The engine finds where rectangles touch, writes a condition on the
impulses for each contact point, and solves all conditions of a time step together. It also traces
the light between robots. The rules are written once; numba compiles them for CPUs and NVIDIA Warp
for GPUs.

Where to read first:

1. `plane.py`: the numbers that are read from MuJoCo's model: `Plane` (the arena) and `Kind` (a
   body).
2. `engines/contact_geometry.py`: where two rectangles touch.
3. `contact_law.py` and `contact_rows.py`: MuJoCo's soft contacts as conditions on impulses.
4. `physics.py`: a time step; with `near_pairs.py`, `contacts.py`, `islands.py` and `solver.py`
   for its parts.
5. `reception.py`, `ray_geometry.py` and `in_sight.py`: light between two robots, what hides it,
   and which sender a side hears; `sight.py` does this for all robots of a world.
6. `engine.py`: the engine for CPUs. `batch_engine.py` and `gpu/`: the same for batches of worlds
   on GPUs.

Words:

- body: a robot or a box; all that is fixed (walls, obstacles, floor) counts as one body, the last.
- kind: what bodies have in common: hull, mass, drive and friction. Robots of one file share a kind.
- row: the condition on the impulse at one contact point; a contact has one row or two.
- impulse: force times time step, by which contacts change velocities.
- drive: what pulls a robot's velocity towards its set point (a MuJoCo actuator on each joint).
- island: contacts that are connected by moving bodies; CPUs solve each island by itself.
- colour: contacts that share no moving body; GPUs solve those of one colour in parallel.
- sweep: one pass of the solver over all contacts of an island, or of all colours.
- solid: a wall, an obstacle or a box, as far as it blocks or reflects light.
- link: light from one robot's LED that arrives at a side of another one.
"""
