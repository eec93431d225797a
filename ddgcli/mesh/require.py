"""Properties of meshes that algorithms require, and errors for meshes without them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError, counted
from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.remedies import remedy, with_repair
from ddgcli.mesh.repair import merged_points
from ddgcli.mesh.topology import NEXT, Topology
from ddgcli.mesh.triangle_mesh import FLAT_AREA_TOLERANCE, TriangleMesh
from ddgcli.mesh.vectors import row_cross

if TYPE_CHECKING:
    from ddgcli.mesh.intrinsic_mesh import SurfaceMesh

SAMPLE_SIZE = 1000  # faces
# by dimension, longest edges whose squares (areas) or cubes (volumes) lie within 1e-280 .. 1e280: the
# cells of a fine mesh are smaller, sums are larger, and numbers below 1e-292 have fewer digits
LENGTH_RANGE = {2: (1e-140, 1e140), 3: (1e-93, 1e93)}
PLANE_TOLERANCE = 1e-9  # height of a component over its extent


def require(
    mesh: SurfaceMesh,
    subject: str,
    *,
    faces: bool = True,
    sized: bool = True,
    extent: bool = False,
    manifold: bool = False,
    manifold_edges: bool = False,
    oriented: bool = False,
    one_sided: bool = False,
    closed: bool = False,
) -> None:
    """Raise MeshError if `mesh` lacks a property; name the first bad element and a remedy.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    subject : str
        Subject of the message, such as the name of a command.
    faces : bool
        At least one triangle.
    sized, extent : bool
        No side whose square underflows or overflows; at least one side longer than zero.
    manifold, manifold_edges : bool
        No edge with three faces, and (`manifold`) no vertex with several fans.
    oriented, closed : bool
        Neighbouring faces agree in orientation; every edge has two faces.
    one_sided : bool
        With `oriented`: components that have no orientation are accepted.
    """
    topology = mesh.topology
    if faces and topology.n_faces == 0:
        raise MeshError(f"no triangles; {subject} needs a surface")
    if (sized or extent) and topology.n_faces and not _surely_sized(mesh):
        check_size(float(mesh.side_length.max()), in_range=sized)
    if (manifold or manifold_edges) and len(topology.nonmanifold_edges):
        refuse_repeated_vertices(mesh)
        bad = topology.nonmanifold_edges
        a, b = topology.edges[bad[0]]
        raise MeshError(
            f"{counted(len(bad), 'edge has', 'edges have')} more than two faces (first: vertices {a}-{b}); "
            f"{subject} needs a manifold mesh: {remedy('edge of three faces', topology, oriented=oriented)}"
        )
    if manifold and len(topology.nonmanifold_vertices):
        bad = topology.nonmanifold_vertices
        raise MeshError(
            f"{counted(len(bad), 'vertex joins', 'vertices join')} several fans of faces (first: vertex "
            f"{bad[0]}); {subject} needs a manifold mesh: "
            f"{remedy('several fans', topology, oriented=oriented)}"
        )
    bad = topology.misoriented_edges if oriented else topology.edges[:0, 0]
    if one_sided and len(bad):
        bad = bad[topology.orientable_component[topology.vertex_component[topology.edges[bad, 0]]]]
    if len(bad):
        a, b = topology.edges[bad[0]]
        raise MeshError(
            f"{counted(len(bad), 'edge joins', 'edges join')} faces of opposite orientation (first: vertices "
            f"{a}-{b}); {subject} needs consistently oriented faces: {_orientation_remedy(mesh, one_sided)}"
        )
    if closed and not topology.is_closed:
        a, b = topology.edges[topology.boundary_edges[0]]
        loops = counted(topology.boundary_loops, "boundary loop", "boundary loops")
        raise MeshError(
            f"the surface has {loops} (first edge: vertices {a}-{b}); {subject} needs a closed surface: "
            f"{how_to_close(mesh)}"
        )


def how_to_close(mesh: SurfaceMesh) -> str:
    """How to close a surface with a boundary, for error messages; some surfaces cannot be closed.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    str
    """
    topology = mesh.topology
    if topology.one_sided_face.any():
        return "no repair closes this one, which is one-sided"
    if not isinstance(mesh, TriangleMesh):
        return remedy("boundary", topology)
    if weld := _weld_remedy(mesh):
        return weld
    component = topology.face_component
    is_open = np.zeros(topology.n_components, dtype=bool)
    is_open[topology.vertex_component[topology.edges[topology.boundary_edges, 0]]] = True
    for number in np.flatnonzero(is_open)[:SAMPLE_SIZE]:
        rows = component == number
        corners = mesh.points[unique_keys(mesh.faces[rows])]
        extent = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
        if extent[-1] <= PLANE_TOLERANCE * extent[0]:
            return (
                f"the component of face {np.argmax(rows)} is a flat sheet, which encloses nothing; extrude it"
            )
    return remedy("boundary", topology)


def _weld_remedy(mesh: TriangleMesh) -> str:
    """Part of the message: how to join vertices and close what is open then; '' where that joins nothing."""
    points, place = merged_points(mesh.points)
    faces, fill = place[mesh.faces], ""
    is_triangle = (faces != faces[:, NEXT]).all(axis=1)
    joined = Topology(faces[is_triangle], len(points))
    n_open = len(joined.boundary_edges) + _n_sides_without_pair(joined)
    if n_open >= len(mesh.topology.boundary_edges) or joined.one_sided_face.any():
        return ""
    steps = ["weld"] if is_triangle.all() else ["weld", "drop_degenerate"]
    if not joined.is_manifold:
        steps.append("split_fans")
    if len(joined.misoriented_edges):
        steps.append("orient")
    if n_open:
        fill = " and fill the holes"
        steps.append(f"fill_holes={max(3, n_open)}")
    return f"join vertices at equal positions{fill} with `repair={' '.join(steps)}`"


def _n_sides_without_pair(topology: Topology) -> int:
    """Number of sides at edges of three or more faces that a split leaves open (orientations do not pair)."""
    side_edge, sign = topology.side_edge.ravel(), topology.side_sign.ravel()
    balance = np.bincount(side_edge, weights=sign, minlength=topology.n_edges)
    return int(topology.edge_face_count[(balance != 0) & (topology.edge_face_count > 2)].sum())


def _orientation_remedy(mesh: SurfaceMesh, one_sided: bool = False) -> str:
    """Part of the message: how to orient the faces."""
    turn = mesh.topology.faces_to_turn
    if not one_sided and mesh.topology.one_sided_face.any():
        return f"this surface is one-sided and has no orientation: {remedy('one side', mesh.topology)}"
    first = int(np.argmax(turn))
    return f"reverse {int(turn.sum())} of them (first: face {first}) {with_repair('orientation')}"


def _surely_sized(mesh: SurfaceMesh) -> bool:
    """Quick sufficient test, from the first faces and the extent, that `check_size` accepts the size."""
    if not isinstance(mesh, TriangleMesh):  # its sides are all that is certain
        return False
    ends = mesh.points[mesh.faces[:SAMPLE_SIZE, :2]]
    least = np.abs(ends[:, 0] - ends[:, 1]).max()
    low, high = LENGTH_RANGE[2]
    return bool(low < least and _extent(mesh) < 0.5 * high)


def _extent(mesh: TriangleMesh) -> float:
    """Largest side of the bounding box."""
    low, high = mesh.bounding_box
    return float((high - low).max())


def check_size(longest: float, *, in_range: bool = True, dimension: int = 2) -> None:
    """Raise an error for a mesh whose longest edge is zero or not in the range of its square or cube.

    Parameters
    ----------
    longest : float
        Longest edge.
    in_range : bool
        Also refuse lengths whose power underflows or overflows.
    dimension : {2, 3}
        Of a surface, or a solid.

    Raises
    ------
    MeshError
    """
    noun, power = {2: ("surface", "squared"), 3: ("solid", "cubed")}[dimension]
    low, high = LENGTH_RANGE[dimension]
    if longest == 0:
        raise MeshError(f"every vertex is at the same place: there is no {noun}; correct the coordinates")
    if in_range and not low < longest < high:
        raise MeshError(
            f"the size of the {noun}, {longest:.3g}, over- or underflows if {power}; rescale the mesh"
        )


def refuse_repeated_vertices(mesh: SurfaceMesh) -> None:
    """Raise an error for faces that name a vertex twice, or for no face with an area where that is all.

    In a Delta-complex such faces are legal: its gluing joins their sides.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Raises
    ------
    MeshError
    """
    twice = mesh.topology.repeated_vertex_faces
    if not len(twice) or mesh.topology.gluing is not None:
        return
    if isinstance(mesh, TriangleMesh):
        require_area(mesh)  # the remedy would leave no face
    raise MeshError(
        f"face {twice[0]} names a vertex twice ({counted(len(twice), 'such face', 'such faces')}); "
        f"{remedy('repeated vertex')}"
    )


def require_area(mesh: TriangleMesh) -> None:
    """Raise an error for a surface none of whose faces has an area.

    Parameters
    ----------
    mesh : TriangleMesh

    Raises
    ------
    MeshError
    """
    if surely_has_area(mesh):
        return
    side = mesh.side_vector / mesh.side_length.max()
    if (np.abs(row_cross(side[:, 0], side[:, 1])) <= FLAT_AREA_TOLERANCE).all():
        raise no_area_error(mesh.n_faces)


def surely_has_area(mesh: TriangleMesh) -> bool:
    """Quick sufficient test, from the first faces, that the surface has an area.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    bool
        False if all faces must be tested.
    """
    corners = mesh.points[mesh.faces[:SAMPLE_SIZE]]
    longest = 2.0 * _extent(mesh) or 1.0  # no side is longer
    side = (corners[:, 1:] - corners[:, :1]) / longest
    return bool((np.abs(row_cross(side[:, 0], side[:, 1])) > FLAT_AREA_TOLERANCE).any())


def no_area_error(n_faces: int) -> MeshError:
    """Error of a surface none of whose faces has an area.

    Parameters
    ----------
    n_faces : int

    Returns
    -------
    MeshError
    """
    which = "the only face has no area" if n_faces == 1 else f"none of the {n_faces} faces has an area"
    return MeshError(f"{which}; check the coordinates")


def refuse_flat_faces(
    flat: NDArray, topology: Topology | None = None, *, manifold: bool = False, oriented: bool = False
) -> None:
    """Raise an error with the count and the first of the faces without area, if there are any.

    Parameters
    ----------
    flat : (k,) ndarray of int64
        Faces without area.
    topology : Topology, optional
        Adds the vertices of the first face, and the steps that the repair needs on this mesh.
    manifold, oriented : bool
        What else the caller requires of the mesh, for the repair.

    Raises
    ------
    MeshError
    """
    if len(flat) == 0:
        return
    if topology is not None and len(flat) == topology.n_faces:  # their removal would leave nothing
        raise no_area_error(len(flat))
    corners = "" if topology is None else f", vertices {', '.join(str(v) for v in topology.faces[flat[0]])}"
    raise MeshError(
        f"{counted(len(flat), 'face has', 'faces have')} no area (first: face {flat[0]}{corners}); "
        f"{remedy('no area', topology, manifold=manifold, oriented=oriented)}"
    )
