"""Valid texts that are mutated: scenes, a stored summary, a row of a batch, expressions."""

from __future__ import annotations

import json
from typing import Any

SCENES = [
    b"""format = "ddgcli-scene/1"
[time]
duration = 2e-3
step = 1e-3
[[object]]
name = "hat"
role = "shell"
grid = { size = [1, 1], cells = [2, 2] }
material = "felt"
[[object]]
name = "floor"
role = "obstacle"
plane = { point = [0, 0, -1], normal = [0, 0, 1] }
[effects]
stretching = { model = "stvk" }
pin = { vertices = [0, 1] }
gravity = { acceleration = [0, 0, -9.81] }
""",
    b"""format = "ddgcli-scene/1"
[time]
duration = 0.01
step = 0.01
frame_every = 0.01
integrator = "verlet"
[[object]]
name = "balloon"
role = "shell"
sphere = { radius = 0.1, subdivisions = 0 }
material = "rubber"
young = "1 MPa"
thickness = "0.3 mm"
position = [0, 0, 0.11]
velocity = [0, "1 m/s", 0]
[effects]
stretching = { model = "stvk" }
bending = { model = "hinge" }
pressure = { value = 10, times = [0, 0.3], factors = [0, 1] }
""",
]
FLUID_SCENES = [
    b"""format = "ddgcli-scene/1"
[time]
duration = 0.01
step = 0.01
integrator = "conservative"
[[object]]
name = "ball"
role = "fluid"
sphere = { radius = 1, subdivisions = 1 }
[effects]
viscosity = { nu = 1e-3 }
initial = { vorticity = "5*z + x*y" }
""",
    b"""format = "ddgcli-scene/1"
[time]
duration = 0.01
step = 0.01
integrator = "conservative"
[[object]]
name = "square"
role = "fluid"
grid = { size = [6.283185307179586, 6.283185307179586], cells = [4, 4], periodic = "xy" }
[effects]
initial = { flow = "taylor-vortices", strength = 1.0, core = 0.3, separation = 0.8 }
""",
]
EXPECTED_SUMMARY = json.dumps(
    {"run": ["info", "a.ply"], "tolerances": {"rtol": 1e-6, "ignore": ["a"], "keys": {"b": {"rtol": 1}}},
     "summary": {"results": {"a": 1.0, "b": [1, 2, "c"]}, "input": {"path": "a.ply"}}}
).encode()  # fmt: skip
ROW: dict[str, Any] = {
    "index": 0, "input": "a.ply", "command": "ddgcli info a.ply", "parameters": {"radius": "1"},
    "output": None, "status": "done", "exit_code": 0, "seconds": 1.5, "peak_mib": 80, "sha256": "0" * 64,
    "message": "", "collected": {"area": 1.5},
}  # fmt: skip
EXPRESSIONS = [b"exp(-(x^2+y^2)/0.1)*where(x<0, 1, 2)", b"sin(3*x) + min(y, z)**2 % 3", b"-hypot(x, y)"]
