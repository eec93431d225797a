"""The input of a run with every face split in four, for --subdivide."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from ddgcli.errors import ParameterError
from ddgcli.io.appearance import NAMES as APPEARANCE
from ddgcli.io.mesh_file import MeshInput
from ddgcli.mesh.shapes import midpoint_subdivided

MAX_SUBDIVIDED_FACES = 20_000_000

log = logging.getLogger("ddgcli")


def subdivided_input(source: MeshInput, times: int) -> MeshInput:
    """The input with every face split in four `times` times.

    Numbers on vertices are interpolated linearly, faces have the values of those that they are pieces of;
    whole numbers on vertices (labels), textures, colours and arrays on edges are dropped.
    """
    if source.kind == "tetrahedra":
        raise ParameterError("splits the faces of a surface, and MESH holds tetrahedra; leave it out",
                             parameter="subdivide")  # fmt: skip
    n_faces = source.surface.n_faces * 4**times
    if n_faces > MAX_SUBDIVIDED_FACES:
        raise ParameterError(
            f"{times} would make {n_faces:,} faces, more than {MAX_SUBDIVIDED_FACES:,}; use a smaller number",
            parameter="subdivide",
        )
    vertex = {k: v for k, v in source.vertex.items() if v.dtype.kind == "f" and k not in APPEARANCE}
    face = {k: v for k, v in source.face.items() if k not in APPEARANCE}
    names = sorted({*source.vertex, *source.face, *source.edge} - {*vertex, *face})
    if names:
        log.warning("`subdivide` drops the arrays %s", ", ".join(names))
    mesh = source.surface
    for _ in range(times):
        ends = mesh.topology.edges
        vertex = {name: np.concatenate([a, a[ends].mean(axis=1)]) for name, a in vertex.items()}
        mesh = midpoint_subdivided(mesh)
    face = {name: np.concatenate(4**times * [array]) for name, array in face.items()}
    return replace(source, mesh=mesh, vertex=vertex, face=face, edge={}, input_face=None)
