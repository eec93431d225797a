"""Remedies for defects of meshes, for the error messages that report them.

A remedy names the steps of `repair_mesh` in back quotes, such as `` `repair=split_fans orient` ``: the
command line prints them as a call of `ddgcli repair`, the library as a call of `ddg.repair_mesh`.
`` `repair_cells=orient` `` is a repair of tetrahedra.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ddgcli.mesh.ragged import repeated_rows

if TYPE_CHECKING:
    from ddgcli.mesh.topology import Topology

# defect -> what to do, and the steps of the repair that do it
REMEDIES = {
    "edge of three faces": ("split the surface there", "split_fans"),
    "several fans": ("duplicate such vertices, one for each fan", "split_fans"),
    "orientation": ("reverse faces", "orient"),
    "one side": ("cut it open", "cut_to_disk"),
    "boundary": ("fill the holes", "fill_holes"),
    "no area": ("remove such faces", "drop_degenerate split_edges"),
    "slits": ("divide the edges so that they match", "weld split_edges"),
    "folds": ("remove or part them", "drop_degenerate split_folds"),
    "no volume": ("remove such cells", "drop_degenerate"),
    "touching bodies": ("duplicate such vertices, one for each body", "split_fans"),
    "inverted": ("exchange two corners of each", "orient"),
    "duplicate cells": ("remove cells that occur twice", "drop_duplicates"),
    "flat gaps": ("close them", "drop_degenerate"),
    "flat gaps of pieces": ("close them", "weld drop_degenerate"),
    "cracks": ("join vertices at equal positions", "weld"),
    "bodies in pieces": ("join vertices at equal positions", "weld"),
    "repeated vertex": ("remove such faces", "drop_degenerate"),
    "equal positions": ("join vertices at equal positions", "weld"),
    "components": ("keep the largest", "largest"),
    "no boundary": ("cut it open", "cut_to_disk"),
    "handles": ("cut them open", "cut_to_disk"),
}
CELL_DEFECTS = (
    "no volume",
    "inverted",
    "touching bodies",
    "duplicate cells",
    "bodies in pieces",
    "flat gaps",
    "flat gaps of pieces",
    "cracks",
)  # of tetrahedra, which the repair takes as they are
STEPS_ON_MANIFOLDS = ("fill_holes", "cut_to_disk")


def remedy(
    defect: str, topology: Topology | None = None, *, manifold: bool = False, oriented: bool = False
) -> str:
    """What to do about a defect of a mesh, with the steps of the repair.

    Parameters
    ----------
    defect : str
        A key of `REMEDIES`.
    topology : Topology, optional
        Topology of the refused mesh; adds the steps that the remedy needs on this mesh.
    manifold, oriented : bool
        What else the refused computation requires of the mesh.

    Returns
    -------
    str
        Such as ``fill the holes with `repair=fill_holes=12` ``.
    """
    return f"{REMEDIES[defect][0]} {with_repair(defect, topology, manifold=manifold, oriented=oriented)}"


def with_repair(
    defect: str, topology: Topology | None = None, *, manifold: bool = False, oriented: bool = False
) -> str:
    """Steps of the repair of a defect, in back quotes, after the word "with".

    Parameters
    ----------
    defect : str
        A key of `REMEDIES`.
    topology : Topology, optional
        Topology of the refused mesh; adds the steps that the remedy needs on this mesh.
    manifold, oriented : bool
        What else the refused computation requires of the mesh.

    Returns
    -------
    str
    """
    step, *more = REMEDIES[defect][1].split()
    steps = [step, *more]
    if manifold and step == "drop_degenerate":  # vertices beside such faces may join two fans then
        steps.append("split_fans")
    if topology is not None:
        manifold |= step in STEPS_ON_MANIFOLDS
        oriented |= step in STEPS_ON_MANIFOLDS
        if step == "split_fans" and _has_duplicates(topology):
            steps.insert(0, "drop_duplicates")
        if step == "fill_holes":
            n_sides = int(topology.edge_face_count[topology.nonmanifold_edges].sum())  # a split may open all
            steps = [f"fill_holes={max(3, len(topology.boundary_edges) + n_sides)}"]
        if step in STEPS_ON_MANIFOLDS and len(topology.repeated_vertex_faces):
            steps.insert(0, "drop_degenerate")
        if manifold and step in STEPS_ON_MANIFOLDS and not topology.is_manifold:
            steps.append("split_fans")
        if oriented and step != "orient" and (len(topology.misoriented_edges) or "drop_duplicates" in steps):
            steps.append("orient")
    keyword = "repair_cells" if defect in CELL_DEFECTS else "repair"
    return f"with `{keyword}={' '.join(steps)}`"


def _has_duplicates(topology: Topology) -> bool:
    """Whether two faces have the same three vertices."""
    return len(repeated_rows(np.sort(topology.faces, axis=1))) > 0
