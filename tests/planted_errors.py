"""Functions that replace a function of the program by a wrong one, for tests of accuracy fields."""

import dataclasses

import numpy as np


def surface(**corrupt):
    """What curvature has measured, with one array wrong."""

    def plant(sound):
        return lambda result: sound(
            dataclasses.replace(
                result, **{name: wrong(getattr(result, name)) for name, wrong in corrupt.items()}
            )
        )

    return plant


def first_wrong(values):
    values = np.array(values, dtype=float)
    values.flat[0] += 0.01 * (np.abs(values).max() or 1.0)
    return values


def crooked(**changed):
    """A function whose result has fields wrong."""

    def plant(sound):
        def wrong(*args, **kwargs):
            result = sound(*args, **kwargs)
            fields = {name: change(getattr(result, name)) for name, change in changed.items()}
            return dataclasses.replace(result, **fields)

        return wrong

    return plant


def unequal(distance):
    """Each answer wrong by another factor, so that there and back differ."""
    source = int(np.argmin(distance))
    return distance * (1.0 + 0.1 * (source % 7))


def rougher(sound):
    """Twice the distance where there is any slack."""

    def wrong(wavefront, *args, **kwargs):
        sound(wavefront, *args, **kwargs)
        if wavefront.slack > 0:
            wavefront.distance *= 2.0

    return wrong


def crooked_turn(arrays):
    return arrays | {"turning_angle": first_wrong(arrays["turning_angle"])}


def mixed(components):
    return (components[0] + components[1], *components[1:])


def heavy(M):
    M = M.tolil()
    M[0, 0] += M.sum()
    return M.tocsr()


def eigenvectors(sound):
    return lambda L, M, values, X, *rest, **how: sound(L, M, values, scattered(X), *rest, **how)


def lopsided(L):
    L = L.tolil()
    L[0, 5] += 1.0
    return L.tocsr()


def stepping(change):
    """The time loop with a model whose every step ends a little wrong."""

    def plant(sound):
        def wrong(models, *rest):
            def bad(model):
                return dataclasses.replace(model, advance=lambda *a: change(model.advance(*a)))

            return sound({name: bad(model) for name, model in models.items()}, *rest)

        return wrong

    return plant


def scattered(points, size=1e-2):
    return points + size * np.random.default_rng(0).normal(size=np.shape(points))


def motion(state):
    return dataclasses.replace(state, x=scattered(state.x, 1e-3), v=scattered(state.v, 10.0))


def spun(state):
    return state.replaced(vorticity=1.01 * state["vorticity"] + 1e-3)


def bulged(state):
    return dataclasses.replace(state, points=scattered(state.points))


def returned(change):
    return lambda sound: lambda *args, **kwargs: change(sound(*args, **kwargs))


def bent(lines):
    """Recorded traces whose second point lies elsewhere on its side."""
    b = _moved_on_sides(lines.path_barycentric, lines.path_start[:-1] + 1)
    return dataclasses.replace(lines, path_barycentric=b)


def bent_halfedge(points):
    """Points of a traced halfedge, of which the second lies elsewhere on its side."""
    face, barycentric, rest = points
    return face, _moved_on_sides(barycentric, np.arange(1, min(2, len(face)))), rest


def _moved_on_sides(barycentric, i):
    b = barycentric.copy()
    low, high = np.argsort(b[i], axis=1)[:, 1:].T
    b[i, low], b[i, high] = 0.3 * b[i, low], b[i, high] + 0.7 * b[i, low]
    return b


def rougher_steps(sound):
    """Runge and Kutta's method with the weights of Euler's."""
    return lambda tracer, field, at, h, order: sound(tracer, field, at, h, 1)
