"""Arguments of the builders of effects of `shell-sim`: one shell, and its scene."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, vector_length
from ddgcli.models.shell.scene import Shell
from ddgcli.scenes.scene import Scene
from ddgcli.scenes.sections import Key
from ddgcli.scenes.shapes import PlacedMesh


@dataclass(frozen=True, eq=False)
class ShellContext:
    """One shell of a scene.

    Parameters
    ----------
    shell : Shell
        Section of the shell, with all material parameters.
    mesh : TriangleMesh
        The rest shape, which is also the shape at the start.
    scene : Scene
    arrays : dict of str to ndarray
        Vertex arrays of the mesh file.
    terms : dict of str to list
        Terms that the effects built so far have returned, by effect.
    obstacles : dict of str to PlacedMesh
        Meshes of the obstacles that are meshes, in the coordinates of their files.
    input_vertex : (n,) ndarray of int, optional
        For a shell that has broken: index in the unbroken shell of each vertex.
    """

    shell: Shell
    mesh: TriangleMesh
    scene: Scene
    arrays: dict[str, NDArray] = field(default_factory=dict)
    terms: dict[str, list[Any]] = field(default_factory=dict)
    obstacles: dict[str, PlacedMesh] = field(default_factory=dict)
    input_vertex: NDArray[np.int64] | None = None

    @property
    def vertices_at_start(self) -> NDArray[np.int64]:
        """(n,) index in the unbroken shell of each vertex."""
        return np.arange(self.mesh.n_vertices) if self.input_vertex is None else self.input_vertex

    @property
    def whole(self) -> ShellContext:
        """The shell before it broke; itself if it has not broken."""
        if self.input_vertex is None:
            return self
        n = int(self.input_vertex.max()) + 1
        faces, points = self.input_vertex[self.mesh.faces], np.asarray(self.mesh.points)[:n]
        arrays = {name: values[:n] for name, values in self.arrays.items()}
        mesh = TriangleMesh(points, Topology(faces, n))
        return replace(self, mesh=mesh, arrays=arrays, terms={}, input_vertex=None)

    @property
    def elastic(self) -> list[Any]:
        """Potentials of stretching and bending, which are built before every other effect."""
        return [*self.terms.get("stretching", []), *self.terms.get("bending", [])]

    @cached_property
    def face_area(self) -> NDArray[np.float64]:
        """(m,) areas at rest."""
        side = self.mesh.side_vector
        return 0.5 * vector_length(row_cross(side[:, 0], side[:, 1]))

    @cached_property
    def vertex_area(self) -> NDArray[np.float64]:
        """(n,) a third of the area of the incident faces."""
        third = np.repeat(self.face_area / 3, 3)
        return sum_by_index(self.mesh.faces.ravel(), third, self.mesh.n_vertices)

    @cached_property
    def mass(self) -> NDArray[np.float64]:
        """(n,) mass in kg; a vertex without a face, which is held, has the mean mass."""
        mass = float(self.shell.density or 0) * self.vertex_area
        referenced = self.mesh.topology.referenced_vertex
        mean = mass[referenced].sum() / max(1, np.count_nonzero(referenced))  # what has no face is refused
        return np.where(referenced, mass, mean)

    def selection(self, vertices: list[int] | None, box: Any, key: Key) -> NDArray[np.int64]:
        """Vertices by index, or inside a box given by two opposite corners; an error if there are none."""
        n = self.mesh.n_vertices if self.input_vertex is None else int(self.input_vertex.max()) + 1
        if (vertices is None) == (box is None):
            self.scene.refuse(key, f"{key[-1]}: give either vertices = [...] or box = [[x, y, z], [x, y, z]]")
        if vertices == []:
            self.scene.refuse(key, f"{key[-1]}: vertices = [] names no vertex")
        if vertices is not None:
            outside = [v for v in vertices if not 0 <= v < n]
            if outside:
                self.scene.refuse(key, f"vertex {outside[0]} is outside 0..{n - 1} of {self.shell.name!r}")
            if self.input_vertex is not None:
                return np.flatnonzero(np.isin(self.input_vertex, vertices))
            return np.unique(np.array(vertices, dtype=np.int64))
        low, high = np.sort(np.array(box, dtype=float), axis=0)
        slack = 1e-9 * float(np.ptp(self.mesh.points, axis=0).max())
        inside = ((self.mesh.points >= low - slack) & (self.mesh.points <= high + slack)).all(axis=1)
        if not inside.any():
            ends = " and ".join(f"({', '.join(f'{t:.6g}' for t in end)})" for end in self.mesh.bounding_box)
            self.scene.refuse(
                key,
                f"no vertex of {self.shell.name!r} lies in the box {box}; choose one that holds "
                f"some: they lie between {ends}",
            )
        return np.flatnonzero(inside)
