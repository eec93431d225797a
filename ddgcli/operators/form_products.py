"""Wedge, interior product and Lie derivative of forms on a surface, with the identities that they keep."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import ParameterError
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.dec import complex_of
from ddgcli.operators.whitney import degree_of, interior_product, lie_derivative, wedge

PLACES = ("vertex", "edge", "face")  # of the simplices that carry forms of degree 0, 1, 2


@dataclass(frozen=True, eq=False)
class FormProducts:
    """Forms by name, each on its simplices, and relative residuals of exact identities.

    Parameters
    ----------
    degree : dict of str to int
    vertex, edge, face : dict of str to ndarray
    accuracy : dict of str to float
        `leibniz_residual`: d (a ^ b) - da ^ b -+ a ^ db, of two functions or a function and a 1-form.
        `lie_commutation_residual`: d L_X a - L_X d a.
    """

    degree: dict[str, int] = field(default_factory=dict)
    vertex: dict[str, NDArray] = field(default_factory=dict)
    edge: dict[str, NDArray] = field(default_factory=dict)
    face: dict[str, NDArray] = field(default_factory=dict)
    accuracy: dict[str, float] = field(default_factory=dict)

    def add(self, name: str, degree: int, form: NDArray) -> None:
        """Put a form on the simplices of its degree."""
        self.degree[name] = degree
        getattr(self, PLACES[degree])[name] = form


def form_products(mesh: TriangleMesh, pairs: Mapping[str, tuple[NDArray, NDArray] | None]) -> FormProducts:
    """Products of forms and vector fields.

    Parameters
    ----------
    mesh : TriangleMesh
        An oriented manifold.
    pairs : mapping of {'wedge', 'interior_product', 'lie_derivative'} to two arrays, or None
        Two forms; or a field, (n, 3) or (m, 3), and a form. The length of a form is that of the vertices,
        edges or faces. Absent and None products are left out.

    Raises
    ------
    ParameterError
        For arrays that are no forms or fields of the mesh, or products that are zero by their degrees.
    """
    complex_ = complex_of(mesh)
    d = [*complex_.derivatives, None]
    out = FormProducts()
    for name, pair in pairs.items():
        if pair is None:
            continue
        try:
            form = _form(mesh, pair[1])
            degree = degree_of(complex_, form)
            if name == "wedge":
                first = _form(mesh, pair[0])
                p = degree_of(complex_, first)
                if p + degree > 2:
                    raise ParameterError(f"a {p}-form and a {degree}-form have no wedge on a surface")
                product = wedge(complex_, first, form)
                out.add(name, p + degree, product)
                if p + degree < 2:
                    terms = [
                        wedge(complex_, d[p] @ first, form),
                        (-1.0) ** p * wedge(complex_, first, d[degree] @ form),
                    ]
                    out.accuracy["leibniz_residual"] = _relative(d[p + degree] @ product - sum(terms), *terms)
                continue
            vectors = _cell_vectors(mesh, pair[0])
            if name == "interior_product":
                if degree == 0:
                    raise ParameterError("a 0-form has no interior product; name values on edges or faces")
                out.add(name, degree - 1, interior_product(mesh, vectors, form))
                continue
            derivative = lie_derivative(mesh, vectors, form)
            out.add(name, degree, derivative)
            if degree < 2:
                after, before = d[degree] @ derivative, lie_derivative(mesh, vectors, d[degree] @ form)
                out.accuracy["lie_commutation_residual"] = _relative(
                    after - before, after, before, derivative
                )
        except ParameterError as error:
            raise ParameterError(str(error), parameter=name) from error
    return out


def _form(mesh: TriangleMesh, array: NDArray) -> NDArray[np.float64]:
    values = np.asarray(array, dtype=np.float64)
    if values.ndim != 1:
        raise ParameterError(
            f"an array of shape {values.shape} is no form; name numbers on vertices, edges or faces"
        )
    if not np.isfinite(values).all():
        raise ParameterError(f"the form is not finite at element {int(np.argmin(np.isfinite(values)))}")
    return values


def _cell_vectors(mesh: TriangleMesh, array: NDArray) -> NDArray[np.float64]:
    """(m, 3) vectors on faces; those on vertices are averaged over the corners."""
    vectors = np.asarray(array, dtype=np.float64)
    if vectors.shape == (mesh.n_faces, 3):
        return vectors
    if vectors.shape == (mesh.n_vertices, 3):
        return vectors[mesh.faces].mean(axis=1)
    raise ParameterError(
        f"an array of shape {vectors.shape} is no field; name vectors on the {mesh.n_vertices} vertices or "
        f"{mesh.n_faces} faces"
    )


def _relative(difference: NDArray, *terms: NDArray) -> float:
    size = max(float(np.abs(term).max(initial=0.0)) for term in terms)
    return float(np.abs(difference).max(initial=0.0) / (size or 1.0))
