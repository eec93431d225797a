"""Options of `ddgcli curvature` for regions, vertex vectors and the offset body."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import click

from ddgcli.choices import DEFAULT_OFFSET_ANGLE
from ddgcli.cli.options import POSITIVE_NUMBER, Numbers, grouped_options
from ddgcli.errors import ParameterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.algorithms.curvature.offset_body import OffsetBody
    from ddgcli.cli.run import Run
    from ddgcli.io.mesh_file import MeshInput

OFFSET_FORMATS = (".ply", ".vtu", ".vtk", ".vtp", ".vtkhdf", ".obj", ".off", ".stl", ".xdmf", ".npz")
MEASURE_NAMES = ("region", "vertex_vectors", "offset", "offset_output", "offset_angle")


@dataclass(frozen=True)
class MeasureOptions:
    """Values of the options."""

    region: tuple[Any, ...] = ()
    vertex_vectors: bool = False
    offset: float | None = None
    offset_output: str | None = None
    offset_angle: float = DEFAULT_OFFSET_ANGLE

    def changed(self) -> dict[str, Any]:
        """Options that differ from their defaults, for the summary."""
        return {name: value for name, value in asdict(self).items() if value != getattr(type(self), name)}

    def check(self) -> None:
        """Raise ParameterError for options that lack what they refer to."""
        if self.offset is None:
            for name in ("offset_output", "offset_angle"):
                if getattr(self, name) != getattr(type(self), name):
                    raise ParameterError(
                        "belongs to `offset`; give that too, or leave this out", parameter=name
                    )


class Region(click.ParamType):
    """A ball X,Y,Z:R, or the name of an array or a file."""

    name = "region"

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        head, colon, tail = str(value).rpartition(":")
        if not colon or head.count(",") != 2:
            return value
        return Numbers(3, "0,0,1").convert(head, param, ctx), POSITIVE_NUMBER.convert(tail, param, ctx)


_OPTIONS = (
    click.option("--region", multiple=True, type=Region(), metavar="ARRAY|FILE|X,Y,Z:R",
                 help="Curvature measures and tensors of regions: labels on faces or vertices, or a ball; "
                      "repeatable."),
    click.option("--vertex-vectors", is_flag=True,
                 help="Arrays H_p, volume_gradient, h_p and gradient_angle of the course notes."),
    click.option("--offset", type=POSITIVE_NUMBER, metavar="R",
                 help="Offset body at distance R of a closed surface: its volume by Steiner's formula."),
    click.option("--offset-output", metavar="PATH", help="Write the offset body as a mesh."),
    click.option("--offset-angle", type=POSITIVE_NUMBER, default=DEFAULT_OFFSET_ANGLE, show_default=True,
                 metavar="DEGREES", help="Largest step of the arcs of the offset body."),
)  # fmt: skip

measure_options = grouped_options("measures", MeasureOptions, _OPTIONS)


def surface_arguments(read: MeshInput, measures: MeasureOptions) -> dict[str, Any]:
    """Arguments that `check_query` and `measure_surface` share: arrays in the place of names."""
    return {
        "regions": [_input_array(read, name) for name in measures.region if isinstance(name, str)],
        "balls": [ball for ball in measures.region if not isinstance(ball, str)],
        "offset": measures.offset,
        "offset_angle": measures.offset_angle,
    }


def _input_array(read: MeshInput, name: str) -> tuple[NDArray, str]:
    from ddgcli.io.arrays import input_array

    return input_array(read, name, parameter="region")


def write_offset(run: Run, path: str | None, body: OffsetBody | None) -> None:
    """Write the offset body with its parts."""
    if path is None or body is None:
        return
    from ddgcli.mesh.fields import AnnotatedMesh

    run.write_file(path, AnnotatedMesh(body.mesh, face={"part": body.part_of_face}))


def draw_offset(path: str, body: OffsetBody, look: dict[str, Any]) -> None:
    """Draw the offset body, coloured by its parts: faces, edges, vertices."""
    from ddgcli.plots.array import draw_array

    draw_array(path, body.mesh, "part", body.part_of_face, limits=(0.0, 2.0), **look)
