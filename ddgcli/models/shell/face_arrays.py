"""Strain, stress and bending moment of the faces of a shell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.vectors import tangential
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.tensor_potential import TensorPotential


def face_arrays(
    context: ShellContext, potentials: Sequence[Any], x: NDArray
) -> dict[str, NDArray[np.float64]]:
    """Tensors on the faces of a shell, for the models `stvk` and `midedge`; empty for other models.

    Parameters
    ----------
    context : ShellContext
    potentials : sequence
        Terms of the shell.
    x : (n, 3) ndarray of float64
        Positions in m.

    Returns
    -------
    dict
        `strain_tensor` (m, 9): Green's strain, rows of a 3 x 3 matrix in the tangent plane at rest; where
        metal has yielded, the elastic one;
        `principal_strain` (m, 2); `stress` (m, 9): Cauchy's stress in Pa, in the tangent plane as it is now;
        `principal_stress` (m, 2); `bending_moment` (m, 9): N m per metre, in the tangent plane as it is now,
        positive where the shell bends towards convex; `principal_moment` (m, 2). Principal values descend.
    """
    arrays: dict[str, NDArray] = {}
    points = np.asarray(context.mesh.points)
    face_frame = _face_frames(points, np.asarray(context.mesh.faces))
    gradient = _deformation(points, x, np.asarray(context.mesh.faces), face_frame)
    with_tensors: list[Any] = [p for p in potentials if isinstance(p, TensorPotential)]
    for potential in with_tensors:
        if potential.green_strain is not None:
            strain, second = potential.green_strain(x)
            stretch = np.sqrt(np.linalg.det(np.matmul(gradient.transpose(0, 2, 1), gradient)))
            cauchy = second / (stretch * float(context.shell.thickness or 1.0))[:, None, None]
            elastic = potential.deformation_gradient(x)  # relative to the rest shape after yielding
            turn = _rotation(
                np.matmul(_rest_sides(points, context.mesh.faces, face_frame), potential.basis[:, 1:])
            )
            arrays["strain_tensor"] = _in_space(np.matmul(face_frame, turn), strain)
            arrays["principal_strain"] = _eigenvalues(strain)[:, ::-1]
            spatial = np.matmul(np.matmul(elastic, cauchy), elastic.transpose(0, 2, 1))
            arrays["stress"] = spatial.reshape(-1, 9)
            arrays["principal_stress"] = _tangent_values(spatial)
        elif potential.moment_tensor is not None:
            couples = [p for p in with_tensors if p.added_rotations is not None]
            moment = potential.moment_tensor(x, sum(p.added_rotations() for p in couples))
            arrays["bending_moment"] = _in_space(_rotation(gradient), moment)
            arrays["principal_moment"] = _eigenvalues(moment)[:, ::-1]
    return arrays


def _face_frames(points: NDArray, faces: NDArray) -> NDArray[np.float64]:
    """(m, 3, 2) orthonormal tangents at rest: along the first side, and across it."""
    e, f = points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    first = e / np.linalg.norm(e, axis=1)[:, None]
    across = tangential(f, first)
    return np.stack([first, across / np.linalg.norm(across, axis=1)[:, None]], axis=2)


def _deformation(points: NDArray, x: NDArray, faces: NDArray, face_frame: NDArray) -> NDArray[np.float64]:
    """(m, 3, 2) deformation gradients, with respect to the face frames."""
    now = np.stack([x[faces[:, k]] - x[faces[:, 0]] for k in (1, 2)], axis=2)
    return np.matmul(now, np.linalg.inv(_rest_sides(points, faces, face_frame)))


def _rest_sides(points: NDArray, faces: NDArray, face_frame: NDArray) -> NDArray[np.float64]:
    """(m, 2, 2) matrices whose columns are the sides from the first corner at rest, in the face frames."""
    rest = np.stack([points[faces[:, k]] - points[faces[:, 0]] for k in (1, 2)], axis=2)
    return np.matmul(face_frame.transpose(0, 2, 1), rest)


def _rotation(gradient: NDArray) -> NDArray[np.float64]:
    """(m, 3 or 2, 2) nearest isometry of the deformation gradients; nan where these are not finite."""
    finite = _finite(gradient)
    u, _, vt = np.linalg.svd(np.where(finite, gradient, 0.0), full_matrices=False)
    return np.where(finite, np.matmul(u, vt), np.nan)


def _eigenvalues(tensor: NDArray) -> NDArray[np.float64]:
    """(m, k) eigenvalues, ascending, of symmetric (m, k, k) tensors; nan where these are not finite."""
    finite = _finite(tensor)
    return np.where(finite[:, 0], np.linalg.eigvalsh(np.where(finite, tensor, 0.0)), np.nan)


def _finite(tensor: NDArray) -> NDArray[np.bool_]:
    """(m, 1, 1): whether all entries are finite, as LAPACK requires; they are not after an overflow."""
    return np.isfinite(tensor).all(axis=(1, 2))[:, None, None]


def _in_space(face_frame: NDArray, tensor: NDArray) -> NDArray[np.float64]:
    """(m, 9) rows of the 3 x 3 matrices of (m, 2, 2) tensors in frames (m, 3, 2)."""
    return np.matmul(np.matmul(face_frame, tensor), face_frame.transpose(0, 2, 1)).reshape(-1, 9)


def _tangent_values(tensor: NDArray) -> NDArray[np.float64]:
    """(m, 2) eigenvalues, descending, of symmetric (m, 3, 3) tensors, without the zero of the normal."""
    values = _eigenvalues(tensor)
    normal = np.argmin(np.abs(values), axis=1)
    in_tangent = np.arange(3) != normal[:, None]
    return values[in_tangent].reshape(-1, 2)[:, ::-1]
