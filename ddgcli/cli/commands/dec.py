"""`ddgcli dec`."""

from __future__ import annotations

from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import click

from ddgcli.choices import HODGE_STARS
from ddgcli.cli import options
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run
from ddgcli.errors import ParameterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.io.mesh_file import MeshInput
    from ddgcli.mesh.tet_mesh import TetMesh
    from ddgcli.mesh.triangle_mesh import TriangleMesh
    from ddgcli.operators.dec_matrices import DecMatrices
    from ddgcli.operators.form_products import FormProducts

FORM_FORMATS = (".npz", ".vtkhdf", ".vtu", ".vtp", ".ply", ".vtk", ".xdmf")


@click.command("dec", short_help="Operators of discrete exterior calculus as sparse matrices.")
@options.mesh_arg
@click.option(
    "--star",
    type=click.Choice(HODGE_STARS),
    default=HODGE_STARS[0],
    show_default=True,
    help="Hodge star: mass matrices of Whitney forms, or dual cells at circumcentres or barycentres.",
)
@click.option("--mtx", metavar="FOLDER", help="Write every matrix as FOLDER/NAME.mtx (Matrix Market) too.")
@click.option("--wedge", nargs=2, metavar="FORM FORM", help="Wedge of two forms among the arrays of MESH.")
@click.option(
    "--interior-product", nargs=2, metavar="FIELD FORM", help="Interior product of vectors and a form."
)
@click.option(
    "--lie-derivative", nargs=2, metavar="FIELD FORM", help="Lie derivative of a form along vectors."
)
@click.option("--forms", metavar="PATH", help="Mesh with the arrays of these three.")
@options.common_without_pictures
def command(
    mesh_path: str, common: CommonOptions, star: Any, mtx: str | None, forms: str | None, **products: Any
) -> None:
    """Write the operators of discrete exterior calculus on MESH, a surface or tetrahedra.

    d0, d1 (d2): exterior derivatives, integer. star0, star1, star2 (star3): Hodge stars. codifferential1 ...:
    k-forms to (k-1)-forms, D^-1 d' star with D a diagonal star. laplacian0 ...: symmetric, star d delta +
    d' star d; laplacian0 is the cotangent matrix of a surface.

    OPERATORS.npz holds each matrix in CSR parts NAME_data, NAME_indices, NAME_indptr, NAME_shape, and the
    numbering: points, edges (tail, head), faces, tetrahedra. A k-form is one number on each k-simplex, the
    integral over it in its orientation.

    \b
    Examples:
      ddgcli dec torus.ply -o operators.npz
      ddgcli dec ball.vtu --star galerkin --mtx matrices
      ddgcli dec torus.vtu --lie-derivative wind temperature --forms advected.vtu
    """
    run = Run("dec", common, formats=(".npz",), star=star, mtx=mtx, forms=forms, **products)
    run.plan_output(forms, FORM_FORMATS)
    run.plan_folder(mtx)
    if forms is not None and not any(products.values()):
        raise ParameterError(
            "holds `wedge`, `interior_product` and `lie_derivative`; add one of them", parameter="forms"
        )
    source = run.read(mesh_path, accept=("surface", "tetrahedra"))
    forms_of_input = {name: forms_of(source, pair) for name, pair in products.items() if pair}
    from ddgcli.mesh.require import require
    from ddgcli.mesh.tet_mesh import TetMesh
    from ddgcli.operators.dec import complex_of
    from ddgcli.operators.dec_matrices import check_star, dec_matrices
    from ddgcli.operators.form_products import check_products
    from ddgcli.operators.star_errors import star_errors, warn_of_star_errors

    mesh = source.mesh if isinstance(source.mesh, TetMesh) else source.surface
    if not isinstance(mesh, TetMesh):
        require(mesh, "dec", manifold=True, oriented=True)
    if forms_of_input:
        check_products(mesh, forms_of_input)
    check_star(mesh, star)
    run.begin()
    computed = products_of(run, mesh, forms_of_input, forms) if forms_of_input else None
    operators = dec_matrices(complex_of(mesh), star)
    matrices = operators.matrices
    errors = star_errors(operators.complex_, mesh.points, star)
    warn_of_star_errors(errors, star, operators.complex_.dimension)
    results = {
        "star": star,
        "simplices": list(operators.complex_.counts),
        "nonzeros": {name: int(matrix.nnz) for name, matrix in matrices.items()},
        "negative_star_entries": operators.negative_entries,
    }
    accuracy = {
        "derivative_residual": operators.derivative_residual(),
        "symmetry_residual": operators.symmetry_residual(),
        "constant_residual": operators.constant_residual(),
        **{f"star{degree}_error": error for degree, error in errors.items()},
    }
    for path in common.outputs:
        run.write_bytes(path, lambda file: write_archive(file, operators, mesh.points))
    if mtx is not None:
        write_matrix_market(run, Path(mtx), operators)
    if computed is not None:
        results["forms"], accuracy = computed.degree, accuracy | computed.accuracy
    run.finish(results, accuracy)


def forms_of(source: MeshInput, names: tuple[str, str]) -> tuple[NDArray, NDArray]:
    """Two forms, or a field and a form, among the arrays of the input."""
    from ddgcli.io.arrays import input_form

    return input_form(source, names[0]), input_form(source, names[1])


def products_of(
    run: Run,
    mesh: TriangleMesh | TetMesh,
    arrays: dict[str, tuple[NDArray, NDArray]],
    path: str | None,
) -> FormProducts:
    """Products of arrays of the input, written to a mesh."""
    from ddgcli.mesh.fields import AnnotatedMesh
    from ddgcli.mesh.tet_mesh import TetMesh
    from ddgcli.operators.form_products import form_products

    computed = form_products(mesh, arrays)
    if path is None:
        return computed
    edge, whole = dict(computed.edge), dict(computed.triangle)
    if edge:
        edge["edges"] = mesh.edges if isinstance(mesh, TetMesh) else mesh.topology.edges
    if whole and isinstance(mesh, TetMesh):
        whole["triangles"] = mesh.triangles
    run.write_file(
        path, AnnotatedMesh(mesh, vertex=computed.vertex, edge=edge, face=computed.face, whole=whole)
    )
    return computed


def write_archive(file: IO[bytes], operators: DecMatrices, points: Any) -> None:
    """Write the NumPy archive of all matrices in CSR parts, with the numbering of the simplices."""
    import numpy as np

    complex_ = operators.complex_
    arrays: dict[str, Any] = {"points": points, "edges": complex_.edges, "faces": complex_.faces}
    if complex_.dimension == 3:
        arrays["tetrahedra"] = complex_.corners
    for name, matrix in operators.matrices.items():
        arrays |= {f"{name}_data": matrix.data, f"{name}_indices": matrix.indices}
        arrays |= {f"{name}_indptr": matrix.indptr, f"{name}_shape": np.array(matrix.shape)}
    np.savez(file, **arrays)


def write_matrix_market(run: Run, folder: Path, operators: DecMatrices) -> None:
    """Every matrix as FOLDER/NAME.mtx."""
    from ddgcli.io.matrix_file import matrix_bytes

    run.make_folder(folder)
    for name, matrix in operators.matrices.items():
        path = str(folder / f"{name}.mtx")
        symmetric = name.startswith(("star", "laplacian"))
        run.write_bytes(path, matrix_bytes(path, matrix, run.command_line, symmetric=symmetric))
