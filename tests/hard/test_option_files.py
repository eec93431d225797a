"""Every hard file through the options of the notes' later chapters: an answer or one line, never NaN."""

import contextlib

import numpy as np
import pytest

from ddgcli.errors import InputError
from ddgcli.io.mesh_file import read_mesh
from tests.hard import test_hard_files
from tests.hard.test_hard_files import assert_honest, hard_files

# V and W are vertices of faces, EDGES a file with sides of faces, OUT a folder, SIZE and AREA fit the mesh
CALLS = (
    "curve-flow --steps 2",
    "curve-flow --steps 2 --flow elastic",
    "curvature --region 0,0,0:SIZE --vertex-vectors",
    "curvature --offset SIZE",
    "geodesic --source V --fan 7 --fan-length SIZE",
    "geodesic --source-boundary",
    "geodesic --source-edges EDGES",
    "geodesic --signed-distance EDGES",
    "geodesic --source V --target W --distance-matrix OUT/matrix.npz",
    "geodesic --source V --voronoi --vertex-types",
    "dec",
    "hodge --basis",
    "delaunay --dual OUT/dual.npz",
    "delaunay --overlay OUT/overlay.npz",
    "laplacian --parameterize discrete-conformal",
    "laplacian --form-eigen 2",
    "laplacian --heat V --duration AREA --frames 2",
    "laplacian --wave V --duration SIZE --dt SIZE",
)
# within `ulimit -v` of the table these are refused; without it they take minutes and some GiB
TOO_LARGE = test_hard_files.TOO_LARGE | {("laplacian --form-eigen 2", "gen_fan_high_valence.ply")}
# of every run: faces without area, one side, edges of three faces, tetrahedra that touch
QUICK = ("gen_zero_area.off", "moebius.obj", "gen_book_edge.ply", "gen_tet_edge_contact.msh")
SECONDS = 600  # of all calls on one file, on a busy machine


def quick_or_slow():
    quick = (*QUICK, "missing")
    return [
        path if getattr(path, "name", "missing") in quick else pytest.param(path, marks=pytest.mark.slow)
        for path in hard_files()
    ]


@pytest.mark.timeout(SECONDS)
@pytest.mark.parametrize("path", quick_or_slow(), ids=lambda p: getattr(p, "name", "missing"))
def test_a_hard_file_has_a_finite_result_or_one_error_line_with_every_option(
    run, tmp_path, monkeypatch, path
):
    monkeypatch.chdir(tmp_path)
    faces, size = np.zeros((1, 3), dtype=np.int64), 1.0
    with contextlib.suppress(InputError):  # the commands themselves report it
        read = read_mesh(str(path))
        faces = read.surface.faces if read.kind != "curve" else faces
        size = float(np.ptp(read.mesh.points, axis=0).max()) if len(read.mesh.points) else size
    first, last = (faces[0], faces[-1]) if len(faces) else (np.arange(3), np.arange(3))
    np.save(tmp_path / "edges.npy", np.array([first[:2], first[1:], last[:2]]))
    words = {"V": str(first[0]), "W": str(last[2]), "EDGES": "edges.npy"}
    words |= {"SIZE": f"{size or 1.0:.17g}", "AREA": f"{min(size * size, 1e300) or 1.0:.17g}"}
    output, failures = tmp_path / "out.npz", []
    for call in CALLS:
        command, *options = call.split()
        if TOO_LARGE & {(command, path.name), (call, path.name)}:
            continue
        options = [words.get(word, word.replace("OUT", str(tmp_path))) for word in options]
        options = [word.replace("SIZE", words["SIZE"]) for word in options]
        output.unlink(missing_ok=True)
        result = run(command, path, *options, "-o", output, "--json")
        if result.exit_code == 1 and not result.stdout:  # a solver that failed: one line, no output
            if not result.stderr.startswith("Error: ") or result.stderr.count("\n") != 1 or output.exists():
                failures.append(f"{call}: {result.stderr}")
            continue
        try:
            assert_honest(result, path, output)
        except (AssertionError, pytest.fail.Exception) as failure:
            failures.append(f"{call}: {result.stderr or failure}")
    assert not failures, "\n".join(failures)
