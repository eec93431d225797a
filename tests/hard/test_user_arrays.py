"""Arrays of the user: one wording names the first bad element, whichever command reads them."""

import re

import numpy as np
import pytest

from ddgcli.algorithms.curvature.surface_curvature import check_curvature
from ddgcli.algorithms.delaunay.transfer import check_transferable
from ddgcli.algorithms.hodge.decomposition import decompose_cell_vectors, decompose_form
from ddgcli.algorithms.laplacian.evolution import checked_start
from ddgcli.algorithms.laplacian.poisson import checked_source
from ddgcli.algorithms.tangent_fields.tangent_field import checked_field
from ddgcli.errors import ParameterError
from ddgcli.mesh import shapes
from ddgcli.operators.dec import complex_of
from ddgcli.operators.form_products import cell_vectors, form_values

MESH = shapes.icosphere(1)
N, M, E = MESH.n_vertices, MESH.n_faces, MESH.topology.n_edges
READERS = {
    "poisson": ((N,), lambda a: checked_source(a, N)),
    "poisson of several": ((N, 4), lambda a: checked_source(a, N)),
    "heat": ((N,), lambda a: checked_start(a, N)),
    "form": ((E,), lambda a: decompose_form(MESH, a)),
    "field": ((M, 3), lambda a: decompose_cell_vectors(MESH, a)),
    "product of forms": ((E,), lambda a: form_values(complex_of(MESH), a)),
    "product with a field": ((N, 3), lambda a: cell_vectors(complex_of(MESH), a)),
    "integral curves": ((M, 3), lambda a: checked_field(MESH, a)),
    "transfer": ((N, 2), lambda a: check_transferable({"a": a}, ())),
    "map": ((N, 2), lambda a: check_curvature(MESH, "quadric", image=a)),
}


@pytest.mark.parametrize("reader", READERS)
def test_the_first_element_that_is_not_finite_is_named(reader):
    shape, read = READERS[reader]
    array = np.ones(shape)
    array[2], array[5] = np.nan, np.inf
    with pytest.raises(ParameterError, match=r"not finite at \w+ 2 \(2 such values\); correct the array$"):
        read(array)


@pytest.mark.parametrize("reader", ["poisson", "heat", "form", "field", "map"])
@pytest.mark.parametrize("shape", [(), (3,), (3, 3)])
def test_arrays_of_another_shape_are_refused_with_the_number_of_elements(reader, shape):
    message = re.escape(f"an array of shape {shape}; use ")
    with pytest.raises(ParameterError, match=message + r".* for each of \d+ "):
        READERS[reader][1](np.zeros(shape))
