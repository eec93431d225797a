"""Make the pictures of the site in docs/pictures/ with the commands that their captions show.

`python docs/make_pictures.py [NAME ...]`; without names all pictures are made. `make docs` runs it for the
pictures that are missing (`--missing`).
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "pictures"
SIZE = ["--size", "900x700"]

# picture -> words after `ddgcli`; files of sample_meshes/ and sample_scenes/ by their paths
COMMANDS: dict[str, list[str]] = {
    "curvature": ["curvature", "sample_meshes/frame.off"],
    "curve-flow": ["curve-flow", "sample_meshes/trefoil.obj", "--flow", "elastic", "--steps", "40"],
    "curvature-offset": ["curvature", "sample_meshes/cube.obj", "--offset", "0.4"],
    "geodesic": [
        *("geodesic", "sample_meshes/bad_torus.ply", "--source", "0"),
        *("--path-to", "800", "--isolines", "12"),
    ],
    "geodesic-darboux": [
        *("geodesic", "sample_meshes/torus.ply", "--source", "0", "--path-to", "2300", "--darboux"),
        *("--trace", "10:0.3,0.3,0.4:1,0.6,0.4:9"),
    ],
    "geodesic-waves": [
        *("geodesic", "sample_meshes/ellipsoid.ply", "--source", "0", "--fan", "180"),
        *("--fan-length", "5.2", "--view", "10,320"),
    ],
    "delaunay": ["delaunay", "sample_meshes/bad_torus.ply"],
    "laplacian-wave": [
        *("laplacian", "sample_meshes/frame.off", "--wave", "0", "--duration", "1.2", "--dt", "0.01"),
    ],
    "laplacian": ["laplacian", "sample_meshes/frame.off", "--hks", "0.1"],
    "hodge": ["hodge", "sample_meshes/frame.off"],
    "shell-cloth": ["shell-sim", "sample_scenes/cloth_on_mesh.toml"],
    "fluid-street": ["fluid-sim", "sample_scenes/karman_street.toml"],
    "fluid-jet": ["fluid-sim", "sample_scenes/jet_sphere.toml"],
    "shell-bulb": ["shell-sim", "sample_scenes/light_bulb.toml"],
    "tradeoff-maps": [
        *("tradeoff", "laplacian", "sample_meshes/saddle.obj", "--maps", "--norm", "mean", "--repeat", "3"),
    ],
    "tradeoff-pendulum": [
        *("tradeoff", "shell-sim", "pendulum", "--conserved", "energy", "--repeat", "1"),
        *("--budget", "100", "--duration", "20"),
    ],
    "willmore-flow": ["willmore-flow", "sample_meshes/ellipsoid.ply", "-o", "{folder}/round.vtkhdf"],
}


def command_line(name: str) -> str:
    """Call that makes a picture, as the page shows it."""
    words = [word.replace("{folder}/", "") for word in COMMANDS[name]]
    return " ".join(["ddgcli", *words, "--plot", f"{name}.png"])


def make_picture(name: str) -> None:
    """Run the command of a picture from the top folder; CalledProcessError if it fails."""
    folder = ROOT / "build" / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    words = [word.format(folder=folder) for word in COMMANDS[name]]
    call = [sys.executable, "-m", "ddgcli", *words, "--plot", str(PICTURES / f"{name}.png"), *SIZE, "-q"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run(call, cwd=ROOT, env=environment, check=True, stdout=subprocess.DEVNULL)


def main() -> None:
    """Make the named pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[*COMMANDS, []], help="pictures (default: all)")
    parser.add_argument("--missing", action="store_true", help="only pictures that do not exist")
    options = parser.parse_args()
    PICTURES.mkdir(exist_ok=True)
    for name in options.names or COMMANDS:
        if not (options.missing and (PICTURES / f"{name}.png").exists()):
            make_picture(name)
            print(f"docs/pictures/{name}.png")


if __name__ == "__main__":
    main()
