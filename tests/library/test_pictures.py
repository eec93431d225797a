"""Pictures of the library are those of the command line."""

import os
import subprocess
import sys

import numpy as np
import pytest

import ddgcli as ddg

matplotlib = pytest.importorskip("matplotlib")
image = pytest.importorskip("matplotlib.image")
TORUS = ddg.torus(24, 12)
SQUARE = ([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1], [1, 2], [2, 3], [3, 0]])


def test_a_picture_is_that_of_the_command(run, tmp_path):
    ddg.write_mesh(tmp_path / "torus.ply", TORUS)
    run("curvature", tmp_path / "torus.ply", "--plot", tmp_path / "a.png", "--size", "300x240")
    ddg.write_picture(tmp_path / "b.png", ddg.curvature(TORUS), "mean_curvature", size=(300, 240))
    ours, theirs = image.imread(tmp_path / "b.png"), image.imread(tmp_path / "a.png")
    assert ours.shape == (240, 300, 4)
    np.testing.assert_array_equal(ours[:220], theirs[:220])  # the command has a caption below


def test_curves_view_edges_and_vectors_change_a_picture(tmp_path):
    paths = ddg.shortest_paths(TORUS, 0, [150]).polylines
    looks = [
        {}, {"curves": paths}, {"view": "x"}, {"view": (70, 10)}, {"up": "y"}, {"edges": True},
        {"values": TORUS.points}, {"values": TORUS.points[:, 2]}, {"values": TORUS.points[:, :2]},
        {"values": TORUS.points[:, 2], "name": "z"},
    ]  # fmt: skip
    pictures = []
    for look in looks:
        ddg.write_picture(tmp_path / "a.png", TORUS, **look, size=(200, 200))
        pictures.append((tmp_path / "a.png").read_bytes())
    assert len(set(pictures)) == len(looks)


@pytest.mark.parametrize("name", ["$x_{$", r"a $\frac$ b", r"$x$ \$"])
def test_dollars_in_names_are_no_formulas(name, tmp_path):
    """Once matplotlib read a formula between two of them: an error, or a picture with another name."""
    ddg.write_picture(tmp_path / "a.svg", SQUARE, [0, 1, 2, 3], name=name)
    assert f">{name}<" in (tmp_path / "a.svg").read_text()


def test_a_picture_shows_the_side_of_its_curves(tmp_path):
    """Also where the values are large on the other side."""
    ball = ddg.icosphere(3)
    angle = np.linspace(0.0, 1.0, 20)
    for azimuth in (-60, 30, 120, 210):
        turn = angle - 0.5 + np.radians(azimuth)
        curve = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
        values = np.exp(-3 * ((ball.points + curve[10]) ** 2).sum(axis=1))
        ddg.write_picture(tmp_path / "a.png", ball, values, curves=[curve], size=(200, 200))
        black = (image.imread(tmp_path / "a.png")[:170, :150, :3] < 0.05).all(axis=2).sum()
        assert black > 20


def test_a_backend_that_is_not_installed_is_not_loaded(tmp_path):
    """Jupyter exports the name of its own to the programs that it starts."""
    code = (
        "import os, sys, ddgcli as ddg\n"
        "ddg.write_picture(sys.argv[1], ddg.box())\n"
        "print(os.environ['MPLBACKEND'])"
    )
    backend = "module://matplotlib_inline.backend_inline"
    environment = {**os.environ, "MPLBACKEND": backend}
    call = [sys.executable, "-c", code, str(tmp_path / "a.png")]
    shown = subprocess.run(call, env=environment, capture_output=True, text=True, timeout=60)
    assert (shown.stdout.strip(), shown.stderr) == (backend, "")


def test_settings_of_matplotlib_change_no_picture(tmp_path):
    pictures = []
    own = {"font.size": 30, "image.origin": "lower", "savefig.bbox": "tight", "text.usetex": True}
    for settings in ({}, own):
        with matplotlib.rc_context(settings):
            ddg.write_picture(tmp_path / "a.png", TORUS, TORUS.points[:, 2], name="z", size=(200, 200))
            assert matplotlib.rcParams["text.usetex"] == settings.get("text.usetex", False)
        pictures.append((tmp_path / "a.png").read_bytes())
    assert pictures[0] == pictures[1]


def test_curves_and_tetrahedra_have_pictures(tmp_path):
    ddg.write_picture(tmp_path / "a.svg", SQUARE, [0, 1, 2, 3], name="number")
    assert "number" in (tmp_path / "a.svg").read_text()
    solid = ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]])
    ddg.write_picture(tmp_path / "b.png", solid, size=(200, 200))
    assert image.imread(tmp_path / "b.png")[..., :3].min() < 0.9


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"path": "a.gif"}, "pictures are .png, .svg, .pdf"),
        ({"values": "H"}, "values: no array 'H'"),
        ({"values": [1.0, 2.0]}, "values: has shape (2,); it needs 288 or 576 entries"),
        ({"view": "top"}, "view: 'top' is not one of x, y, z, iso"),
        ({"mesh": ddg.intrinsic_delaunay(TORUS)}, "no positions"),
        ({"path": "missing/a.png"}, "cannot be written"),
        ({"view": (1.0, 2.0, 3.0)}, "view: must be a name or two angles"),
        ({"up": "w"}, "up: 'w' is not one of x, y, z"),
        ({"size": (100, 200)}, "size: each side has 200 to 8000 whole pixels"),
        ({"mesh": SQUARE, "edges": True}, "drawn on a surface"),
        ({"mesh": SQUARE, "curves": [np.eye(3)]}, "drawn on a surface"),
        ({"mesh": SQUARE, "values": np.eye(4)}, "values: has shape (4, 4); curves are coloured by numbers"),
        ({"curves": [[1.0, 2.0]]}, "curves: must be arrays (k, 3) of points"),
    ],
)
def test_wrong_pictures_are_refused_without_a_file(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ddg.errors.InputError) as refusal:
        ddg.write_picture(**{"path": "a.png", "mesh": TORUS, **arguments})
    assert message in str(refusal.value) and not list(tmp_path.iterdir())
