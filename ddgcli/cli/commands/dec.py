"""`ddgcli dec`."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ddgcli.choices import HODGE_STARS
from ddgcli.cli import options
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run
from ddgcli.errors import OutputError

if TYPE_CHECKING:
    from ddgcli.operators.dec_matrices import DecMatrices


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
@options.common
def command(mesh_path: str, common: CommonOptions, star: Any, mtx: str | None) -> None:
    """Write the operators of discrete exterior calculus on MESH, a surface or tetrahedra.

    d0, d1 (d2): exterior derivatives, integer. star0, star1, star2 (star3): Hodge stars. codifferential1 ...:
    k-forms to (k-1)-forms, star^-1 d' star. laplacian0 ...: symmetric, star (d delta + delta d); laplacian0
    is the cotangent matrix of a surface.

    OPERATORS.npz holds each matrix in CSR parts NAME_data, NAME_indices, NAME_indptr, NAME_shape, and the
    numbering: points, edges (tail, head), faces, tetrahedra. A k-form is one number on each k-simplex, the
    integral over it in its orientation.

    \b
    Examples:
      ddgcli dec torus.ply -o operators.npz
      ddgcli dec ball.vtu --star galerkin --mtx matrices
    """
    run = Run("dec", common, formats=(".npz",), star=star, mtx=mtx)
    source = run.read(mesh_path, accept=("surface", "tetrahedra"))
    from ddgcli.mesh.require import require
    from ddgcli.mesh.tet_mesh import TetMesh
    from ddgcli.operators.dec import complex_of
    from ddgcli.operators.dec_matrices import dec_matrices

    mesh = source.mesh if isinstance(source.mesh, TetMesh) else source.surface
    if not isinstance(mesh, TetMesh):
        require(mesh, "dec", manifold=True, oriented=True)
    operators = dec_matrices(complex_of(mesh), star)
    content = npz_content(operators, mesh.points) if common.outputs else b""
    for path in common.outputs:
        run.write_bytes(path, content)
    if mtx is not None:
        write_matrix_market(run, Path(mtx), operators)
    matrices = operators.matrices
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
    }
    run.finish(results, accuracy)


def npz_content(operators: DecMatrices, points: Any) -> bytes:
    """NumPy archive of all matrices in CSR parts, with the numbering of the simplices."""
    import numpy as np

    complex_ = operators.complex_
    arrays: dict[str, Any] = {"points": points, "edges": complex_.edges, "faces": complex_.faces}
    if complex_.dimension == 3:
        arrays["tetrahedra"] = complex_.corners
    for name, matrix in operators.matrices.items():
        arrays |= {f"{name}_data": matrix.data, f"{name}_indices": matrix.indices}
        arrays |= {f"{name}_indptr": matrix.indptr, f"{name}_shape": np.array(matrix.shape)}
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def write_matrix_market(run: Run, folder: Path, operators: DecMatrices) -> None:
    """Every matrix as FOLDER/NAME.mtx."""
    from ddgcli.io.matrix_file import matrix_bytes

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: {error.strerror}; name another folder") from error
    for name, matrix in operators.matrices.items():
        path = str(folder / f"{name}.mtx")
        symmetric = name.startswith(("star", "laplacian"))
        run.write_bytes(path, matrix_bytes(path, matrix, run.command_line, symmetric=symmetric))
