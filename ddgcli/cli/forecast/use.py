"""Size of an input, and one use of a kernel."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["KNOWN", "InputSize", "Range", "Use"]

Range = tuple[float, float]

KNOWN: Range = (1.0, 1.0)


@dataclass(frozen=True)
class InputSize:
    """Size of an input.

    Parameters
    ----------
    kind : {'surface', 'tetrahedra', 'curve'}
    elements : int
        Faces, tetrahedra or points of curves; of several inputs the sum.
    edge_length : float, optional
        Mean length of an edge, for costs of neighbourhoods.
    steps : int, optional
        Steps of a simulation, where they are known.
    frame_count : int
        Frames that are written or drawn.
    component_elements : int, optional
        Elements of the largest connected component; default all.
    angle_deficit : float, optional
        Sum over the faces of 1 - (smallest angle / angle of --refine), where that is positive.
    rough : bool
        Faces turn against each other by large angles of both signs, as noise makes them.
    adaptive : bool
        `steps` counts frames, between which the steps adapt.
    """

    kind: str
    elements: int
    edge_length: float | None = None
    steps: int | None = None
    frame_count: int = 1
    component_elements: int | None = None
    angle_deficit: float | None = None
    rough: bool = False
    adaptive: bool = False


@dataclass(frozen=True)
class Use:
    """One use of a kernel of the table `COEFFICIENTS`.

    Parameters
    ----------
    kernel : str
    times : float
        Factor of its seconds.
    added : float
        Factor of its memory that other kernels do not free; 0: the kernels of a command share memory, and
        the largest counts.
    elements : float, optional
        On which it works, where these are not the elements of the input.
    range : (float, float)
        Least and largest factor of `times`, where only the run shows how long it is.
    assumes : str
        What `times` takes for granted, where only the run shows it.
    """

    kernel: str
    times: float = 1.0
    added: float = 0.0
    elements: float | None = None
    range: Range = KNOWN
    assumes: str = ""
