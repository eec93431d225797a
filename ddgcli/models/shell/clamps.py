"""Clamped edges for mid-edge bending: edges whose director a pin with `clamp` keeps fixed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot, unit_vectors
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.midedge import NO_CLAMP, ClampedSides, inward_directions, side_corners

PARALLEL_TOLERANCE = 1e-6  # sine of the angle below which an edge counts as parallel to an axis


def clamped_sides(context: ShellContext) -> ClampedSides:
    """Sides between vertices of one pin with `clamp`, and the fixed direction perpendicular to each.

    If the pin holds all axes, this is the direction into the face. If it leaves axes free, the edge can move,
    and the direction must be a held one that stays perpendicular to the edge: the normal of a symmetry plane.

    Parameters
    ----------
    context : ShellContext

    Returns
    -------
    ClampedSides

    Raises
    ------
    ValueError
        If an edge is not perpendicular to the axis that its pin holds.
    """
    mesh = context.mesh
    sides, directions = [NO_CLAMP.side], [NO_CLAMP.direction]
    is_clamped = np.zeros(3 * mesh.n_faces, dtype=bool)
    for effect, pin, _ in context.scene.effects:
        if effect.name != "pin" or not pin.clamp or pin.object not in (None, context.shell.name):
            continue
        is_pinned = np.zeros(mesh.n_vertices, dtype=bool)
        is_pinned[context.selection(pin.vertices, pin.box, ("effects", "pin"))] = True
        tail, head = mesh.topology.side_tail, mesh.topology.side_head
        own = np.flatnonzero(is_pinned[tail] & is_pinned[head] & ~is_clamped)
        is_clamped[own] = True
        sides.append(own)
        directions.append(_directions(mesh, own, np.array([axis in pin.axes for axis in "xyz"])))
    return ClampedSides(np.concatenate(sides), np.concatenate(directions))


def _directions(mesh: TriangleMesh, side: NDArray, axes: NDArray) -> NDArray[np.float64]:
    """(c, 3) fixed directions perpendicular to sides whose pin holds `axes` (3,); ValueError without one."""
    x, corner = np.asarray(mesh.points), side_corners(mesh.topology)[side]
    inward = inward_directions(x, corner)
    u = unit_vectors(x[corner[:, 1]] - x[corner[:, 0]])
    if axes.all():
        return inward
    if axes.sum() == 2:
        across = row_cross(u, (~axes).astype(float))
        along = np.linalg.norm(across, axis=1) < PARALLEL_TOLERANCE
        direction = np.where(along[:, None], inward, unit_vectors(np.where(along[:, None], inward, across)))
    else:
        direction = np.broadcast_to(axes.astype(float), u.shape)
        if (np.abs(u @ axes) > PARALLEL_TOLERANCE).any():
            bad = int(np.argmax(np.abs(u @ axes)))
            raise ValueError(
                f"the edge {corner[bad, 0]} {corner[bad, 1]} is not across the axis that "
                "its pin holds, so its direction cannot be clamped; hold all axes, or leave clamp out"
            )
    sign = np.where(row_dot(direction, inward) < 0, -1.0, 1.0)
    return sign[:, None] * direction
