"""Random drops of small sheets on a mesh and on themselves: do surfaces ever intersect, does energy grow?

`python -m benchmarks.drops [COUNT] [--first SEED] [--ledger FILE]` runs COUNT drops (1000) from a seed
(0) and prints a line for each that intersects in a frame or gains energy, and a last line with the
counts. `--ledger` appends each drop to a file of JSON lines and does not repeat those that the file holds.
The test of triangles is independent of the contact library (`tests/triangle_pairs.py`).
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from ddgcli.io.mesh_file import MeshInput
from ddgcli.mesh.shapes import icosphere
from tests.simulate import shell_run
from tests.triangle_pairs import meshes_intersect

BALL = icosphere(1, 0.05)
MAX_ENERGY_GAIN = 1e-6  # between frames, of the range of the energy
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


def drop_scene(seed: int) -> str:
    """Text of a scene: a sheet of random size, place, spin and friction."""
    rng = np.random.default_rng(seed)

    def text(values: np.ndarray) -> str:
        return ", ".join(f"{v:.6f}" for v in values)

    width, length = rng.uniform(0.05, 0.2, 2)
    return SCENE.format(
        width=width, length=length, columns=int(rng.integers(2, 5)), rows=int(rng.integers(2, 7)),
        x=rng.uniform(-0.1, 0.0), y=rng.uniform(-0.1, 0.0), axis=text(rng.normal(size=3)),
        degrees=rng.uniform(0, 180), spin=text(rng.uniform(-5, 5, 3)), friction=rng.choice([0.0, 0.3, 1.0]),
    )  # fmt: skip


def drop(seed: int, **overrides: Any) -> tuple[int, float]:
    """Frames with an intersection, and the largest gain of energy between frames over the energy range.

    Overrides are keys of the scene's `[time]`.
    """
    snapshots, contexts, _ = shell_run(drop_scene(seed), lambda name: MeshInput(BALL, name), **overrides)
    faces, ball = np.asarray(contexts["s"].mesh.faces), (np.asarray(BALL.points), np.asarray(BALL.faces))
    positions = [snapshot.observations["s"].points for snapshot in snapshots]
    crossed = sum(
        meshes_intersect(p, faces, p, faces) or meshes_intersect(p, faces, *ball) for p in positions
    )
    energy = np.array([snapshot.observations["s"].scalar["energy"] for snapshot in snapshots])
    return crossed, float(np.diff(energy).max() / np.ptp(energy))


def drop_row(seed: int) -> dict[str, Any]:
    """Row of the ledger."""
    begin = time.process_time()
    row: dict[str, Any] = {"seed": seed}
    try:
        row["crossed"], row["gain"] = drop(seed)
    except Exception as error:
        row["error"] = f"{type(error).__name__}: {error}"
    return row | {"cpu": round(time.process_time() - begin, 2)}


def bad(row: dict[str, Any]) -> bool:
    """Whether a drop failed, intersected or gained energy."""
    return "error" in row or row["crossed"] > 0 or row["gain"] > MAX_ENERGY_GAIN


def main() -> None:
    """Run the drops that the ledger does not hold; print the bad ones and the counts of all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("count", type=int, nargs="?", default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--ledger", default="")
    options = parser.parse_args()
    path = Path(options.ledger)
    rows: dict[int, dict[str, Any]] = {}
    if options.ledger and path.exists():
        lines = path.read_text(encoding="utf-8").splitlines()
        rows = {row["seed"]: row for row in map(json.loads, lines)}
    for seed in range(options.first, options.first + options.count):
        if seed not in rows:
            rows[seed] = drop_row(seed)
            if options.ledger:
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(rows[seed], default=float) + "\n")
            if bad(rows[seed]):
                print(rows[seed], flush=True)
    done = list(rows.values())
    print(
        f"{len(done)} drops: {sum(row.get('crossed', 0) > 0 for row in done)} with an intersection, "
        f"{sum(row.get('gain', 0) > MAX_ENERGY_GAIN for row in done)} that gain energy, "
        f"{sum('error' in row for row in done)} that failed; {sum(row['cpu'] for row in done):.0f} s of CPU"
    )


if __name__ == "__main__":
    main()
