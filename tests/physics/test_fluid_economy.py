"""What a scene does not name is not assembled: harmonic bases, viscosity, tracers, paths of points."""

import pytest

from benchmarks.fluids.runs import run_fluid
from ddgcli.algorithms.hodge import harmonic
from ddgcli.mesh import shapes
from ddgcli.models.fluid import diffusion, tracer, transport, volume_effects, volume_paths, volume_viscosity

SURFACE = 'grid = { size = [6, 6], cells = [6, 6], periodic = "xy" }'
VOLUME = "box = { size = [1, 1, 1], cells = [2, 2, 2] }"
TURN = 'initial = { velocity = ["x*(1-x)*(1-2*y)", "-(1-2*x)*y*(1-y)", 0] }\n'
TIME = 'integrator = "energy"\nduration = 0.02\nstep = 0.01'
# assembly -> its shape, module, name, and an effect that needs it
ASSEMBLIES = {
    "harmonic basis": (SURFACE, harmonic, "harmonic_basis", "harmonic = {}"),
    "viscosity matrix": (SURFACE, diffusion, "Decay", "viscosity = { nu = 0.1 }"),
    "tracer": (SURFACE, tracer, "SurfaceTracer", 'dye = { amount = "x" }'),
    "paths": (SURFACE, transport, "Transport", "particles = { count = 2 }"),
    "viscosity matrix of a volume": (VOLUME, volume_viscosity, "hodge_star", "viscosity = { nu = 0.1 }"),
    "tracer of a volume": (VOLUME, volume_effects, "VolumeTracer", 'dye = { amount = "x" }'),
    "paths of a volume": (VOLUME, volume_paths, "VolumePaths", "particles = { count = 2 }"),
}


class Assembled(Exception):
    pass


@pytest.mark.parametrize("assembly", ASSEMBLIES)
def test_nothing_is_assembled_that_no_effect_needs(assembly, monkeypatch):
    shape, module, name, effect = ASSEMBLIES[assembly]

    def refuse(*_, **__):
        raise Assembled

    monkeypatch.setattr(module, name, refuse)
    run_fluid(TURN if shape == VOLUME else 'initial = { vorticity = "sin(x)" }\n', TIME, shape)
    with pytest.raises(Assembled):
        run_fluid(f"{TURN}{effect}", TIME, shape)


@pytest.mark.parametrize(
    "integrator, shape, most",
    [
        ("conservative", None, 4),
        ("circulation", None, 25),
        ("circulation", VOLUME, 50),
        ("energy", VOLUME, 50),
    ],
)
def test_a_step_at_a_courant_number_of_one_takes_few_solves(integrator, shape, most):
    """One more for the frame at the end."""
    start, dt = TURN, 0.3
    if shape is None:
        mesh = shapes.random_sphere(642)
        start, dt = 'initial = { vorticity = "5*z + sin(3*x)*y" }', 0.05
        dt /= 10 if integrator == "conservative" else 1  # its limit of stability
    else:
        mesh = None
    time = f'integrator = "{integrator}"\nduration = {10 * dt}\nstep = {dt}\nframe_every = {10 * dt}'
    run = run_fluid(start, time, shape or 'mesh = "given"', mesh)
    assert run.steps == 10
    assert 2 < (run.account.calls["solver"] - run.solves_of_start - 1) / 10 <= most
