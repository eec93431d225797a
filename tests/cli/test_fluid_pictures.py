"""Pictures of fluids: arrows of the velocity, particles and their paths."""

import numpy as np
import pytest

from ddgcli.cli.simulation.plot import arrows_of, particle_lines
from ddgcli.mesh import shapes

TIMES = np.array([0.0, 1.0, 2.0, 3.0])
# one particle that walks along x, one that leaves a periodic square on the right and comes in on the left
WALK = np.array([[0.1, 0.2, 0.3, 0.4], [0.8, 0.95, 0.1, 0.25]])
PLACES = np.stack([WALK, 0.5 + 0 * WALK, 0 * WALK], axis=2).transpose(1, 0, 2).reshape(4, -1)


def test_paths_end_where_the_particles_are_and_begin_at_the_start():
    lines = particle_lines(TIMES, {"particles_f": PLACES}, 2.0, None, shapes.grid(4, 4))
    assert [len(line) for line in lines] == [3, 3]
    assert np.array_equal(lines[0][:, 0], WALK[0, :3]) and np.array_equal(lines[1][:, 0], WALK[1, :3])
    assert particle_lines(TIMES, {"kinetic_energy": TIMES}, 2.0, None, shapes.grid(4, 4)) == []


def test_paths_on_a_periodic_grid_do_not_cross_the_picture():
    square = shapes.grid(4, 4)
    drawn = np.ones(len(square.faces), dtype=bool)
    drawn[0] = False
    lines = particle_lines(TIMES, {"particles_f": PLACES}, 3.0, drawn, square)
    assert len(lines[0]) == 4 and np.array_equal(lines[1][:, 0], WALK[1, 2:])


def test_arrows_stand_at_the_vertices_of_the_cut_of_a_volume():
    box = shapes.box_tetrahedra(4, 4, 4)
    vectors = np.tile([1.0, 0.0, 0.0], (box.n_vertices, 1))
    arrows = arrows_of(box, vectors)
    assert arrows.places[:, 1].min() > 0.2 and len(arrows.vectors) == len(arrows.places)
    assert arrows_of(box, None) is None


@pytest.mark.parametrize("what", ["arrows", "paths"])
def test_arrows_and_paths_are_seen(tmp_path, what):
    from matplotlib.image import imread

    from ddgcli.plots.motion import PlotFrame, draw_frame, sequence_style

    square = shapes.grid(8, 8)
    options = {
        "arrows": {"arrows": arrows_of(square, np.tile([1.0, 0.5, 0.0], (square.n_vertices, 1)))},
        "paths": {"paths": [np.array([[0.2, 0.2, 0.0], [0.8, 0.6, 0.0]])]},
    }
    line_pixels = []
    for k, more in enumerate(({}, options[what])):
        plot_frame = PlotFrame(0.0, square, np.zeros(square.n_vertices), **more)
        path = str(tmp_path / f"{k}.png")
        draw_frame(path, plot_frame, sequence_style([plot_frame]), 3.0, 2.25, 100)
        line_pixels.append(int((imread(path)[..., :3].max(axis=2) < 0.3).sum()))
    assert line_pixels[1] > line_pixels[0] + 50
