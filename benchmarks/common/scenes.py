"""Scenes that the atlas and the tests both run."""

# a square sheet that spins, drifts and rings, touched by nothing: energy and momenta are constant
FREE_SCENE = """
[time]
duration = {duration}
step = {step}
frame_every = {duration}
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [1, 1], cells = [3, 3] }}
density = 1.0
young = 3e4
thickness = "5 mm"
poisson = 0.3
velocity = [0.3, 0.1, -0.2]
angular_velocity = [2.0, 1.0, 1.5]
[effects]
stretching = {{}}
bending = {{}}
"""

# a strip along x of length 1, its first columns of cells clamped, under its own weight
CANTILEVER = """
[time]
integrator = "static"
[[object]]
name = "s"
role = "shell"
density = {density}
thickness = "3 cm"
young = 444.4444444444444
poisson = 0.0
{shape}
[effects]
stretching = {{}}
bending = {{ model = "{model}" }}
gravity = {{}}
pin = {{ box = [[-1, -1, -1], [{clamp}, 1, 1]] }}
"""
RIGIDITY = 1e-3  # of the cantilever: young thickness^3 / 12
