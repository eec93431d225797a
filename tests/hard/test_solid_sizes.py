"""Solids of any size have the same results unless their volumes over- or underflow; those are refused."""

import numpy as np
import pytest

from ddgcli.algorithms.hodge.hodge_analysis import hodge_analysis
from ddgcli.algorithms.laplacian.form_spectrum import form_spectrum
from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.algorithms.laplacian.spectrum import spectrum
from ddgcli.errors import MeshError
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.operators.dec import complex_of
from ddgcli.operators.stars import hodge_star
from tests.exact.test_homology import ring_tets

RING = ring_tets()
BEYOND = [2.0**k for k in (-400, -355, 345, 400)]  # 1e-120, 1e-107, 1e104, 1e120


@pytest.mark.parametrize("size", [2.0**-305, 2.0**305])  # 1e92, an exact factor
def test_results_scale_with_the_size(size):
    mesh = RING.moved(size * RING.points)
    values, truth = (form_spectrum(m, 5).pairs.values for m in (mesh, RING))
    assert values * size * size == pytest.approx(truth, rel=1e-9)
    values, truth = (spectrum(laplace_operator(m, "cotan"), 5).values for m in (mesh, RING))
    assert values * size * size == pytest.approx(truth, rel=1e-9)
    field = np.random.default_rng(0).normal(size=(len(RING.tetrahedra), 3))
    scaled, unit = (hodge_analysis(m, (field, "cell"), "tangential", False) for m in (mesh, RING))
    for name in ("exact", "coexact", "harmonic"):
        assert scaled.annotated.face[name] == pytest.approx(unit.annotated.face[name], abs=1e-9)
    for degree in range(4):
        star, truth = (hodge_star(complex_of(m), degree).data for m in (mesh, RING))
        power = size ** (3 - 2 * degree) if degree < 3 else size**-3.0
        assert star / power == pytest.approx(truth, rel=1e-12)


@pytest.mark.parametrize("size", BEYOND)
def test_volumes_beyond_the_range_of_numbers_are_refused(size):
    mesh = RING.moved(size * RING.points)
    field = np.ones(len(RING.edges))
    for use in (
        lambda: hodge_analysis(mesh, (field, "edge"), "normal", False),
        lambda: form_spectrum(mesh, 3),
        lambda: laplace_operator(mesh, "cotan"),
        lambda: complex_of(mesh),
    ):
        with pytest.raises(MeshError, match="the size of the solid, .* if cubed; rescale the mesh"):
            use()


@pytest.mark.parametrize("size", [2.0**-400, 2.0**345])
@pytest.mark.parametrize(
    "command", [["hodge"], ["laplacian", "--eigen", 3], ["laplacian", "--form-eigen", 3]]
)
def test_commands_refuse_such_a_solid_in_one_line(command, size, run, tmp_path):
    path = tmp_path / "ring.vtu"
    write_mesh(str(path), AnnotatedMesh(RING.moved(size * RING.points)))
    result = run(command[0], path, *command[1:])
    assert result.exit_code == 2 and result.stderr.count("\n") == 1
    assert "the size of the solid" in result.stderr and "rescale the mesh" in result.stderr
