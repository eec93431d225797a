"""Curvature of surfaces and of curves."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ddgcli.algorithms.curvature.offset_body import OffsetBody
from ddgcli.algorithms.curvature.offset_body import offset_body as core_offset_body
from ddgcli.algorithms.curvature.polyline import measure_curves
from ddgcli.algorithms.curvature.region_measures import RegionMeasures, measures_in_ball
from ddgcli.algorithms.curvature.surface_curvature import DEFAULT_SCHEME
from ddgcli.algorithms.curvature.surface_query import labelled_measures, measure_surface, require_regions
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.library.arguments import real_array, real_number
from ddgcli.library.mesh_arguments import accepts_arrays
from ddgcli.library.result import Measurement
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = ["curvature", "curvature_measures", "offset_body"]


@accepts_arrays("surface")
def curvature_measures(
    mesh: TriangleMesh, regions: ArrayLike | None = None, *, ball: tuple[ArrayLike, float] | None = None
) -> RegionMeasures:
    """Curvature measures and tensors of regions of a surface, additive over disjoint regions.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
        Consistently oriented, faces outward.
    regions : (m,) or (n,) array_like of int, optional
        Labels of faces or of vertices; regions in ascending order of their labels.
    ball : (centre, radius), optional
        Instead of `regions`: the part of the surface inside a ball.

    Returns
    -------
    RegionMeasures
        `area`, `phi_k` (integral of the Gaussian curvature), `phi_h` (of the sum of the principal
        curvatures), tensors `anisotropic` and `normal_cycle` (k, 3, 3); one entry per region.

    Raises
    ------
    MeshError
        For faces of opposite orientation.
    ParameterError
        Without `regions` and `ball`, with both, or for labels that do not fit the mesh.

    References
    ----------
    D. Cohen-Steiner, J.-M. Morvan, "Restricted Delaunay triangulations and normal cycle", 2003.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> sphere = ddg.icosphere(2)
    >>> halves = ddg.curvature_measures(sphere, sphere.points[:, 2] > 0)
    >>> round(float(halves.phi_k.sum() / 3.141592653589793), 9)
    4.0
    """
    if (regions is None) == (ball is None):
        raise ParameterError("give either `regions` or `ball`", parameter="regions")
    if ball is not None:
        require_regions(mesh)
        if not isinstance(ball, (tuple, list)) or len(ball) != 2:
            raise ParameterError("give (centre, radius)", parameter="ball")
        centre = np.asarray(real_array(ball[0], "ball"), dtype=np.float64)
        with renamed_parameters(centre="ball", radius="ball"):
            return measures_in_ball(mesh, centre, real_number(ball[1], "ball"))
    with renamed_parameters(array="regions"):
        return labelled_measures(mesh, np.asarray(regions, dtype=np.float64))[0]


@accepts_arrays("surface")
def offset_body(mesh: TriangleMesh, distance: float, *, angle: float = 6.0) -> OffsetBody:
    """Offset body of a closed surface; its volume approaches Steiner's polynomial as its arcs get finer.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
        Closed manifold, faces outward.
    distance : float
        Positive, in length units.
    angle : float
        Largest step of an arc, in degrees.

    Returns
    -------
    OffsetBody
        `mesh`; `part_of_face` (0 over a face, 1 over an edge, 2 over a vertex); `volume`.

    Raises
    ------
    MeshError, ParameterError

    Examples
    --------
    >>> import ddgcli as ddg
    >>> cube = ddg.box(2, 2, 2)
    >>> body = ddg.offset_body(cube, 0.5, angle=5.0)
    >>> c = ddg.curvature(cube).results["steiner_polynomial"]
    >>> round(body.volume / sum(c[k] * 0.5**k for k in range(4)), 2)
    1.0
    """
    return core_offset_body(mesh, distance, angle)


@accepts_arrays("surface", "curve")
def curvature(
    mesh: TriangleMesh | CurveSet,
    scheme: str | None = None,
    radius: float | str | None = None,
    *,
    image: ArrayLike | None = None,
    vertex_vectors: bool = False,
    with_frames: bool = False,
    resample: int | None = None,
    jobs: int = 1,
) -> Measurement:
    """Curvature of a surface by one scheme, or of polylines.

    Parameters
    ----------
    mesh : TriangleMesh, CurveSet or (points, cells) pair
        Faces counter-clockwise seen from outside.
    scheme : {'quadric', 'corrected', 'normal-cycle', 'normal-voting', 'cotan'}, optional
        How mean and principal curvatures of a surface are measured; default 'quadric'.
    radius : float or 'auto', optional
        Radius of the measuring ball, in length units; default the vertex star (two rings for 'quadric').
        'auto' takes the best radius on noisy surfaces, the default on others. 'cotan' has none.
    image : (n, 2) or (n, 3) array_like, optional
        Surfaces: positions of the vertices under a map; `results` has its `dirichlet_energy`, `map_area`
        and their difference `nonconformality`.
    vertex_vectors : bool
        Surfaces: also `H_p` (n, 3), minus the gradient of the area, `volume_gradient` (n, 3), `h_p`, the
        quotient of their lengths, and `gradient_angle` between them (radians).
    with_frames : bool
        Curves: also `arc_length`, `frenet_tangent`, `frenet_normal`, `frenet_binormal`, `bishop_1`,
        `bishop_2`, `osculating_radius`, `osculating_centre`.
    resample : int, optional
        Curves: first resample each curve to this number of points, evenly spaced in arc length.
    jobs : int
        Number of processes for the fits of 'quadric' and for balls; the result does not depend on it.

    Returns
    -------
    Measurement
        Surfaces: `vertex` holds `mean_curvature` (1/length, positive where convex), `gaussian_curvature`
        (1/length^2), `principal_curvature_min`, `principal_curvature_max`, `principal_direction_min`,
        `principal_direction_max` (n, 3), `mean_curvature_normal` (n, 3), `angle_defect` (radians),
        `vertex_area`, `geodesic_curvature`, `boundary`; `edge` holds `edges` (e, 2), `dihedral_angle`
        (radians), `edge_mean_curvature`; `results` the integrals (`area`, `willmore_energy`, ...);
        `accuracy` the residuals of identities (`gauss_bonnet_residual`, ...).
        Curves: `vertex` holds `turning_angle`, `curvature`, `vertex_length`, in space `torsion`.

    Raises
    ------
    MeshError
        No face or segment with size, or a one-sided surface with a scheme that needs two sides.
    ParameterError
        Unknown scheme; a radius for 'cotan'; a scheme or radius for curves.

    References
    ----------
    M. Meyer et al., "Discrete differential-geometry operators for triangulated 2-manifolds", 2003 (cotan).
    D. Cohen-Steiner, J.-M. Morvan, "Restricted Delaunay triangulations and normal cycle", 2003.
    J.-O. Lachaud et al., "Interpolated corrected curvature measures for polygonal surfaces", 2020.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> sphere = ddg.icosphere(3, radius=2.0)
    >>> measured = ddg.curvature(sphere)
    >>> round(float(measured.vertex["mean_curvature"].mean()), 3)
    0.5
    >>> measured.accuracy["gauss_bonnet_residual"] < 1e-12
    True
    """
    if isinstance(mesh, CurveSet):
        own = {"scheme": scheme, "radius": radius, "image": image, "vertex_vectors": vertex_vectors or None}
        for name in (name for name, value in own.items() if value is not None):
            raise ParameterError("belongs to surfaces; leave it out for curves", parameter=name)
        curves = measure_curves(mesh, with_frames=with_frames, resample=resample)
        return Measurement(
            curves.curves, vertex=curves.vertex, results=curves.results, accuracy=curves.accuracy
        )
    if with_frames or resample is not None:
        raise ParameterError(
            "belongs to curves; leave it out for surfaces",
            parameter="with_frames" if with_frames else "resample",
        )
    ball: float | Literal["auto"] | None = "auto"
    if not isinstance(radius, str):
        ball = radius
    elif radius != "auto":
        raise ParameterError(f"must be a length or 'auto', not {radius!r}", parameter="radius")
    measured = measure_surface(
        mesh,
        DEFAULT_SCHEME if scheme is None else scheme,
        ball,
        image=None if image is None else np.asarray(image, dtype=np.float64),
        vertex_vectors=vertex_vectors,
        jobs=jobs,
    )
    return Measurement(
        mesh,
        vertex=measured.vertex,
        edge=measured.edge,
        results=measured.results,
        accuracy=measured.accuracy,
        converged=measured.converged,
    )
