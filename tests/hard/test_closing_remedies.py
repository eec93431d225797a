"""Refusals of open surfaces name a repair, and one call of it closes the surface."""

import re

import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.mesh import shapes
from ddgcli.mesh.require import how_to_close
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.cli.test_remedies import touching_voxels, unwelded, unwelded_holes


def touching_in_pieces():
    """The faces of two cubes that share an edge, none sharing a vertex, without two of them."""
    cubes = touching_voxels()
    points = cubes.points[cubes.faces].reshape(-1, 3)
    return TriangleMesh.from_arrays(points, np.arange(len(points)).reshape(-1, 3)[2:])


def open_boxes_on_an_edge():
    """Three boxes without lids, which have an edge of the rim in common but share no vertex there."""
    box = np.array([[x, y, z] for x in (0.0, -1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    faces = [[0, 2, 1], [1, 2, 3], [0, 1, 4], [1, 5, 4], [1, 3, 5], [3, 7, 5], [2, 7, 3], [2, 6, 7]]
    faces += [[4, 5, 6], [5, 7, 6]]
    points = []
    for angle in np.arange(3) * 2 * np.pi / 3:
        x, z = np.cos(angle) * box[:, 0] - np.sin(angle) * box[:, 2], np.sin(angle) * box[:, 0]
        points.append(np.column_stack([x, box[:, 1], z + np.cos(angle) * box[:, 2]]))
    return TriangleMesh.from_arrays(np.concatenate(points), np.concatenate([faces, np.add(faces, 8),
                                                                           np.add(faces, 16)]))  # fmt: skip


def ball_with_wall():
    """A sphere without a face; a cone inside it has the ring of edges around a vertex."""
    sphere = shapes.icosphere(1)
    ring = sphere.faces[(sphere.faces == 0).any(axis=1)]
    sides = np.stack([np.roll(face, -int(np.argmax(face == 0)))[1:] for face in ring])
    cone = np.column_stack([sides, np.full(len(sides), sphere.n_vertices)])
    far = int(sphere.points[sphere.faces].mean(axis=1).dot(sphere.points[0]).argmin())
    faces = np.concatenate([np.delete(sphere.faces, far, axis=0), cone])
    return TriangleMesh.from_arrays(np.concatenate([sphere.points, [0.1 * sphere.points[0]]]), faces)


@pytest.mark.parametrize(
    "mesh, steps",
    [
        (unwelded(), "weld"),
        (unwelded_holes(), "weld fill_holes=4"),
        (touching_in_pieces(), "weld split_fans fill_holes=6"),
        # a weld would make an edge of three faces
        (open_boxes_on_an_edge(), "fill_holes=12"),
        # the split opens loops of five edges, more than the boundary has
        (ball_with_wall(), "fill_holes=18 split_fans"),
    ],
)
def test_one_repair_closes_the_surface(mesh, steps):
    advice = re.search("`repair=(.*)`", how_to_close(mesh)).group(1)
    assert advice == steps
    arguments = dict(word.split("=") if "=" in word else (word, True) for word in advice.split())
    arguments = {name: int(value) if isinstance(value, str) else value for name, value in arguments.items()}
    if "weld" in arguments:
        arguments["weld"] = 0.0
    repaired = ddg.repair_mesh(mesh, **arguments).mesh
    assert repaired.topology.is_closed and repaired.topology.is_manifold


def test_sheets_that_a_split_has_parted_are_not_welded_again():
    book = TriangleMesh.from_arrays(
        np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0.5], [-0.5, 0.8, 0.5], [-0.5, -0.8, 0.5]]),
        np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]),
    )
    sheets = ddg.repair_mesh(book, split_fans=True).mesh
    assert how_to_close(sheets) == (
        "the component of face 0 is a flat sheet, which encloses nothing; extrude it"
    )
