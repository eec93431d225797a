"""The faults of `benchmarks.mutants`: at least one in every package of ddgcli that computes."""

from __future__ import annotations

from typing import NamedTuple


class Mutant(NamedTuple):
    """One fault: a part of a line that occurs once in a file, its replacement, and the test, `FILE::NAME`, that must fail."""

    path: str
    line: str
    fault: str
    test: str


MUTANTS = (
    # geometry
    Mutant("ddgcli/geometry/intrinsic.py", "area[block] = 0.25 * np.sqrt(p", "area[block] = 0.5 * np.sqrt(p", "tests/exact/test_intrinsic.py::test_angles_and_cotangents_have_full_relative_precision"),
    Mutant("ddgcli/geometry/intrinsic.py", "(pu - uu) * factor", "(pu + uu) * factor", "tests/exact/test_laplacian.py::test_masses_sum_to_the_area"),
    Mutant("ddgcli/geometry/extrinsic.py", "0.5 * cross(b - a, c - a).T", "0.5 * cross(c - a, b - a).T", "tests/exact/test_curvature_identities.py::test_normals_of_faces_that_run_counter_clockwise_seen_from_outside_point_outward"),
    # mesh
    Mutant("ddgcli/mesh/vectors.py", "dot(cross(a, b), c) / 6.0", "dot(cross(a, b), c) / 3.0", "tests/exact/test_sample_meshes.py::test_sample_surfaces_have_their_topology_area_and_volume"),
    Mutant("ddgcli/mesh/topology.py", "sign = 2 * (tail <= head).view(np.int8) - np.int8(1)", "sign = np.ones(tail.shape, dtype=np.int8)", "tests/exact/test_dec.py::test_dd_is_exactly_zero"),
    # operators
    Mutant("ddgcli/operators/laplacian.py", "face_area(mesh.side_length) / 3.0, 3", "face_area(mesh.side_length) / 2.0, 3", "tests/exact/test_laplacian.py::test_masses_sum_to_the_area"),
    Mutant("ddgcli/operators/dec.py", "np.array([-1, 1], dtype=np.int8)", "np.array([1, 1], dtype=np.int8)", "tests/exact/test_dec.py::test_dd_is_exactly_zero"),
    Mutant("ddgcli/operators/stars.py", "area[:, None] / 3.0, 3, axis=1", "area[:, None] / 2.0, 3, axis=1", "tests/exact/test_dec.py::test_star_zero_sums_to_the_measure"),
    Mutant("ddgcli/operators/gradient.py", "csr_array(-(gradient(mesh).T", "csr_array((gradient(mesh).T", "tests/exact/test_gradient.py::test_divergence_of_gradient_is_minus_stiffness"),
    Mutant("ddgcli/operators/connection.py", "np.where(fans.is_open, 1.0, 2 * np.pi / total)", "np.where(fans.is_open, 1.0, np.pi / total)", "tests/exact/test_transport.py::test_connection_laplacian_is_hermitian_and_curvature_is_its_holonomy"),
    # linalg
    Mutant("ddgcli/linalg/residual_gate.py", "converged &= worst <= largest", "converged |= worst <= largest", "tests/exact/test_residual_gate.py::test_residuals_warn_above_one_bound_and_fail_above_another"),
    Mutant("ddgcli/linalg/eigen.py", "values=pairs.values / unit", "values=pairs.values * unit", "tests/exact/test_eigen.py::test_eigenpairs_equal_those_of_a_dense_solver"),
    # algorithms
    Mutant("ddgcli/algorithms/curvature/measures.py", "np.where(topology.boundary_vertex, np.pi, 2 * np.pi)", "np.where(topology.boundary_vertex, 2 * np.pi, 2 * np.pi)", "tests/exact/test_curvature_identities.py::test_sums_of_curvature_are_topology"),
    Mutant("ddgcli/algorithms/curvature/totals.py", "ball = (4 * np.pi / 3, np.pi, 2.0, 1.0)", "ball = (4 * np.pi / 3, 2 * np.pi, 2.0, 1.0)", "tests/exact/test_curvature_identities.py::test_the_unit_cube_has_the_steiner_polynomial_of_the_notes"),
    Mutant("ddgcli/algorithms/conformal/ptolemy.py", "self.length * np.exp(0.5 * (u[self.tail]", "self.length * np.exp(0.6 * (u[self.tail]", "tests/exact/test_conformal_maps.py::test_the_map_of_an_inverted_plane_is_the_plane"),
    Mutant("ddgcli/algorithms/delaunay/flips.py", "(a * a + b * b + c * c) / (r * perimeter)", "(a * a - b * b + c * c) / (r * perimeter)", "tests/exact/test_delaunay_flips.py::test_no_edge_is_left_and_the_metric_stays"),
    Mutant("ddgcli/algorithms/geodesics/heat.py", "direction *= -1.0", "direction *= 1.0", "tests/converge/test_geodesic_rates.py::test_refined_heat_converges_on_the_sphere_and_published_heat_does_not"),
    Mutant("ddgcli/algorithms/geodesics/isolines.py", "np.arange(1, count + 1) / (count + 1)", "np.arange(1, count + 1) / count", "tests/cli/test_geodesic_distance.py::test_the_picture_has_the_requested_level_lines"),
    Mutant("ddgcli/algorithms/geodesics/edge_distance.py", "reach = scale * corner_distance(", "reach = 2.0 * scale * corner_distance(", "tests/exact/test_shortest_paths.py::test_edge_distance_from_a_point_in_a_face_begins_with_straight_lines_to_its_corners"),
    Mutant("ddgcli/algorithms/hodge/homology.py", "BettiNumbers((count, count + b2 - euler, b2)", "BettiNumbers((count, count + b2 + euler, b2)", "tests/exact/test_homology.py::test_betti_numbers_are_the_ranks"),
    Mutant("ddgcli/algorithms/hodge/decomposition.py", "harmonic = closed - exact", "harmonic = closed + exact", "tests/converge/test_hodge.py::test_parts_are_orthogonal_and_sum_to_the_field"),
    Mutant("ddgcli/algorithms/laplacian/spectrum.py", "np.exp(-np.outer(pairs.values, times))", "np.exp(-2.0 * np.outer(pairs.values, times))", "tests/cli/test_laplacian_cli.py::test_heat_kernel_signature_of_a_sphere_equals_the_series"),
    Mutant("ddgcli/algorithms/tracing/crossing.py", "return u, exit_length - u, k * sine", "return exit_length - u, u, k * sine", "tests/exact/test_trace.py::test_lines_in_the_plane_are_straight"),
    Mutant("ddgcli/algorithms/tangent_fields/transport.py", "return -_cumulative_sums(turning, paths)", "return _cumulative_sums(turning, paths)", "tests/exact/test_transport.py::test_frames_stay_parallel_in_the_plane_and_along_straight_lines"),
    Mutant("ddgcli/algorithms/inspection/compare_summaries.py", "allowed = atol + rtol * abs(a)", "allowed = atol + 1e6 * rtol * abs(a)", "tests/cli/test_check.py::test_a_moved_number_is_named_with_exit_1"),
    Mutant("ddgcli/mesh/triangle_mesh.py", "np.flatnonzero(~has_area)", "np.flatnonzero(~has_area)[:0]", "tests/cli/test_info.py::test_defects_are_counted_and_named"),
    # simulation, mechanics, scenes
    Mutant("ddgcli/mechanics/integrators.py", "half = motion.v + 0.5 * dt * motion.a", "half = motion.v + 0.6 * dt * motion.a", "tests/physics/test_integrators.py::test_integrator_has_its_order[symplectic-euler]"),
    Mutant("ddgcli/simulation/account.py", "calls.get(self.name, 0) + self.calls", "calls.get(self.name, 0) + 2 * self.calls", "tests/exact/test_account.py::test_every_entry_is_counted_once"),
    Mutant("ddgcli/scenes/units.py", '"c": 1e-2', '"c": 1e-3', "tests/exact/test_scene_pieces.py::test_quantities_are_converted_exactly"),
    Mutant("ddgcli/scenes/expressions.py", "return -value if isinstance(node.op, ast.USub)", "return value if isinstance(node.op, ast.USub)", "tests/exact/test_scene_pieces.py::test_expressions_have_their_value"),
    # models
    Mutant("ddgcli/geometry/hinges.py", "s, st = dot(p, u) / length, dot(q, u) / length", "st, s = dot(p, u) / length, dot(q, u) / length", "tests/physics/test_shell_terms.py::test_gradients_equal_finite_differences"),
    Mutant("ddgcli/models/shell/gravity.py", "(0.0, 0.0, -9.81)", "(0.0, 0.0, 9.81)", "tests/library/test_simulations.py::test_integrator_of_a_simulation_is_used"),
    Mutant("ddgcli/models/fluid/rotation.py", "2.0 * vertex_normals", "1.0 * vertex_normals", "tests/physics/test_fluid_forces.py::test_rossby_haurwitz_waves_in_a_turning_frame"),
    Mutant("ddgcli/models/fluid/circulation.py", "middle = hinge + 0.5 * space", "middle = hinge + 0.4 * space", "tests/physics/test_fluid.py::test_harmonic_flow_stays"),
    Mutant("ddgcli/models/willmore/gauss_map_energy.py", "S_SHAPE = np.sqrt(3.0) / 144.0", "S_SHAPE = np.sqrt(3.0) / 14.4", "tests/physics/test_willmore_energies.py::test_stripes_that_no_normal_sees_are_as_stiff_as_in_cotan"),
    Mutant("ddgcli/models/willmore/constraints.py", "volumes_inside(mesh, self.caps, self.component) / self.volume - 1.0", "volumes_inside(mesh, self.caps, self.component) / self.volume - 1.1", "tests/physics/test_willmore_rest.py::test_area_and_volume_are_kept"),
    Mutant("ddgcli/cli/batch/process.py", 'reason = "timeout"', 'reason = ""', "tests/cli/test_batch.py::test_one_hanging_greedy_or_failing_run_does_not_stop_the_rest"),
    Mutant("ddgcli/library/mesh_arguments.py", "mesh = TetMesh.from_arrays(points, cells)", "mesh = TetMesh.from_arrays(points, cells[:-1])", "tests/library/test_library_functions.py::test_pair_of_arrays_gives_what_the_mesh_gives"),
    Mutant("ddgcli/algorithms/repair/steps.py", "has_area[repaired.mesh.flat_faces] = False", "has_area[:0] = False", "tests/exact/test_repair.py::test_a_face_without_area_is_dropped_though_its_three_vertices_differ"),
    # tradeoff
    Mutant("ddgcli/tradeoff/pareto.py", "row.on_front = best is None or row.is_surely_better(best, norm)", "row.on_front = best is None or best.is_surely_better(row, norm)", "tests/exact/test_tradeoff_table.py::test_planted_candidates_are_ranked_where_they_belong"),
    Mutant("ddgcli/tradeoff/richardson.py", "limit = fine + second / (ratio - 1.0)", "limit = fine - second / (ratio - 1.0)", "tests/exact/test_tradeoff_table.py::test_the_extrapolation_of_a_geometric_sequence_is_its_limit"),
    # io, plots, cli
    Mutant("ddgcli/io/readers/ply.py", r"end_header *(?:\r\n|\n|\r|\Z)", r"end_header *(?:\n|\r|\Z)", "tests/io/test_mesh_files.py::test_a_binary_ply_whose_header_ends_its_lines_with_cr_lf_keeps_every_byte_of_its_body"),
    Mutant("ddgcli/plots/raster.py", "np.array([1.0, -1.0, -1.0])", "np.array([1.0, 1.0, -1.0])", "tests/pictures/test_pictures.py::test_what_is_higher_in_space_is_higher_in_the_picture"),
    Mutant("ddgcli/cli/multi_value.py", "return bool(shape) and [c for c in word", "return bool(shape) or [c for c in word", "tests/cli/test_multi_value_options.py::test_words_are_spread"),
    Mutant("ddgcli/cli/parameters.py", 'f"{names[name]} {DICT_ENTRY', 'f"{names[name]}={DICT_ENTRY', "tests/cli/test_parameters.py::test_quoted_parameters_become_options_and_other_quotes_stay"),
    Mutant("ddgcli/cli/threads.py", "str(requested or 1)", "str(requested or 2)", "tests/cli/test_threads.py::test_the_default_is_one_thread_and_threads_n_gives_more"),
)  # fmt: skip
