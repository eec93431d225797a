"""What a scene does not name is not assembled: harmonic bases, viscosity, tracers, paths of points."""

import pytest

from benchmarks.fluids.runs import run_fluid
from ddgcli.algorithms.hodge import harmonic
from ddgcli.models.fluid import diffusion, tracer, transport, volume_effects, volume_paths

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
    "viscosity matrix of a volume": (VOLUME, volume_effects, "vertex_stiffness", "viscosity = { nu = 0.1 }"),
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
