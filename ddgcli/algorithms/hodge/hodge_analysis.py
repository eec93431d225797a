"""Topology of a mesh and Hodge decomposition of a field on it, with the accuracy of the decomposition."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.hodge.decomposition import (
    HodgeDecomposition,
    decompose_cell_vectors,
    decompose_form,
    decompose_vertex_vectors,
    tangent_part,
    to_vertices,
)
from ddgcli.algorithms.hodge.harmonic import HarmonicBasis, harmonic_basis
from ddgcli.algorithms.hodge.homology import Boundary, betti_numbers, generator_loops
from ddgcli.algorithms.hodge.solid_decomposition import component_indices, joined_decomposition
from ddgcli.algorithms.hodge.solid_homology import solid_generator_loops
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.remedies import remedy_for_bad_shapes, warn_of_pieces, warn_of_solid
from ddgcli.linalg.residual_gate import within_residuals
from ddgcli.mesh.fields import AnnotatedMesh, finite_values
from ddgcli.mesh.require import refuse_flat_faces, require
from ddgcli.mesh.require_solid import require_manifold_body
from ddgcli.mesh.requirements import require_sized_cells
from ddgcli.mesh.solid_components import solid_components
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.dec import complex_of
from ddgcli.operators.whitney import sharp
from ddgcli.progress import ProgressCallback

log = logging.getLogger("ddgcli")
SpaceMesh = TriangleMesh | TetMesh


@dataclass(frozen=True, eq=False)
class HodgeAnalysis:
    """Annotated mesh, results and accuracy, the vectors of the field (or None), and whether it converged."""

    annotated: AnnotatedMesh
    results: dict[str, Any]
    accuracy: dict[str, Any]
    vectors: NDArray | None
    converged: bool


def hodge_analysis(
    mesh: SpaceMesh,
    field: tuple[NDArray, str] | None,
    boundary: Boundary,
    with_basis: bool,
    progress: ProgressCallback = lambda completed, total: None,
) -> HodgeAnalysis:
    """Decompose a field, with the Betti numbers, homology generators and harmonic basis of the mesh.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    field : (ndarray, str), optional
        Array and its place; see `field_place`.
    boundary : {'tangential', 'normal'}
        Boundary condition of harmonic fields.
    with_basis : bool
        Also compute an orthonormal harmonic basis.
    progress : callable
        Called with (parts done, parts): homology, basis and decomposition.

    Returns
    -------
    HodgeAnalysis

    Raises
    ------
    MeshError
        For a mesh that is not manifold, or orientable but not oriented.
    ParameterError
        For a field that fits neither vertices, cells nor edges, or whose parts are beyond 1e308.
    """
    place = check_query(mesh, field, with_basis)
    progress(0, 3)
    betti, modulo_2 = betti_numbers(mesh), betti_numbers(mesh, modulo_2=True)
    generators = [loop.tolist() for loop in _generators(mesh)]
    progress(1, 3)
    basis = harmonic_basis(mesh, boundary) if with_basis else None
    progress(2, 3)
    split = _decomposed(mesh, field[0], place, boundary) if field is not None else None
    arrays = _arrays(mesh, split, basis, place)
    harmonic_fields = betti.of_boundary(boundary)[1]
    results = {
        "betti_numbers": {"absolute": list(betti.absolute), "relative": list(betti.relative)},
        "betti_numbers_modulo_2": {"absolute": list(modulo_2.absolute), "relative": list(modulo_2.relative)},
        "boundary": boundary,
        "field_on": place or None,
        "norms": split.norms if split else None,
        "generators": generators,
    }
    accuracy = {
        "orthogonality": split.orthogonality if split else None,
        "reconstruction_residual": split.reconstruction_residual if split else None,
        "harmonic_residual": _harmonic_residual(split, basis) if harmonic_fields else None,
    }
    # averaging from vertices to cells and back belongs to the method: its loss is not a solver error
    exact = ("orthogonality", "harmonic_residual") + (
        () if place == "vertex" else ("reconstruction_residual",)
    )
    converged = within_residuals(accuracy, exact, partial(remedy_for_bad_shapes, mesh))
    vectors = field[0] if field is not None and place in ("vertex", "cell") else None
    return HodgeAnalysis(AnnotatedMesh(mesh, **arrays), results, accuracy, vectors, converged)


def check_query(mesh: SpaceMesh, field: tuple[NDArray, str] | None, with_basis: bool) -> str:
    """Place of the results of `hodge_analysis`; raises its errors, before it computes.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    field : (ndarray, str), optional
        Array and its place.
    with_basis : bool

    Returns
    -------
    str
        `edge`, `cell` or `vertex`; empty without results.
    """
    check_mesh(mesh)
    if isinstance(mesh, TriangleMesh) and (with_basis or field is not None):
        refuse_flat_faces(mesh.flat_faces, mesh.topology, manifold=True)
    if field is None:
        return "edge" if with_basis else ""
    place = field_place(mesh, *field)
    finite_values(field[0], place, parameter="field")
    return place


def array_names(mesh: SpaceMesh, place: str, n_basis_fields: int, *, has_field: bool) -> dict[str, list[str]]:
    """Names of the vertex and the face arrays of `hodge_analysis`.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    place : str
        As returned by `check_query`.
    n_basis_fields : int
    has_field : bool

    Returns
    -------
    dict
        Lists of names under `vertex` and `face`.
    """
    names: dict[str, list[str]] = {"vertex": [], "face": []}
    of_form = names.get({"cell": "face"}.get(place, place), [])
    if has_field:
        of_form += ["exact", "coexact", "harmonic"]
        names["vertex"].append("potential")
        if place == "edge" and isinstance(mesh, TriangleMesh):
            names["face"].append("copotential")
    of_form += [f"harmonic_{number:03d}" for number in range(n_basis_fields)]
    return names


def check_mesh(mesh: SpaceMesh) -> None:
    """Raise an error for non-manifold meshes, and for orientable components that are not oriented.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh

    Raises
    ------
    MeshError
    """
    if isinstance(mesh, TetMesh):
        if len(mesh.tetrahedra) == 0:
            raise MeshError("no tetrahedra; hodge needs a surface or a mesh of tetrahedra")
        require_sized_cells(mesh, "hodge")
        require_manifold_body(mesh, "hodge")
        require(mesh.boundary, "hodge (the boundary of the tetrahedra)")
        warn_of_solid(mesh)
        return
    if not isinstance(mesh, TriangleMesh):
        raise MeshError("curves have no Hodge decomposition; give a surface or a mesh of tetrahedra")
    require(mesh, "hodge", manifold=True, oriented=True, one_sided=True)
    warn_of_pieces(mesh)
    topology = mesh.topology
    if topology.one_sided_face.any():
        bounded = topology.face_component[topology.boundary_vertex[mesh.faces].any(axis=1)]
        is_closed = ~np.isin(topology.face_component, bounded)
        has_torsion = (topology.one_sided_face & is_closed).any()
        log.warning(
            "the surface is one-sided (not orientable): the sign of copotentials depends on the orientation "
            "of the faces%s",
            ", and some generators have finite order" if has_torsion else "",
        )


def field_place(mesh: SpaceMesh, array: NDArray, place: str) -> str:
    """Place of a field; inferred from its shape if unknown.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    array : ndarray
        (k, 3) vectors on vertices or cells, or (e,) numbers on edges.
    place : str
        Its place, if known; else empty.

    Returns
    -------
    {'vertex', 'cell', 'edge'}

    Raises
    ------
    ParameterError
        When the shape fits none, or two.
    """
    complex_ = complex_of(mesh)
    counts = {"vertex": complex_.counts[0], "cell": len(complex_.corners), "edge": complex_.counts[1]}
    vectors = array.ndim == 2 and array.shape[1] == 3
    fits = [p for p in (("vertex", "cell") if vectors else ("edge",)) if array.shape[:1] == (counts[p],)]
    place_or_cell = {"face": "cell"}.get(place, place)
    if place_or_cell in fits:
        return place_or_cell
    if len(fits) == 1 and not place and array.ndim <= 2:
        return fits[0]
    if len(fits) == 2 and not place:
        raise ParameterError(
            f"{len(array)} vectors fit vertices and cells alike; store them as an array of the mesh file, "
            "which states the place (in Python, place='vertex')",
            parameter="field",
        )
    raise ParameterError(
        f"an array of shape {array.shape}; use vectors on {counts['vertex']} vertices or "
        f"{counts['cell']} cells, or numbers on {counts['edge']} edges",
        parameter="field",
    )


def _decomposed(mesh: SpaceMesh, array: NDArray, place: str, boundary: Boundary) -> HodgeDecomposition:
    """Decomposition of a field; of a solid by components: an iteration over all stops by the largest."""
    array = finite_values(array, place, parameter="field")
    if not isinstance(mesh, TetMesh):
        return _decomposed_in_range(mesh, array, place, boundary)
    components = solid_components(mesh)
    splits = [
        _decomposed_in_range(component.mesh, array[component_indices(component, place)], place, boundary)
        for component in components
    ]
    split = joined_decomposition(mesh, components, splits, place)
    _check_range(np.array(list(split.norms.values())))
    return split


def _decomposed_in_range(
    mesh: SpaceMesh, array: NDArray, place: str, boundary: Boundary
) -> HodgeDecomposition:
    """Decomposition of a field, scaled to a size of about 1 so that squares do not over- or underflow."""
    exponent = int(np.frexp(np.abs(array).max(initial=0.0))[1])
    split = _decomposed_at_unit_size(mesh, np.ldexp(array, -exponent), place, boundary)

    def scaled(values: NDArray) -> NDArray[np.float64]:
        with np.errstate(over="ignore"):
            result = np.ldexp(values, exponent)
        _check_range(result)
        return result

    copotential = split.copotential
    return replace(
        split, exact=scaled(split.exact), coexact=scaled(split.coexact), harmonic=scaled(split.harmonic),
        potential=scaled(split.potential), copotential=None if copotential is None else scaled(copotential),
        norms={name: float(scaled(np.array(norm))) for name, norm in split.norms.items()},
    )  # fmt: skip


def _check_range(values: NDArray) -> None:
    if not np.isfinite(values).all():
        raise ParameterError("its parts or their norms are beyond 1e308; rescale it", parameter="field")


def _decomposed_at_unit_size(
    mesh: SpaceMesh, array: NDArray, place: str, boundary: Boundary
) -> HodgeDecomposition:
    if place == "edge":
        return decompose_form(mesh, array, boundary)
    if place == "vertex":
        return decompose_vertex_vectors(mesh, array, boundary)
    if isinstance(mesh, TriangleMesh):
        _, removed = tangent_part(mesh, array)
        if removed > 1e-6:
            log.warning("the field has normal components of up to %.2g of its size: only its tangent part "
                        "is decomposed", removed)  # fmt: skip
    return decompose_cell_vectors(mesh, array, boundary)


def _harmonic_residual(split: HodgeDecomposition | None, basis: HarmonicBasis | None) -> float | None:
    return split.harmonic_residual if split else basis.residual if basis else None


def _arrays(
    mesh: SpaceMesh, split: HodgeDecomposition | None, basis: HarmonicBasis | None, place: str
) -> dict[str, dict[str, NDArray]]:
    out: dict[str, dict[str, NDArray]] = {"vertex": {}, "face": {}, "edge": {}}
    kind = {"vertex": "vertex", "cell": "face", "edge": "edge"}.get(place, "edge")
    if split is not None:
        out[kind] |= {"exact": split.exact, "coexact": split.coexact, "harmonic": split.harmonic}
        out["vertex"]["potential"] = split.potential
        if split.copotential is not None:
            on_cells = place == "edge" and isinstance(mesh, TriangleMesh)
            if on_cells or isinstance(mesh, TriangleMesh):
                out["face" if on_cells else "edge"]["copotential"] = split.copotential
            else:
                log.info("no copotential is written for tetrahedra: files have no arrays on interior faces")
    for number, form in enumerate(basis.forms if basis else ()):
        out[kind][f"harmonic_{number:03d}"] = _in_form_of(mesh, form, place)
    if out["edge"]:
        out["edge"]["edges"] = complex_of(mesh).edges
    return out


def _in_form_of(mesh: SpaceMesh, form: NDArray, place: str) -> NDArray[np.float64]:
    if place == "edge":
        return form
    vectors = sharp(mesh, form)
    return to_vertices(mesh, vectors) if place == "vertex" else vectors


def _generators(mesh: SpaceMesh) -> list[NDArray]:
    return solid_generator_loops(mesh) if isinstance(mesh, TetMesh) else generator_loops(mesh)
