"""Every term of the shell: gradient and Hessian against finite differences, rest, invariances."""

from unittest.mock import patch

import numpy as np
import pytest

from ddgcli.io.scene_file import parse_scene
from ddgcli.mechanics import pieces
from ddgcli.mechanics.embedding import Rows, embedded
from ddgcli.mechanics.rounding import Rounding
from ddgcli.mechanics.system import System
from ddgcli.mechanics.terms import (
    OPTIONAL_MEMBERS,
    Dissipation,
    FixedCoordinates,
    Memory,
    Potential,
    PrescribedMotion,
    Term,
)
from ddgcli.mesh.shapes import icosphere
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import EFFECTS, KIND
from ddgcli.models.shell.stretching import StVK
from ddgcli.scenes.scene import resolve
from ddgcli.scenes.shapes import rotation_matrix
from ddgcli.simulation.account import Account
from tests.simulate import shell_run

OBSTACLE = """
[[object]]
name = "floor"
role = "obstacle"
plane = { point = [0, 0, -0.05], normal = [0.1, 0.2, 1] }
[[object]]
name = "ball"
role = "obstacle"
sphere = { center = [0.5, 0.5, -1.05], radius = 1 }
[[object]]
name = "crate"
role = "obstacle"
box = { corner = [0.2, 0.3, -0.5], size = [0.4, 0.3, 0.4] }
rotation = { axis = [1, 2, 0], degrees = 7 }
[[object]]
name = "log"
role = "obstacle"
cylinder = { start = [0.2, 0.55, -0.3], end = [0.7, 0.6, -0.3], radius = 0.2 }
velocity = [1, 2, 3]
"""
CURVED = "sphere = { radius = 1, subdivisions = 1 }\nposition = [0, 0, 3]"
FLAT_GRID = 'grid = { size = [1, 1.2], cells = [3, 4], pattern = "alternating" }'
DAMPED = """
[time]
duration = {duration}
step = 1e-4
integrator = "verlet"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [1, 1], cells = [3, 3] }}
material = "felt"
thickness = 1e-3
[effects]
stretching = {{}}
bending = {{}}
gravity = {{}}
damping = {{ stiffness = 1e-6 }}
"""
KINDS = (Potential, Dissipation, Memory, FixedCoordinates, PrescribedMotion)
# effect line -> shape; every effect of the table is in at least one (test_table_is_covered)
TERMS = {
    "stretching-edges": ('stretching = { model = "edges" }', CURVED),
    "stretching-edges-area": ('stretching = { model = "edges-area" }', CURVED),
    "stretching-stvk": ('stretching = { model = "stvk" }', CURVED),
    "bending-hinge": ('bending = { model = "hinge" }', CURVED),
    "bending-flat": ('bending = { model = "hinge", rest = "flat" }', CURVED),
    "bending-midedge": ('bending = { model = "midedge" }', CURVED),
    "bending-midedge-flat": ('bending = { model = "midedge", rest = "flat" }', FLAT_GRID),
    "damping-midedge": ('bending = { model = "midedge" }\ndamping = { stiffness = 0.1 }', CURVED),
    "bending-cubic": ('bending = { model = "cubic" }', CURVED),
    "bending-quadratic": ('bending = { model = "quadratic" }', CURVED),
    "gravity": ("gravity = {}", CURVED),
    "load-force": ("load = { force = [1, 2, 3], vertices = [0, 3] }", CURVED),
    "load-moment": ("load = { moment = 0.3, edge = [0, 6] }", FLAT_GRID),
    "damping-mass": ("damping = { mass = 2 }", CURVED),
    "damping-stiffness": ("stretching = {}\nbending = {}\ndamping = { stiffness = 0.1 }", CURVED),
    "damping-edges": ('stretching = { model = "edges-area" }\ndamping = { stiffness = 0.1 }', CURVED),
    "damping-quadratic": ('bending = { model = "quadratic" }\ndamping = { stiffness = 0.1 }', CURVED),
    "damping-cubic": ('bending = { model = "cubic" }\ndamping = { stiffness = 0.1 }', CURVED),
    "contact": ('contact = { pairs = [["s", "floor"], ["s", "ball"]], gap = 0.2 }', FLAT_GRID),
    "friction": ('contact = { pairs = [["s", "floor"]], gap = 0.2, friction = 0.4, slip = 0.3 }', FLAT_GRID),
    "contact-box": ('contact = { pairs = [["s", "crate"]], gap = 0.3 }', FLAT_GRID),
    "contact-cylinder": ('contact = { pairs = [["s", "log"]], gap = 0.3, friction = 0.4 }', FLAT_GRID),
    "attach": ('attach = { object = "s", to = "floor", vertices = [0] } # contact', FLAT_GRID),
    "handle": ("handle = { vertices = [0], times = [0, 1], positions = [[0, 0, 0], [0, 0, 1]] }", FLAT_GRID),
    "pressure": ("pressure = { value = 20 }", CURVED),
    "gas": ("pressure = { value = 20, gas = true, ambient = 50 }", CURVED),
    "wind": ('wind = { velocity = ["2 + x", 1, "0.5*z"], tangential = 0.4 }', CURVED),
    "plasticity": ("stretching = {}\nbending = {}\nplasticity = { yield_strain = 0.01 }", CURVED),
    "pin": ("pin = { vertices = [0] }", FLAT_GRID),
}
NOT_FORCES = {"fracture", "rigid"}  # effects that open edges or keep lengths: tests of their own
FORCES = [name for name in TERMS if name not in ("attach", "handle", "pin")]  # the others hold coordinates


def scene_text(effect, shape, time="", obstacles=OBSTACLE):
    poisson = 0.45 if "edges-area" in effect else 0.3
    return f"""
[time]
{time}
[[object]]
name = "s"
role = "shell"
material = "rubber"
young = 1000
thickness = "1 cm"
poisson = {poisson}
density = 1.0
{shape}
{obstacles if "contact" in effect else ""}
[effects]
{effect}
"""


def system_of(effect, shape, time=""):
    scene = resolve(parse_scene(scene_text(effect, shape, time)), KIND)
    (context, _) = model.contexts(scene, None)["s"]
    return context, model.make_system(scene, context, Account())


def moved(context, seed=0, size=0.05):
    x = np.asarray(context.mesh.points)
    return x + size * np.random.default_rng(seed).normal(size=x.shape)


def potentials(name):
    """Potentials of a row of the table, at a state; dissipation frozen, as a potential of the velocity."""
    effect, shape = TERMS[name]
    context, system = system_of(effect, shape)
    x = moved(context, size=0.02 if "contact" in effect else 0.05)
    conservative = [(p, x) for p in system.potentials]
    v = np.random.default_rng(1).normal(size=x.shape)
    terms = conservative + [(d.frozen(x, 0.01), v) for d in system.dissipations]
    assert terms, f"{name} adds no term"
    return terms


def numerical_gradient(f, x, h):
    g = np.zeros(x.size)
    for k in range(x.size):
        step = np.zeros(x.size)
        step[k] = h
        up, down = f(x + step.reshape(x.shape)), f(x - step.reshape(x.shape))
        g[k] = (up - down) / (2 * h) if np.ndim(up) == 0 else np.nan
    return g.reshape(x.shape)


def dense(stencil, blocks, n):
    """Hessian over 3 n coordinates; internal unknowns, which numbers from n on stand for, are eliminated."""
    rows = max(int(stencil.max()) + 1, n)
    matrix = np.zeros((3 * rows, 3 * rows))
    for vertices, block in zip(stencil, blocks):
        dofs = (3 * vertices[:, None] + np.arange(3)).ravel()
        np.add.at(matrix, np.ix_(dofs, dofs), block)  # a vertex may stand twice in an element
    outer, inner = np.arange(3 * n), np.arange(3 * n, 3 * rows, 3)
    mixed = matrix[np.ix_(outer, inner)]
    return matrix[: 3 * n, : 3 * n] - mixed @ np.linalg.solve(matrix[np.ix_(inner, inner)], mixed.T)


def test_table_is_covered():
    named = {word for effect, _ in TERMS.values() for word in EFFECTS if f"{word} =" in effect}
    assert named == set(EFFECTS) - NOT_FORCES


@pytest.mark.parametrize("name", FORCES)
def test_gradients_equal_finite_differences(name):
    for p, x in potentials(name):
        g = p.gradient(x)
        estimate = numerical_gradient(p.energy, x, 1e-5)
        assert np.abs(g).max() > 0
        assert np.abs(g - estimate).max() <= 1e-6 * np.abs(g).max()


@pytest.mark.parametrize("name", FORCES)
def test_hessians_equal_finite_differences(name):
    for p, x in potentials(name):
        if len(p.stencil) == 0:
            continue
        n = len(x)
        hessian = dense(p.stencil, p.blocks(x, "exact"), n)
        if p.low_rank is not None:
            hessian += np.outer(p.low_rank(x), p.low_rank(x))
        estimate = np.zeros_like(hessian)
        h = 1e-5
        for k in range(3 * n):
            step = np.zeros(3 * n)
            step[k] = h
            step = step.reshape(n, 3)
            estimate[k] = ((p.gradient(x + step) - p.gradient(x - step)) / (2 * h)).ravel()
        assert np.abs(hessian - hessian.T).max() <= 1e-12 * np.abs(hessian).max()
        assert np.abs(hessian - estimate).max() <= 1e-6 * np.abs(hessian).max()


@pytest.mark.parametrize("name", [n for n in TERMS if n.startswith(("stretching", "bending"))])
def test_products_with_the_material_hessian_are_those_of_its_blocks(name, monkeypatch):
    monkeypatch.setattr(pieces, "MIN_PIECE", 7)
    v = np.random.default_rng(2).normal(size=moved(system_of(*TERMS[name])[0]).shape)
    for whole, x in potentials(name):
        for p in (whole, pieces.in_pieces(whole)):
            expected = dense(p.stencil, p.blocks(x, "material"), len(x)) @ v.ravel()
            product = p.material_operator(x)(v).ravel()
            assert np.abs(product - expected).max() <= 1e-12 * np.abs(expected).max()


def blocks_made(duration):
    """Calls of `pair_blocks` in a run of the damped shell."""
    calls, pair_blocks = [], StVK.pair_blocks

    def counted(self, x, mode):
        calls.append(mode)
        return pair_blocks(self, x, mode)

    with patch.object(StVK, "pair_blocks", counted):
        shell_run(DAMPED.format(duration=duration))
    return len(calls)


def test_explicit_steps_with_damping_make_no_blocks():
    assert blocks_made(1e-3) == blocks_made(1e-2) > 0  # of the limit of the step


@pytest.mark.parametrize("name", FORCES)
def test_projected_blocks_are_positive(name):
    for p, x in potentials(name):
        if len(p.stencil):
            least = np.linalg.eigvalsh(p.blocks(x, "projected"))
            assert least.min() >= -1e-10 * np.abs(least).max()


@pytest.mark.parametrize("name", FORCES)
def test_scale_of_rounding_has_the_trace_of_the_hessian(name):
    for p, x in potentials(name):
        trace = np.einsum("kii->", p.blocks(x, "material")) if len(p.stencil) else 0.0  # of a dead load
        stiffness = Rounding.at([p], np.ones(len(x)), x).stiffness
        assert stiffness == pytest.approx(trace, rel=1e-12, abs=0)


@pytest.mark.parametrize("name", [n for n in TERMS if n.startswith(("stretching", "bending"))])
def test_elastic_energy_does_not_feel_rigid_motion(name):
    turn = rotation_matrix((1, 2, 3), 0.7)
    for p, x in potentials(name):
        other = x @ turn.T + [1.0, -2.0, 0.5]
        assert p.energy(other) == pytest.approx(p.energy(x), rel=1e-11)
        spin = np.cross(np.array([0.3, -1, 0.4]), x)
        scale = np.abs(p.blocks(x, "exact")).max()
        assert np.abs(p.gradient(x).sum(axis=0)).max() <= 1e-10 * scale
        if name not in (
            "bending-quadratic",
            "bending-cubic",
        ):  # its Hessian is constant, so its material part is not frame-invariant
            material = dense(p.stencil, p.blocks(x, "material"), len(x))
            assert np.abs(material @ spin.ravel()).max() <= 1e-10 * scale


@pytest.mark.parametrize("effect", ['stretching = { model = "edges" }', "stretching = {}", "bending = {}"])
@pytest.mark.parametrize("shape", [CURVED, FLAT_GRID])
def test_rest_shape_is_at_rest(effect, shape):
    context, system = system_of(effect, shape)
    x = np.asarray(context.mesh.points)
    assert abs(system.potentials[0].energy(x)) <= 1e-20
    assert np.abs(system.gradient(x)).max() <= 1e-12 * np.abs(system.gradient(moved(context))).max()


def test_edges_and_areas_have_the_moduli_of_the_material_on_equilateral_triangles():
    """Energy of a small homogeneous strain against plane stress, Young's modulus 1000 Pa, 1 cm thick."""
    shape = 'grid = { size = [1, 0.8660254037844386], cells = [4, 4], pattern = "equilateral" }'
    context, system = system_of('stretching = { model = "edges-area" }', shape)
    _, exact = system_of("stretching = {}", shape)
    (membrane,) = exact.potentials
    nu, y = 0.45, 1000 * 0.01
    membrane.lam, membrane.mu = y * nu / (1 - nu**2), y / (2 * (1 + nu))
    x = np.asarray(context.mesh.points)
    for strain in ([[1, 0], [0, 0]], [[0, 1], [1, 0]], [[1, 0], [0, -0.4]]):
        moved = x.copy()
        moved[:, :2] += 1e-5 * x[:, :2] @ np.array(strain)
        energy = sum(p.energy(moved) for p in system.potentials)
        # halves of triangles at the ends of the rows have other moduli; without areas 17 % are missing
        assert energy == pytest.approx(membrane.energy(moved), rel=0.12)


def test_flat_shell_has_no_quadratic_bending_force_and_a_bent_one_the_hinge_energy():
    context, system = system_of('bending = { model = "quadratic" }', FLAT_GRID)
    quadratic = system.potentials[0]
    hinge = system_of("bending = {}", FLAT_GRID)[1].potentials[0]
    x = np.asarray(context.mesh.points)
    sheared = x @ np.array([[1.2, 0.3, 0], [0.1, 0.9, 0], [0, 0, 1]])
    assert np.abs(quadratic.gradient(sheared)).max() < 1e-12 * np.abs(quadratic.matrix).max()
    radius = 20.0
    rolled = np.stack([radius * np.sin(x[:, 0] / radius), x[:, 1], radius * np.cos(x[:, 0] / radius)], axis=1)
    assert quadratic.energy(rolled) == pytest.approx(hinge.energy(rolled), rel=1e-3)


def test_bending_scales_as_it_should():
    """Uniform scale: bending energy unchanged, stretching energy by the square (chapter 4)."""
    mesh = icosphere(1)
    x = mesh.points * 1.0
    for scale in (1e-3, 1e3):
        shape = f"sphere = {{ radius = {scale}, subdivisions = 1 }}"
        bent = np.array(x) * [1, 1, 1.1]
        small = system_of("bending = {}", shape)[1].potentials[0]
        one = system_of("bending = {}", "sphere = { radius = 1, subdivisions = 1 }")[1].potentials[0]
        assert small.energy(bent * scale) == pytest.approx(one.energy(bent), rel=1e-12)
        small = system_of("stretching = {}", shape)[1].potentials[0]
        one = system_of("stretching = {}", "sphere = { radius = 1, subdivisions = 1 }")[1].potentials[0]
        assert small.energy(bent * scale) == pytest.approx(scale**2 * one.energy(bent), rel=1e-11)


@pytest.mark.parametrize("name", TERMS)
def test_each_term_of_an_effect_is_of_exactly_one_kind(name):
    """A term that is a function of time alone is at each time a potential or a dissipation."""
    scene = resolve(parse_scene(scene_text(*TERMS[name])), KIND)
    (context, _) = model.contexts(scene, None)["s"]
    terms = model.terms_of(scene, context)
    assert terms
    for term in terms:
        kinds = [kind for kind in KINDS if isinstance(term, kind)]
        if not kinds:
            assert isinstance(term, Term) and term.at is not None
            kinds = [kind for kind in KINDS[:2] if isinstance(term.at(0.0), kind)]
        assert len(kinds) == 1, type(term)


def test_a_term_of_no_kind_is_refused():
    class Misspelt(Potential):
        def energy(self, x):
            return 0.0

        def gradiant(self, x):
            return np.zeros_like(x)

        def blocks(self, x, mode):
            return np.zeros((0, 3, 3))

    class Nothing(Term):
        name = "nothing"

    class Once(Term):
        def at(self, time):
            return Nothing()

    with pytest.raises(TypeError, match="gradient"):
        Misspelt()
    for term in (Nothing(), Once(), object()):
        with pytest.raises(TypeError, match="is neither a potential nor a dissipation"):
            System(np.ones(3), [term], Account(), np.eye(3))


BEFORE, BEHIND = 2, 3  # vertices of other objects in a system


def same(a, b):
    """Whether two values of a term, `b` in a system, are alike over the vertices of the object."""
    if a is None or b is None:
        return a is b
    if hasattr(a, "tocsr"):
        size = 1 if a.shape[0] + BEFORE + BEHIND == b.shape[0] else 3
        inside = slice(size * BEFORE, b.shape[0] - size * BEHIND)
        assert b.nnz == a.nnz  # and nothing outside
        a, b = a.toarray(), b.tocsr()[inside, inside].toarray()
    if np.shape(a) != np.shape(b):
        assert not np.delete(b, slice(BEFORE, -BEHIND), axis=0).any()
        b = b[BEFORE:-BEHIND]
    return np.abs(a - b).max(initial=0.0) <= 1e-12 * np.abs(a).max(initial=0.0)


@pytest.mark.parametrize("name", TERMS)
def test_a_term_in_a_system_has_what_it_has_alone(name):
    """Each optional member: absent in both, or with the same values."""
    context, system = system_of(*TERMS[name])
    x = moved(context, size=0.02)
    rows = Rows(BEFORE, len(x), BEFORE + len(x) + BEHIND)
    wide, v = np.pad(x, ((BEFORE, BEHIND), (0, 0)), constant_values=7.0), np.random.default_rng(1)
    v = v.normal(size=x.shape)
    wide_v = np.pad(v, ((BEFORE, BEHIND), (0, 0)), constant_values=3.0)
    frozen = [d.frozen(x, 0.01) for d in system.dissipations]
    for own in system.terms:
        if own.at is not None:
            assert type(embedded(own, rows).at(0.3).own_term) is type(own.at(0.3))
    for own in [*system.potentials, *system.dissipations, *frozen]:
        term = embedded(own, rows)
        assert term.own_term is own and term.name == own.name
        for member in OPTIONAL_MEMBERS:
            mine, other = getattr(own, member, None), getattr(term, member, None)
            if not callable(mine) and member not in ("vertices", "matrix"):
                assert mine == other, member
            assert callable(mine) == callable(other), member
        if not isinstance(own, Potential):
            continue
        assert same(own.matrix, term.matrix)
        assert same(own.energy(x), term.energy(wide)) and same(own.gradient(x), term.gradient(wide))
        for method in ("blocks", "pair_blocks", "hessian"):
            if getattr(own, method) is not None:
                assert same(getattr(own, method)(x, "exact"), getattr(term, method)(wide, "exact"))
        if own.low_rank is not None:
            assert same(own.low_rank(x), term.low_rank(wide))
        if own.material_operator is not None:
            assert same(own.material_operator(x)(v), term.material_operator(wide)(wide_v))
        if own.linearised is not None:
            pair = own.linearised(x, v), term.linearised(wide, wide_v)
            assert same(pair[0].blocks(x, "exact"), pair[1].blocks(wide, "exact"))
        if own.subset is not None:
            some = np.arange(3)
            assert same(own.subset(some, own.stencil[some]).energy(x),
                        term.subset(some, term.stencil[some]).energy(wide))  # fmt: skip
