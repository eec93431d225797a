"""Objects of a scene and their shapes: a mesh file, or a grid, sphere, box or cylinder; planes."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.requirements import kind_error
from ddgcli.mesh.shapes import box, box_tetrahedra, icosphere, wrapped_grid
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.topology import NEXT, Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import tangents, unit_vectors, vector_length
from ddgcli.scenes.scene import ObjectSection
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import quantity, vector

# mypy reads the calls below as values; pydantic reads them as annotated types
# mypy: disable-error-code="valid-type"

HEIGHT_TOLERANCE = 1e-3  # relative: heights as they are written, with some digits


class Grid(Section):
    """A flat rectangle [0, width] x [0, height] in the plane z = 0, normal +z."""

    size: list[quantity("m")] = Field(min_length=2, max_length=2, description="width and height")
    cells: list[int] = Field(min_length=2, max_length=2, description="cells along them")
    pattern: Literal["right", "left", "alternating", "cross", "equilateral"] = "alternating"
    periodic: Literal["", "x", "y", "xy"] = ""
    grading: quantity("", "0: equal cells; up to 1: finer at the sides, by cosines", ge=0) = 0.0

    @model_validator(mode="after")
    def _checked(self) -> Grid:
        if self.grading > 1:
            raise ValueError("the grading must be from 0 to 1")
        if self.grading and self.pattern == "equilateral":
            raise ValueError("equilateral triangles have no grading; take another pattern")
        if min(self.size) <= 0:
            raise ValueError("the size must be positive")
        if min(self.cells) < 1 or max(self.cells) > 20000:
            raise ValueError("the cells must be from 1 to 20000")
        if self.periodic and self.pattern == "equilateral":
            raise ValueError("a periodic grid takes the pattern right, left, alternating or cross")
        few = [c for axis, c in zip("xy", self.cells) if axis in self.periodic and c < 3]
        if few:
            raise ValueError("a periodic direction needs at least 3 cells")
        odd = [c for axis, c in zip("xy", self.cells) if axis in self.periodic and c % 2]
        if odd and self.pattern == "alternating":
            raise ValueError(
                "alternating diagonals need an even number of cells in a periodic direction; "
                'add a cell, or write pattern = "right"'
            )
        return self


class Plane(Section):
    """A half-space: the side to which the normal points is free."""

    point: vector("m") = (0.0, 0.0, 0.0)
    normal: vector("") = (0.0, 0.0, 1.0)

    @model_validator(mode="after")
    def _checked(self) -> Plane:
        if not np.linalg.norm(self.normal) > 0:
            raise ValueError("the normal of a plane must not be zero")
        return self


class Sphere(Section):
    """A ball for obstacles; its surface, as a geodesic mesh, for shells and fluids."""

    center: vector("m") = (0.0, 0.0, 0.0)
    radius: quantity("m", "radius", gt=0) = 1.0
    subdivisions: int = Field(3, ge=0, le=8, description="mesh: each splits every triangle in four")


class Box(Section):
    """A closed box from `corner`, `size` long."""

    corner: vector("m") = (0.0, 0.0, 0.0)
    size: vector("m") = (1.0, 1.0, 1.0)
    cells: list[int] = Field(default=[4, 4, 4], min_length=3, max_length=3)

    @model_validator(mode="after")
    def _checked(self) -> Box:
        if min(self.size) <= 0 or min(self.cells) < 1:
            raise ValueError("size and cells of a box must be positive")
        return self


class Cylinder(Section):
    """A solid cylinder between the centres of its ends."""

    start: vector("m")
    end: vector("m")
    radius: quantity("m", "radius", gt=0)

    @model_validator(mode="after")
    def _checked(self) -> Cylinder:
        if tuple(self.start) == tuple(self.end):
            raise ValueError("start and end of a cylinder must differ")
        return self


class CylinderSide(Cylinder):
    """The side of a cylinder, open at both ends, normal outward."""

    cells: list[int] = Field(default=[32, 16], min_length=2, max_length=2, description="around and along")

    @model_validator(mode="after")
    def _checked_cells(self) -> CylinderSide:
        if self.cells[0] < 4 or self.cells[0] % 2 or self.cells[1] < 1:
            raise ValueError(
                "the cells of a cylinder must be an even number around, 4 or more, and 1 or more along"
            )
        if max(self.cells) > 20000:
            raise ValueError("the cells of a cylinder must be at most 20000")
        return self


class Rotation(Section):
    """A turn about an axis through the object's origin."""

    axis: vector("") = (0.0, 0.0, 1.0)
    degrees: quantity("") = 0.0

    @model_validator(mode="after")
    def _checked(self) -> Rotation:
        if not np.linalg.norm(self.axis) > 0:
            raise ValueError("the axis of a rotation must not be zero")
        return self


class SurfaceObject(ObjectSection):
    """An object with a mesh: a shell or a fluid's surface."""

    mesh: str | None = Field(None, description="mesh file, relative to the scene")
    grid: Grid | None = None
    sphere: Sphere | None = None
    box: Box | None = None
    cylinder: CylinderSide | None = None
    position: vector("m", "where the object's origin goes") = (0.0, 0.0, 0.0)
    rotation: Rotation | None = None
    scale: quantity("", "factor on the mesh, before rotation", gt=0) = 1.0

    @model_validator(mode="after")
    def _one_shape(self) -> SurfaceObject:
        require_one_shape(self, ("mesh", "grid", "sphere", "box", "cylinder"))
        return self


class MovingObject(SurfaceObject):
    """A surface with an initial motion."""

    velocity: vector("m/s", "initial velocity") = (0.0, 0.0, 0.0)
    angular_velocity: vector("rad/s", "initial turning about the centre of mass") = (0.0, 0.0, 0.0)


def require_one_shape(section: Any, shapes: tuple[str, ...]) -> None:
    """Raise an error unless a section names exactly one shape.

    Parameters
    ----------
    section : object
    shapes : tuple of str
        The keys of shapes.

    Raises
    ------
    ValueError
    """
    names = [s for s in shapes if getattr(section, s) is not None]
    if len(names) != 1:
        listed = "none" if not names else " and ".join(names)
        raise ValueError(f"exactly one shape is needed, found {listed}; allowed: {', '.join(shapes)}")


@dataclass(frozen=True, eq=False)
class PlacedMesh:
    """The mesh of an object where the scene puts it.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Intrinsic (with points for drawing) where the grid is periodic: a flat torus or cylinder.
    vertex : dict of str to ndarray
        Arrays that the mesh file carried.
    sha256 : str
        SHA-256 of the mesh file; "" for a generated shape.
    face : dict of str to ndarray
        As `vertex`, on faces.
    """

    mesh: Any
    vertex: dict[str, NDArray]
    sha256: str = ""
    face: dict[str, NDArray] = field(default_factory=dict)


def place(section: SurfaceObject, read: Callable[[str], Any], volumes: bool = False) -> PlacedMesh:
    """Mesh of an object, scaled, turned and moved.

    Parameters
    ----------
    section : SurfaceObject
    read : callable
        Opens a mesh file relative to the scene.
    volumes : bool
        A file may hold tetrahedra, and a box is one of tetrahedra.

    Returns
    -------
    PlacedMesh

    Raises
    ------
    ValueError
        For a mesh that does not fit the section.
    """
    if volumes and section.box is not None:
        nx, ny, nz = section.box.cells
        solid = box_tetrahedra(nx, ny, nz, section.box.size)
        inside = np.asarray(solid.points) + np.array(section.box.corner)
        return PlacedMesh(solid.moved_unchecked(_moved(section, inside)), {})
    if section.grid is not None and section.grid.periodic:
        if section.rotation is not None:
            raise ValueError("a periodic grid repeats along x and y; take its rotation out")
        flat = periodic_grid(section.grid)
        points = _moved(section, np.asarray(flat.points))
        lengths = np.asarray(flat.side_length) * section.scale
        return PlacedMesh(IntrinsicMesh(flat.topology, lengths, points), {})
    vertex: dict[str, NDArray] = {}
    face: dict[str, NDArray] = {}
    sha256 = ""
    if section.mesh is not None:
        source = read(section.mesh)
        for note in source.notes:
            logging.getLogger("ddgcli").warning("object %s: %s", section.name, note)
        mesh, vertex, sha256, face = source.mesh, source.vertex, source.sha256, source.face
        if volumes and isinstance(mesh, TetMesh):
            return PlacedMesh(mesh.moved_unchecked(_moved(section, np.asarray(mesh.points))), vertex, sha256)
        if not isinstance(mesh, TriangleMesh):
            raise ValueError(kind_error(mesh, ("surface",), path=section.mesh))
    else:
        mesh = shape_mesh(section)
    return PlacedMesh(mesh.moved_unchecked(_moved(section, np.asarray(mesh.points))), vertex, sha256, face)


def shape_mesh(section: Any) -> TriangleMesh:
    """Mesh of a grid, sphere, box or cylinder.

    Parameters
    ----------
    section : object
        Section of the object in the scene.

    Returns
    -------
    TriangleMesh
    """
    if section.grid is not None:
        return grid_mesh(section.grid)
    if section.cylinder is not None:
        return cylinder_mesh(section.cylinder)
    if section.sphere is not None:
        ball = icosphere(section.sphere.subdivisions, section.sphere.radius)
        return ball.moved_unchecked(ball.points + np.array(section.sphere.center))
    nx, ny, nz = section.box.cells
    solid = box(nx, ny, nz, section.box.size)
    return solid.moved_unchecked(solid.points + np.array(section.box.corner))


def cylinder_mesh(side: CylinderSide) -> TriangleMesh:
    """Side of a cylinder; vertex i (cells along + 1) + j is on ring j from the start, diagonals alternate."""
    n_around, n_along = side.cells
    around, height, faces = wrapped_grid(n_around, n_along, wrap_u=True, pattern="alternating")
    start, end, angle = np.array(side.start), np.array(side.end), 2 * np.pi * around
    first, second = tangents((end - start) / np.linalg.norm(end - start))
    ring = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    return TriangleMesh.from_arrays(start + height[:, None] * (end - start) + side.radius * ring, faces)


def on_cylinder(side: Cylinder, points: NDArray) -> NDArray[np.float64]:
    """Move points away from the axis of a cylinder, or towards it, to its radius.

    Parameters
    ----------
    side : Cylinder
    points : (n, 3) ndarray of float64

    Returns
    -------
    (n, 3) ndarray of float64
    """
    start, end = np.array(side.start), np.array(side.end)
    axis = (end - start) / np.linalg.norm(end - start)
    foot = start + ((points - start) @ axis)[:, None] * axis
    return foot + side.radius * unit_vectors(points - foot)


def grid_mesh(grid: Grid) -> TriangleMesh:
    """Flat grid in the plane z = 0."""
    if grid.pattern == "equilateral":
        return _equilateral(grid)
    u, v, faces = _cells(grid, False, False)
    return TriangleMesh.from_arrays(np.stack([grid.size[0] * u, grid.size[1] * v, 0 * u], axis=1), faces)


def _cells(grid: Grid, wrap_u: bool, wrap_v: bool) -> tuple[NDArray, NDArray, NDArray]:
    """Parameters and triangles; `cross` puts a vertex in the middle of every cell."""
    nx, ny = grid.cells
    if grid.pattern != "cross":
        u, v, faces = wrapped_grid(nx, ny, wrap_u, wrap_v, grid.pattern)
        return _graded(u, grid.grading, wrap_u), _graded(v, grid.grading, wrap_v), faces
    u, v, halves = wrapped_grid(nx, ny, wrap_u, wrap_v)
    first, second = halves[0::2], halves[1::2]  # (p00, p10, p11) and (p00, p11, p01)
    i, j = np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij")
    middle = len(u) + np.arange(nx * ny)
    corner = [first[:, 0], first[:, 1], first[:, 2], second[:, 2]]
    faces = np.stack([np.stack([corner[k], corner[(k + 1) % 4], middle], axis=1) for k in range(4)], axis=1)
    u = np.concatenate([u, (i.ravel() + 0.5) / nx])
    v = np.concatenate([v, (j.ravel() + 0.5) / ny])
    return _graded(u, grid.grading, wrap_u), _graded(v, grid.grading, wrap_v), faces.reshape(-1, 3)


def _graded(parameter: NDArray, grading: float, wraps: bool) -> NDArray[np.float64]:
    """Parameters in [0, 1] moved towards 0 and 1: mixed with (1 - cos(pi u)) / 2."""
    if wraps or not grading:
        return parameter
    return (1.0 - grading) * parameter + 0.5 * grading * (1.0 - np.cos(np.pi * parameter))


def _equilateral(grid: Grid) -> TriangleMesh:
    """Rows of equilateral triangles; halves of them at the ends of the rows fill a rectangle.

    The width and the cells decide: the height is that of the rows, and another height causes a warning.
    """
    nx, ny = grid.cells
    height = ny * np.sqrt(0.75) * grid.size[0] / nx
    if abs(height - grid.size[1]) > HEIGHT_TOLERANCE * height:
        logging.getLogger("ddgcli").warning(
            "grid: %d rows of equilateral triangles with %d on a width of %g m are %.6g m high, not %g m",
            ny, nx, grid.size[0], height, grid.size[1],
        )  # fmt: skip
    points: list[tuple[float, float, float]] = []
    rows = []
    for j in range(ny + 1):
        inner = (np.arange(nx + 1) if j % 2 == 0 else np.concatenate([[0], np.arange(nx) + 0.5, [nx]])) / nx
        rows.append(len(points) + np.arange(len(inner)))
        points += [(grid.size[0] * x, height * j / ny, 0.0) for x in inner]
    faces = []
    for j in range(ny):
        low, high = rows[j], rows[j + 1]
        for k in range(nx):
            if j % 2 == 0:
                faces += [(low[k], low[k + 1], high[k + 1]), (low[k], high[k + 1], high[k])]
            else:
                faces += [(low[k], low[k + 1], high[k]), (low[k + 1], high[k + 1], high[k])]
        if j % 2 == 0:
            faces.append((low[nx], high[nx + 1], high[nx]))
        else:
            faces.append((low[nx], low[nx + 1], high[nx]))
    return TriangleMesh.from_arrays(np.array(points), np.array(faces))


def periodic_grid(grid: Grid) -> IntrinsicMesh:
    """Flat torus or cylinder: the sides that wrap have the lengths of the unwrapped rectangle.

    Parameters
    ----------
    grid : Grid
        Periodic along at least one axis.

    Returns
    -------
    IntrinsicMesh
    """
    wrap_u, wrap_v = "x" in grid.periodic, "y" in grid.periodic
    u, v, faces = _cells(grid, wrap_u, wrap_v)
    uv = np.stack([u, v], axis=1)
    step = uv[faces[:, NEXT]] - uv[faces]
    wraps = np.array([wrap_u, wrap_v])
    step = np.where(wraps, step - np.round(step), step)
    length = vector_length(step * np.array(grid.size))
    points = np.column_stack([uv * np.array(grid.size), np.zeros(len(u))])
    return IntrinsicMesh(Topology(faces, len(u)), length, points)


def _moved(section: SurfaceObject, points: NDArray) -> NDArray[np.float64]:
    moved = points * section.scale
    if section.rotation is not None:
        moved = moved @ rotation_matrix(section.rotation.axis, np.radians(section.rotation.degrees)).T
    return moved + np.array(section.position)


def rotation_matrix(axis: Any, angle: float) -> NDArray[np.float64]:
    """Matrix of a rotation about an axis (Rodrigues).

    Parameters
    ----------
    axis : (3,) array_like
        Axis, of any length except zero.
    angle : float
        In radians, counter-clockwise seen against the axis.

    Returns
    -------
    (3, 3) ndarray of float64

    Examples
    --------
    >>> rotation_matrix([0, 0, 2], np.pi / 2).round(12).tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
