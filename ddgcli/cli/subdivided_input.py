"""The input of a run with every face split in four, for --subdivide."""

from __future__ import annotations

import logging
from dataclasses import replace

from ddgcli.errors import ParameterError
from ddgcli.io.mesh_file import MeshInput
from ddgcli.mesh.shapes import midpoint_subdivided

MAX_SUBDIVIDED_FACES = 20_000_000

log = logging.getLogger("ddgcli")


def subdivided_input(source: MeshInput, times: int) -> MeshInput:
    """The input with every face split in four `times` times, without its arrays."""
    if source.kind == "tetrahedra":
        raise ParameterError("splits the faces of a surface, and MESH holds tetrahedra; leave it out",
                             parameter="subdivide")  # fmt: skip
    names = sorted({*source.vertex, *source.face, *source.edge})
    if names:
        log.warning("`subdivide` drops the arrays %s", ", ".join(names))
    n_faces = source.surface.n_faces * 4**times
    if n_faces > MAX_SUBDIVIDED_FACES:
        raise ParameterError(
            f"{times} would make {n_faces:,} faces, more than {MAX_SUBDIVIDED_FACES:,}; use a smaller number",
            parameter="subdivide",
        )
    finer = midpoint_subdivided(source.surface, times)
    return replace(source, mesh=finer, vertex={}, face={}, edge={}, input_face=None)
