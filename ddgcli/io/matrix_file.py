"""Write sparse matrices in formats of scipy and Matrix Market."""

from __future__ import annotations

import io
from pathlib import Path

from scipy.sparse import coo_array, csr_array, sparray

MATRIX_FORMATS = (".npz", ".mtx")


def matrix_bytes(path: str, matrix: sparray, comment: str = "", *, symmetric: bool = True) -> bytes:
    """Content of a matrix file: `.npz` for `scipy.sparse.load_npz` (CSR), or `.mtx` (Matrix Market).

    Integer matrices stay integer in `.mtx`.

    Parameters
    ----------
    path : str
        Its extension chooses the format; nothing is written.
    matrix : sparse array
    comment : str
        Of the `.mtx` file.
    symmetric : bool
        The matrix is symmetric: `.mtx` holds one triangle of the entries.

    Returns
    -------
    bytes
    """
    buffer = io.BytesIO()
    if Path(path).suffix.lower() == ".npz":
        from scipy.sparse import save_npz

        save_npz(buffer, csr_array(matrix))
    else:
        from scipy.io import mmwrite

        symmetry = "symmetric" if symmetric else "general"
        field = "integer" if matrix.dtype.kind == "i" else "real"
        mmwrite(buffer, coo_array(matrix), comment=comment, field=field, precision=17, symmetry=symmetry)
    return buffer.getvalue()
