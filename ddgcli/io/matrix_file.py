"""Write sparse matrices in formats of scipy and Matrix Market."""

from __future__ import annotations

import io
from pathlib import Path

from scipy.sparse import coo_array, csr_array, sparray

MATRIX_FORMATS = (".npz", ".mtx")


def matrix_bytes(path: str, matrix: sparray, comment: str = "") -> bytes:
    """The file's content: `.npz` for `scipy.sparse.load_npz` (CSR), `.mtx` Matrix Market, all entries."""
    buffer = io.BytesIO()
    if Path(path).suffix.lower() == ".npz":
        from scipy.sparse import save_npz

        save_npz(buffer, csr_array(matrix))
    else:
        from scipy.io import mmwrite

        mmwrite(buffer, coo_array(matrix), comment=comment, field="real", precision=17, symmetry="symmetric")
    return buffer.getvalue()
