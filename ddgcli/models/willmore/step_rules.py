"""Numbers that rule the steps of a flow: lengths, acceptance, rest."""

import math

import numpy as np

# steps of the descent, for a surface with the area of the unit sphere
MAX_DESCENT_STEP, MIN_DESCENT_STEP = 0.05, 1e-14
MAX_AREA_STEP, FIRST_AREA_STEP_SHARE = 10.0, 1e-3  # of the descent of an area, likewise
FILM_DECREASE, FILM_ROUNDING = 0.25, 1e-10
SLIDING_FALL = 1e-3  # relative fall of a film's energy in a step, below which no vertex slides
MOTION_FRACTIONS = (1.0, 0.25, 0.0625)  # of a motion, tried before a shorter step is factorised
MOMENTUM_SHARE = 0.9  # part of the last step's motion that is added to the next one
KEPT_FALL_SHARE = 0.5  # of the energy's fall in a step, that slides and flips must leave
SUFFICIENT_DECREASE = 0.01  # of the predicted fall, for a step of the descent to be accepted
# a surface is near rest where steps above that share of the longest predict a fall below that of the energy
NEAR_REST_STEP_FRACTION, NEAR_REST_ENERGY_FRACTION = 0.01, 0.1
# share of the least energy of its topology: an energy below it is discretisation error
LOWER_BOUND_FRACTION = 0.9
# the same of Newton steps with `gauss-map` on vesicles, whose energy is at least 4 pi: where the reduced
# volume is above 0.94, 0.9 W_least < 4 pi, a bound that no mesh reaches. It is not used where the start has
# less than 0.975 W_least: a coarse polyhedron encloses less volume than its smooth surface
VESICLE_BOUND_FRACTION = 0.975
# share of H0^2 A, the size of the terms of a Helfrich energy: below minus that it is discretisation error
HELFRICH_ERROR_FRACTION = 0.1
# relative rise of a second energy over its lowest value, at which the flow ends if the first has since fallen
# by less than that
SECOND_ENERGY_RISE = 0.01
# ratio of the second energy to the first, above which a rise ends a flow of `cotan`: on meshes that do not
# crumple `gauss-map` rises too, up to a ratio of 1.12, for a few long steps
CRUMPLING_RATIO = 1.2
AGREEMENT_RATIO = 1.05  # ratio of the two energies up to which the surface is then at rest
MIN_CONFORMAL_SHARE = 1.0 / 64.0  # of the curvature's way to a constant, for a conformal step
# of the energy, in what the class lets the curvature lose where steps end, up to which that is rest
CONFORMAL_REST_SHARE = 0.005
# of the least energy, above which a surface that could become round, or a torus of Clifford, is not at rest
SPHERE_REST_FRACTION, FALSE_REST_FRACTION = 1.02, 1.05
# share of 4 pi, times the number of vertices, by which an energy of spheres' meshes may exceed it at rest
# (sullivan: 2 on good triangles, 3.6 on random ones)
SPHERE_EXCESS = {"gauss-map": 0.0, "cotan": 0.0, "sullivan": 3.5}
KNOT_ENERGY = 8.0 * np.pi  # tori of less are embedded and unknotted (Li, Yau 1982)
ZERO_ENERGY = 1e-12  # energy at which nothing is left to release
# relative predicted fall of the energy below which rounding decides: the surface is kept
PREDICTED_FALL_TOLERANCE = 1e-13
COLLAPSED_AREA_FRACTION = 1e-3  # share of its area at the start below which a component counts as gone
FOLDED_AREA_FRACTION = 0.5  # share of the area on faces that are folded over, above which it is one of lines
ENERGY_ROUNDING = 1e-13  # relative rise of the energy that counts as one
# size of the gradient, and relative fall of the energy in a step, at which flows end by default
REST_GRADIENT, NEWTON_REST_GRADIENT, REST_FALL = 1e-6, 1e-9, 1e-8
FILM_REST_FALL = 1e-17  # the same of films: less is rounding
# relative fall of the energy in a Newton step, below which a surface that could become round is stuck above
LEAST_NEWTON_FALL = 1e-4


def round_energy(energy: str, least: float, n_vertices: int) -> float:
    """Energy above which surfaces that must become round spheres are not at rest.

    Parameters
    ----------
    energy : str
        Of ENERGIES.
    least : float
        Of the round spheres.
    n_vertices : int

    Returns
    -------
    float
        Infinite for energies that are not near `least` on spheres.
    """
    if energy not in SPHERE_EXCESS:
        return math.inf
    return least * (SPHERE_REST_FRACTION + SPHERE_EXCESS[energy] / n_vertices)


def least_share(promised: float, energy: float, of_area: bool) -> float:
    """Share of the fall that the slope promises, for a step to be accepted; of films more, as they overshoot.

    Parameters
    ----------
    promised, energy : float
    of_area : bool
        The energy is an area or a volume.

    Returns
    -------
    float
    """
    rounded = promised < FILM_ROUNDING * abs(energy)
    return FILM_DECREASE if of_area and not rounded else SUFFICIENT_DECREASE


def is_near_rest(before: float, after: float) -> bool:
    """Whether a film's energy fell by so little that slides would disturb its rest.

    Parameters
    ----------
    before, after : float
        Energies.

    Returns
    -------
    bool
    """
    return before - after <= SLIDING_FALL * abs(after)


def second_rises(second: float, lowest: float, fall: float) -> bool:
    """Whether a second energy is above its lowest value, and by more than the first has since fallen.

    Parameters
    ----------
    second, lowest, fall : float

    Returns
    -------
    bool
    """
    return second - lowest > max(SECOND_ENERGY_RISE * lowest, fall)


def agree(one: float, other: float) -> bool:
    """Whether two energies are nearly equal.

    Parameters
    ----------
    one, other : float

    Returns
    -------
    bool
    """
    return 1.0 / AGREEMENT_RATIO < one / other < AGREEMENT_RATIO
