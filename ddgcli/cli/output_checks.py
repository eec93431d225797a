"""Checks of the outputs and the pictures that a call names, and of its mesh, before any work."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ddgcli.cli.options import CommonOptions
from ddgcli.errors import OutputError, ParameterError

if TYPE_CHECKING:
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.mesh.tet_mesh import TetMesh
    from ddgcli.mesh.triangle_mesh import TriangleMesh

COLOUR_FORMATS = (".ply", ".glb", ".obj")  # formats whose colours other programs show


def check_outputs(
    common: CommonOptions, formats: Sequence[str] | None, plan_output: Callable[..., None]
) -> None:
    """Check the outputs of a call with `plan_output(path, formats, output_format)`, and what they exclude."""
    if common.as_json and "-" in common.outputs:
        raise ParameterError("--json and -o - both write to standard output; write the result to a file")
    if common.quiet and common.verbose:
        raise ParameterError("-q and -v exclude each other; give one")
    for path in common.outputs:
        plan_output(path, formats, common.output_format)
    if common.colors is not None:
        from ddgcli.plots.page import require_matplotlib

        require_matplotlib()
        suffixes = {Path(path).suffix.lower() for path in common.outputs}
        if not suffixes & set(COLOUR_FORMATS):
            raise ParameterError(f"--colors is for {' '.join(COLOUR_FORMATS)}; write one with -o")
    if common.plot is not None:
        from ddgcli.plots.page import FORMATS, require_matplotlib

        plan_output(common.plot, FORMATS)
        require_matplotlib()


def check_picture(common: CommonOptions, pictures: str) -> None:
    """Refuse --view, --show and --size if no picture uses them."""
    for name in ("view", "show", "size"):
        if getattr(common, name) is None or pictures == "output":
            continue
        if common.plot is None:
            raise ParameterError(f"--{name} is for the picture of --plot; add --plot PATH")


def check_mesh(command: str, common: CommonOptions, mesh: TriangleMesh | TetMesh | CurveSet) -> None:
    """Refuse a mesh that the outputs cannot hold, or cells of a size that the command does not take."""
    from ddgcli.mesh.requirements import require_sized_cells

    check_holdable(common, mesh)
    require_sized_cells(mesh, command)


def check_holdable(common: CommonOptions, mesh: TriangleMesh | TetMesh | CurveSet) -> None:
    """Refuse outputs whose format cannot hold the cells or the coordinates of the input's mesh."""
    from ddgcli.io.writers.cell_data import require_single_precision, require_surface
    from ddgcli.mesh.requirements import kind_of

    is_curve = kind_of(mesh) == "curve"
    for path in common.outputs:
        name = f".{common.output_format.lstrip('.')}" if path == "-" and common.output_format else path
        suffix = Path(f"x{name}").suffix.lower()
        try:
            if is_curve:
                require_surface("lines", suffix)
            require_single_precision(mesh.points, suffix)
        except OutputError as error:
            raise OutputError(f"{path}: {error}") from None
