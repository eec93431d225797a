"""Light, outlines and several samples a pixel in the pictures of surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.extrinsic import face_area_vector, face_normal
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.sides import next_side
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_dot
from ddgcli.plots.raster import (
    OUTLINE_DEPTH_STEP,
    Camera,
    PixelFaces,
    barycentric_at,
    interpolated,
)

_LIGHT = np.array([-0.35, 0.45, 0.82]) / np.linalg.norm([-0.35, 0.45, 0.82])
CREASE_COSINE = np.cos(np.radians(40.0))  # faces with a larger angle are shaded separately
SAMPLES = 2  # each way within a pixel
LINE_WIDTH = 0.6 * SAMPLES  # of drawn sides, to each side, in samples
OUTLINE_LIGHT = 0.35


@dataclass(frozen=True, eq=False)
class ShadingSpots:
    """Places on faces that give the colours of a picture of several samples a pixel.

    Parameters
    ----------
    whole : (h, w) ndarray of bool
        Pixels that show one face in all samples: one spot each, at their centre.
    sample : (k,) ndarray of int64
        Flat indices of the samples of other pixels that show a face: the further spots.
    face : (s,) ndarray of int32
        Face of each spot; spots of whole pixels come first.
    barycentric : (s, 3) ndarray of float64
    """

    whole: NDArray[np.bool_]
    sample: NDArray[np.int64]
    face: NDArray[np.int32]
    barycentric: NDArray[np.float64]


def shading_spots(
    visible: PixelFaces, *, every_sample: bool = False, heights: NDArray | None = None
) -> ShadingSpots:
    """Spots of a picture.

    Parameters
    ----------
    visible : PixelFaces
        Visible faces of the samples.
    every_sample : bool
        No pixel is whole, for colours that jump within a face.
    heights : (m, 3) ndarray, optional
        Heights from `altitude`, if sides of faces are drawn: pixels near them are divided.

    Returns
    -------
    ShadingSpots
    """
    face = visible.face_image
    first, *others = _samples_of_pixels(face)
    whole = np.logical_and.reduce([first >= 0, *(first == other for other in others)])
    if every_sample:
        whole[:] = False
    row, column = np.nonzero(whole)
    of_whole = first[whole]
    at_centre = barycentric_at(visible.corners, of_whole, (column + 0.5) * SAMPLES, (row + 0.5) * SAMPLES)
    if heights is not None:
        is_far = _side_distance(at_centre, of_whole, heights) > LINE_WIDTH + 0.5 * SAMPLES
        whole[row[~is_far], column[~is_far]] = False
        of_whole, at_centre = of_whole[is_far], at_centre[is_far]
    mixed = face >= 0
    height, width = (side - side % SAMPLES for side in face.shape)
    mixed[height:], mixed[:, width:] = False, False
    for samples in _samples_of_pixels(mixed):
        samples[whole] = False
    sample = np.flatnonzero(mixed)
    row, column = np.divmod(sample, face.shape[1])
    of_samples = face.ravel()[sample]
    at_samples = barycentric_at(visible.corners, of_samples, column + 0.5, row + 0.5)
    return ShadingSpots(
        whole, sample, np.concatenate([of_whole, of_samples]), np.concatenate([at_centre, at_samples])
    )


def _side_distance(barycentric: NDArray, face: NDArray, heights: NDArray) -> NDArray[np.float64]:
    """(s,) distance to the nearest side of the face, in samples."""
    a, b, c = (barycentric[:, k] * heights[:, k][face] for k in range(3))
    return np.minimum(np.minimum(a, b), c)


def _samples_of_pixels(samples: NDArray) -> list[NDArray]:
    """Views of an image, one for each place of a sample within a pixel."""
    height, width = (side - side % SAMPLES for side in samples.shape[:2])
    places = range(SAMPLES)
    return [samples[i:height:SAMPLES, j:width:SAMPLES] for i in places for j in places]


def _corner_normals(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(m, 3, 3) normals for shading: mean over the faces of a vertex between creases."""
    area_vector = face_area_vector(mesh)
    area_vector = area_vector / (np.abs(area_vector).max(initial=0.0) or 1.0)
    flat, topology, n = face_normal(mesh), mesh.topology, 3 * mesh.n_faces
    twin, side = topology.side_twin.ravel(), topology.interior_sides
    smooth = side[row_dot(flat[side // 3], flat[twin[side] // 3]) > CREASE_COSINE]
    # corners of two faces that meet across a smooth side, at both of its ends
    a, b = (np.stack([s, next_side(s)], axis=1) for s in (smooth, twin[smooth]))
    corner = mesh.faces.ravel()
    b = np.where((corner[a[:, :1]] == corner[b[:, :1]]), b, b[:, ::-1])
    count, group = connected_labels(a, b, n)
    total = sum_by_index(group, np.repeat(area_vector, 3, axis=0), count)
    size = np.linalg.norm(total, axis=1, keepdims=True)
    mean = (total / np.maximum(size, 1e-300))[group].reshape(-1, 3, 3)
    return np.where((size[group] > 0).reshape(-1, 3, 1), mean, flat[:, None, :])


def brightness(
    camera: Camera,
    mesh: TriangleMesh,
    spots: ShadingSpots,
    *,
    heights: NDArray | None = None,
    from_below: bool = False,
    shade_backs: bool = True,
) -> NDArray[np.float64]:
    """Brightness of each spot, of smooth normals between creases.

    Parameters
    ----------
    camera : Camera
        Over the samples.
    mesh : TriangleMesh
    spots : ShadingSpots
    heights : (m, 3) ndarray, optional
        Heights from `altitude`; the sides of the faces are drawn darker.
    from_below : bool
        Whether the camera is below; the light is then below, too, and reaches the visible side.
    shade_backs : bool
        Backs of faces of an open surface are darker than fronts.

    Returns
    -------
    (s,) ndarray of float64
        Factor of the colour.
    """
    corner_normals = _corner_normals(mesh) @ camera.axes.T
    x, y, z = (interpolated(spots.barycentric, spots.face, corner_normals[..., axis]) for axis in range(3))
    length = np.sqrt(x * x + y * y + z * z)
    behind = z < 0
    light = _LIGHT * [1, -1 if from_below else 1, 1]
    towards_light = (light[0] * x + light[1] * y + light[2] * z) / np.maximum(length, 1e-300)
    shade = 0.60 + 0.45 * np.maximum(np.where(behind, -towards_light, towards_light), 0.0)
    if shade_backs and not mesh.topology.is_closed:
        shade[behind] *= 0.8
    if heights is not None:
        distance = _side_distance(spots.barycentric, spots.face, heights)
        shade *= 0.45 + 0.55 * np.clip(distance / LINE_WIDTH, 0, 1)
    return shade


def picture_of_spots(visible: PixelFaces, spots: ShadingSpots, colour: NDArray) -> NDArray[np.uint8]:
    """Picture on white paper with dark outlines, averaged over the samples of each pixel.

    Parameters
    ----------
    visible : PixelFaces
        Visible faces of the samples.
    spots : ShadingSpots
    colour : (s, 3) ndarray
        Colour of each spot, in [0, 1].

    Returns
    -------
    (h, w, 4) ndarray of uint8
        Opaque.
    """
    outline, n_whole = _outline(visible.depth), len(colour) - len(spots.sample)
    count = np.add.reduce([samples.view(np.uint8) for samples in _samples_of_pixels(outline)])
    paper = 255 - np.float32(255 * (1 - OUTLINE_LIGHT) / SAMPLES**2) * count
    picture = np.full((*paper.shape, 4), 255, dtype=np.uint8)
    picture[..., :3] = np.rint(paper)[..., None]
    picture[spots.whole, :3] = np.rint(colour[:n_whole] * paper[spots.whole, None])
    if len(spots.sample):
        row, column = np.divmod(spots.sample, outline.shape[1])
        light = np.where(outline.ravel()[spots.sample], OUTLINE_LIGHT, 1.0) * (255 / SAMPLES**2)
        pixel = (row // SAMPLES) * paper.shape[1] + column // SAMPLES
        mixed = np.flatnonzero(np.bincount(pixel))
        for axis in range(3):  # the colour of a face takes the place of the paper
            change = np.bincount(pixel, (colour[n_whole:, axis] - 1) * light)[mixed]
            picture.reshape(-1, 4)[mixed, axis] = np.rint(np.maximum(paper.ravel()[mixed] + change, 0))
    return picture


def _outline(depth: NDArray) -> NDArray[np.bool_]:
    """Mask of the outlines, where the depth jumps."""
    step = OUTLINE_DEPTH_STEP * max(depth.shape)
    edge = np.zeros(depth.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        for axis in (0, 1):
            jump = np.diff(depth, axis=axis)
            ahead, back = [slice(None)] * 2, [slice(None)] * 2
            ahead[axis], back[axis] = slice(1, None), slice(None, -1)
            edge[tuple(back)] |= jump > step
            edge[tuple(ahead)] |= jump < -step
    return edge
