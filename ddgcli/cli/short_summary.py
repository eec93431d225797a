"""Fields of the short summary of each command; `--full` and `--json` show all."""

from __future__ import annotations

from typing import Any

# dotted names; a name without a dot is the whole field; commands that are missing show everything
SHORT_FIELDS: dict[str, dict[str, str]] = {
    "info": {
        "results": "orientation orientable degenerate_faces duplicate_faces unreferenced_vertices "
        "coincident_vertices nonmanifold_edges nonmanifold_vertices self_intersections "
        "quality.min_angle_degrees quality.max_angle_degrees size.bounding_box size.mean_edge size.area "
        "size.volume length planar degenerate_segments accepts arrays",
    },
    "repair": {
        "results": "changes repaired.vertices repaired.faces repaired.components repaired.boundary_loops "
        "repaired.manifold repaired.oriented refused_by",
    },
    "curvature": {
        "results": "scheme region radius noise_estimate expected_error closed planar length area volume "
        "total_gaussian_curvature total_mean_curvature willmore_energy turning_number "
        "total_signed_curvature total_curvature total_torsion gaussian_curvature mean_curvature curvature "
        "offset regions.region regions.ball regions.area regions.phi_k regions.phi_h bishop_holonomy",
        "accuracy": "gauss_bonnet_residual force_balance_residual turning_number_residual "
        "offset_volume_error region_residual",
    },
    "delaunay": {
        "results": "flips steiner_points before.non_delaunay_edges before.min_angle_degrees "
        "before.max_angle_degrees before.laplacian_condition after.non_delaunay_edges "
        "after.min_angle_degrees after.max_angle_degrees after.laplacian_condition "
        "refinement.unreached_faces",
        "accuracy": "area_residual angle_defect_residual",
    },
    "laplacian": {
        "results": "operator mass unknowns eigenvalues poisson harmonic parameterization flipped_triangles "
        "seam_edges log_scale_factor conformal_distortion smooth_flow smooth_time smooth_area "
        "smooth_sensible_time smooth_collapsed_vertices hks_times form_eigenvalues harmonic_forms "
        "equation steps dt",
        "accuracy": "negative_weights eigen_complete form_eigen_complete total_drift energy_drift "
        "energy_increases heat_time_error wave_time_error hks_truncation poisson_residual harmonic_residual "
        "parameterize_residual angle_sum_residual smooth_residual",
    },
    "dec": {
        "results": "star simplices negative_star_entries",
        "accuracy": "derivative_residual symmetry_residual constant_residual star1_error star2_error",
    },
    "hodge": {
        "results": "betti_numbers boundary field_on norms",
        "accuracy": "orthogonality reconstruction_residual harmonic_residual",
    },
    "geodesic": {
        "results": "method max_distance mean_distance unreachable sources paths.kind paths.source "
        "paths.target paths.length log_map_axis targets.position targets.distance regions vertex_types "
        "fan.rays fan.stopped_at_boundary fan.rays_with_caustic fan.least_caustic_length",
        "accuracy": "error_estimate tolerance_error_estimate certificate_excess gradient_deviation.median "
        "gradient_deviation.max compare path_length_residual field_error_estimate log_map_miss log_map_skew "
        "symmetry_residual triangle_residual",
    },
    "shell-sim": {
        "results": "frames time steps frame_limited_steps rejected_steps newton_iterations energies.total "
        "reaction_forces pieces frequencies load_factors contact_forces cracks plastic_work effects",
        "accuracy": "energy_drift momentum_drift angular_momentum_drift max_strain",
    },
    "fluid-sim": {
        "results": "integrator frames steps frame_limited_steps rejected_steps kinetic_energy_start "
        "kinetic_energy enstrophy_start enstrophy total_vorticity total_dye total_temperature forces effects",
        "accuracy": "energy_drift enstrophy_drift circulation_drift dye_drift divergence_max",
    },
    "willmore-flow": {
        "results": "energy energy_convention energies area volume steps stopped_because",
        "accuracy": "energy_increases area_increases constraint_residuals",
    },
    "curve-flow": {
        "results": "length area elastic_energy turning_number stopped_because",
        "accuracy": "length_increases turning_number_changes",
    },
    "frames": {"results": "frames status start end exported_frames arrays", "accuracy": "time_mismatch"},
}
PERMANENT_FIELDS = {"converged"}
COMMANDS_OF_OTHER_INPUTS = ("frames", "batch", "examples", "check")  # they take other inputs than a mesh
INPUT_FIELDS = "vertices faces tetrahedra lines components boundary_loops genus frames"
INPUT_DEFECTS = ("manifold", "oriented")  # shown where they are false


def short_body(summary: dict[str, Any]) -> tuple[dict[str, Any], int]:
    """The summary with the short fields only, and how many fields of results and accuracy are left out."""
    short_fields = SHORT_FIELDS.get(summary["command"])
    facts = summary["input"]
    own = {name: facts[name] for name in INPUT_FIELDS.split() if facts.get(name) is not None}
    defects = {name: facts[name] for name in INPUT_DEFECTS if facts.get(name) is False}
    body = {**summary, "input": {"path": facts.get("path"), **(own or facts), **defects}}
    if short_fields is None:
        return body, 0
    hidden = 0
    for section in ("results", "accuracy"):
        selection = _selected(summary[section], short_fields.get(section, "").split())
        hidden += _count(summary[section]) - _count(selection)
        body[section] = selection
    if "accepts" in body["results"]:
        body["results"]["accepts"] = _accepted(body["results"]["accepts"])
    return body, hidden


def _selected(values: dict[str, Any], names: list[str]) -> dict[str, Any]:
    """Fields of the names, in the order of the summary; `a.b` keeps the key b of a table or of its rows."""
    inner_names: dict[str, list[str]] = {}
    for name in names:
        head, _, tail = name.partition(".")
        inner_names.setdefault(head, []).append(tail)
    selection = {}
    for name, value in values.items():
        if name in PERMANENT_FIELDS or "" in inner_names.get(name, ()):
            selection[name] = value
        elif name in inner_names and isinstance(value, dict):
            selection[name] = {key: value[key] for key in value if key in inner_names[name]}
        elif name in inner_names and isinstance(value, list):
            selection[name] = [
                {key: v for key, v in row.items() if key in inner_names[name]}
                if isinstance(row, dict)
                else row
                for row in value
            ]
    return {name: value for name, value in selection.items() if value is not None}


def _count(values: dict[str, Any]) -> int:
    return sum(len(value) if isinstance(value, dict) else 1 for value in values.values())


def _accepted(accepts: dict[str, str]) -> dict[str, str]:
    """Commands that accept the input in one line, and the reason of each that does not."""
    yes = [name for name, answer in accepts.items() if answer == "yes"]
    no = {name: why for name, why in accepts.items() if why != "yes" and name not in COMMANDS_OF_OTHER_INPUTS}
    return {"yes": " ".join(yes), **no}
