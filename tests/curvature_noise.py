"""Noisy surfaces with known curvature, errors of a run, and what a warning states."""

import re

import numpy as np

from benchmarks.common import noisy_surfaces
from ddgcli.algorithms.curvature.surface_curvature import measure_curvature
from ddgcli.mesh import shapes
from tests.curvature_truths import ellipsoid_truth, irregular_ellipsoid, irregular_torus, torus_truth

AXES = (1.5, 1.0, 0.6)


SURFACES = {
    "sphere": (lambda: shapes.icosphere(3), ellipsoid_truth),
    "irregular sphere": (lambda: shapes.random_sphere(2000), ellipsoid_truth),
    "ellipsoid": (lambda: irregular_ellipsoid(2000), lambda p: ellipsoid_truth(p, AXES)),
    "torus": (lambda: irregular_torus(70, 35), torus_truth),
}


def noisy(mesh, share, seed=0):
    rng = np.random.default_rng(seed)
    return mesh.moved(mesh.points + share * mesh.side_length.mean() * rng.standard_normal(mesh.points.shape))


def error_and_results(mesh, truth, radius=None):
    """Error relative to the root mean square of the truth, and the results of the run."""
    measured = measure_curvature(mesh, radius=radius, full=False)
    difference = measured.vertex["mean_curvature"] - truth
    return float(np.sqrt(np.mean(difference**2) / np.mean(truth**2))), measured.results


def error(mesh, truth, radius=None):
    return error_and_results(mesh, truth, radius)[0]


def proposal(text):
    """Error by default, scheme and radius of a warning."""
    stated = re.search(r"about (\d+) %; use (?:`scheme=(.*)` with )?`radius=(\S+)`", text)
    assert stated, text
    return int(stated[1]) / 100, stated[2] or "quadric", float(stated[3])


CASES = {
    name: make
    for cases in (noisy_surfaces.voxel_cases, noisy_surfaces.noise_cases, noisy_surfaces.clean_cases)
    for name, make in cases()
}
