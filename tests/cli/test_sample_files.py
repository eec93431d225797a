"""Every sample mesh passes every mesh command that accepts it according to `info`, with default options."""

import json
from pathlib import Path

import pytest

SAMPLES = sorted(
    path
    for path in (Path(__file__).parents[2] / "sample_meshes").iterdir()
    if path.suffix in (".obj", ".off", ".ply", ".vtu", ".csv")
)
OPTIONS = {
    "curvature": [],
    "delaunay": [],
    "laplacian": [],
    "hodge": [],
    "geodesic": ["--source", 0],
    "willmore-flow": [],
}


def accepted(run, path):
    result = run("info", path, "--json")
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)["results"]["accepts"]


@pytest.mark.parametrize("path", SAMPLES, ids=lambda path: path.name)
def test_every_sample_succeeds_where_info_accepts_it(run, path):
    accepts = accepted(run, path)
    assert set(OPTIONS) <= set(accepts)
    for command, options in OPTIONS.items():
        result = run(command, path, *options, "--json")
        if accepts[command] is not True and accepts[command] != "yes":
            assert result.exit_code == 2, f"{command} {path.name}: info reports {accepts[command]}"
            continue
        assert result.exit_code == 0, f"{command} {path.name}: {result.stderr}"
        results = json.loads(result.stdout)["results"]
        assert results.get("converged", True)
        if command == "willmore-flow":
            assert min(results["energy"]) >= 0, path.name
