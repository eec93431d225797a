"""Wavefront options of `ddgcli geodesic`: distance matrix, Voronoi regions, signed distance, fan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from ddgcli.algorithms.geodesics.query import DistanceQuery, WaveQuery
from ddgcli.cli.options import POSITIVE_NUMBER, Ids, grouped_options
from ddgcli.errors import ParameterError, renamed_parameters

if TYPE_CHECKING:
    from ddgcli.algorithms.geodesics.edge_sets import EdgeSet
    from ddgcli.cli.run import Run
    from ddgcli.io.mesh_file import MeshInput


@dataclass(frozen=True)
class WaveOptions(WaveQuery):
    """Wave query, and the file of its distance matrix."""

    distance_matrix: str | None = None

    def check(self, distance: DistanceQuery) -> None:
        """Raise ParameterError for parameters that lack what they refer to."""
        if (self.distance_matrix is None) != (not self.target):
            name, other = (
                ("distance_matrix", "target") if self.distance_matrix else ("target", "distance_matrix")
            )
            raise ParameterError(f"needs `{other}`; give both", parameter=name)
        super().check(distance)


_OPTIONS = (
    click.option("--distance-matrix", metavar="PATH",
                 help="Write the distances from each --source to each --target vertex (.npz: distance)."),
    click.option("--target", multiple=True, type=Ids(), metavar="ID...",
                 help="Target vertex of --distance-matrix; several as for --source."),
    click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, metavar="N",
                 help="Processes for the rows of --distance-matrix and for --each-source."),
    click.option("--voronoi", is_flag=True, help="exact: face array region, the source nearest to each "
                                                 "face."),
    click.option("--signed-distance", metavar="CURVES",
                 help="Array signed_distance: negative on the left of curves of edges (named as for "
                      "--source-edges); exact for curves that separate the surface, else signed heat."),
    click.option("--fan", type=click.IntRange(3, 100_000), metavar="N",
                 help="N straightest geodesics from the only source in evenly spaced directions, "
                      "their geodesic circles and caustics, in --paths-output."),
    click.option("--fan-length", type=POSITIVE_NUMBER, metavar="LENGTH", help="Length of the rays of --fan."),
    click.option("--fan-circles", type=click.IntRange(1, 10_000), default=8, show_default=True, metavar="K",
                 help="Geodesic circles of --fan, evenly spaced."),
    click.option("--vertex-types", is_flag=True,
                 help="Array vertex_type: 1 spherical, 0 Euclidean, -1 hyperbolic, 2 boundary."),
)  # fmt: skip

wave_options = grouped_options("waves", WaveOptions, _OPTIONS)


def input_edge_set(read: MeshInput, name: str | None, parameter: str) -> EdgeSet | None:
    """Edge set of an array of the input, or of a file of vertex pairs, marks or polylines."""
    if name is None:
        return None
    from ddgcli.cli.subdivided_input import SubdividedInput

    if not isinstance(read, SubdividedInput):
        return _edge_set(read, name, parameter)
    from ddgcli.algorithms.geodesics.edge_sets import subdivided_edge_set

    return subdivided_edge_set(_edge_set(read.base, name, parameter), read.base.surface, read.subdivision)


def _edge_set(read: MeshInput, name: str, parameter: str) -> EdgeSet:
    from pathlib import Path

    from ddgcli.algorithms.geodesics.edge_sets import curve_pairs, edge_set
    from ddgcli.io.arrays import READERS, aligned_edge_values, input_array
    from ddgcli.mesh.curve import CurveSet

    mesh = read.surface
    own = any(name in group for group in (read.vertex, read.face, read.edge))
    if not own and Path(name).is_file() and Path(name).suffix.lower() not in READERS:
        from ddgcli.io.mesh_file import read_mesh

        curves = read_mesh(name, None).mesh
        if not isinstance(curves, CurveSet):
            raise ParameterError(f"{name} holds no polylines; write line cells", parameter=parameter)
        with renamed_parameters(parameter):
            pairs = curve_pairs(mesh, curves.points, curves.lines)
        return edge_set(mesh, pairs, "pairs", parameter=parameter)
    array, place = input_array(read, name, parameter=parameter)
    if place == "edge" and "edges" in read.edge:
        array = aligned_edge_values(mesh.topology.edges, read.edge["edges"], array)
    return edge_set(mesh, array, place, parameter=parameter)


def write_matrix(run: Run, path: str | None, matrix: dict) -> None:
    """Write a distance matrix with its sources and targets."""
    if path is None or not matrix:
        return
    import numpy as np

    run.write_bytes(path, lambda file: np.savez_compressed(file, **matrix))
