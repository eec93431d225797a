"""Warnings of inputs whose flat faces are not the surface that they represent."""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import counted

log = logging.getLogger("ddgcli")


def warn_of_flat_faces(face: Mapping[str, NDArray]) -> None:
    """Warn of intrinsic triangulations and of faces that close a periodic grid, by their arrays on faces.

    Parameters
    ----------
    face : mapping of str to (m, ...) ndarray
    """
    if {"face_edge_lengths", "neighbors"} <= set(face):
        log.warning(
            "the input is an intrinsic triangulation, but its faces are treated as flat in space, which "
            "gives another surface; use the mesh that it was computed from"
        )
    closing = int(np.count_nonzero(face.get("wraps", 0)))
    if closing:
        log.warning(
            "%s a periodic grid (array wraps), but all faces are treated as flat in space, where "
            "these span it: lengths, and fields on them, are not those of the grid; take a grid that is not "
            "periodic",
            counted(closing, "face closes", "faces close"),
        )
