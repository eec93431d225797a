"""Random drops of small sheets on a mesh and on themselves: do surfaces ever intersect, does energy grow?

`python -m benchmarks.drops [COUNT] [FIRST]` runs COUNT drops (default 1000) from seed FIRST (default 0) and
prints a line for each that intersects in a frame or gains energy, and a last line with the counts. The test
of triangles is independent of the contact library (`tests/triangle_pairs.py`).
"""

from __future__ import annotations

import sys
import time

import numpy as np

from ddgcli.io.mesh_file import MeshInput
from ddgcli.mesh.shapes import icosphere
from tests.simulate import shell_run
from tests.triangle_pairs import meshes_intersect

BALL = icosphere(1, 0.05)
SCENE = """
[time]
duration = 0.3
step = 4e-3
frame_every = 4e-3
integrator = "implicit-euler"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [{width}, {length}], cells = [{columns}, {rows}] }}
density = 0.2
thickness = "1 mm"
young = 2e5
poisson = 0.3
position = [{x}, {y}, 0.3]
rotation = {{ axis = [{axis}], degrees = {degrees} }}
velocity = [0, 0, -1]
angular_velocity = [{spin}]
[[object]]
name = "o"
role = "obstacle"
mesh = "ball"
[[object]]
name = "floor"
role = "obstacle"
plane = {{ point = [0, 0, -0.06] }}
[effects]
stretching = {{}}
bending = {{ stiffness = 1e-6 }}
gravity = {{}}
contact = {{ pairs = [["s", "o"], ["s", "floor"]], self_contact = true, friction = {friction} }}
"""


def drop(seed: int) -> tuple[int, float]:
    """Frames with an intersection, and the largest gain of energy between frames over the energy range."""
    rng = np.random.default_rng(seed)

    def text(values: np.ndarray) -> str:
        return ", ".join(f"{v:.6f}" for v in values)

    width, length = rng.uniform(0.05, 0.2, 2)
    scene = SCENE.format(
        width=width, length=length, columns=int(rng.integers(2, 5)), rows=int(rng.integers(2, 7)),
        x=rng.uniform(-0.1, 0.0), y=rng.uniform(-0.1, 0.0), axis=text(rng.normal(size=3)),
        degrees=rng.uniform(0, 180), spin=text(rng.uniform(-5, 5, 3)), friction=rng.choice([0.0, 0.3, 1.0]),
    )  # fmt: skip
    snapshots, contexts, _ = shell_run(scene, lambda name: MeshInput(BALL, name, "0" * 64))
    faces, ball = np.asarray(contexts["s"].mesh.faces), (np.asarray(BALL.points), np.asarray(BALL.faces))
    positions = [snapshot.observations["s"].points for snapshot in snapshots]
    crossed = sum(
        meshes_intersect(p, faces, p, faces) or meshes_intersect(p, faces, *ball) for p in positions
    )
    energy = np.array([snapshot.observations["s"].scalar["energy"] for snapshot in snapshots])
    return crossed, float(np.diff(energy).max() / np.ptp(energy))


def main(count: int = 1000, first: int = 0) -> None:
    begin, failed, crossed, grown = time.process_time(), 0, 0, 0
    for seed in range(first, first + count):
        try:
            intersections, gain = drop(seed)
        except Exception as error:
            failed += 1
            print(f"seed {seed}: {type(error).__name__}: {error}", flush=True)
            continue
        crossed, grown = crossed + (intersections > 0), grown + (gain > 1e-6)
        if intersections or gain > 1e-6:
            print(f"seed {seed}: {intersections} frames intersect, energy gain {gain:.2g}", flush=True)
    print(
        f"{count} drops: {crossed} with an intersection, {grown} that gain energy, {failed} that failed; "
        f"{time.process_time() - begin:.0f} s of CPU"
    )


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:3]))
