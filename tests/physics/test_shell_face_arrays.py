"""Arrays on faces in every frame: stress, strain, moments of shells that stretch, bend, yield and break."""

import numpy as np
import pytest

from ddgcli.choices import SHELL_FACE_ARRAYS
from ddgcli.errors import SceneError
from ddgcli.io.trajectories.trajectory import Trajectory
from tests.cli.test_shell_resume import check_resumed_as_whole
from tests.physics.test_shell_fracture import BURSTING, TORN
from tests.simulate import shell_run


def names(*words):
    return "[" + ", ".join(f'"{word}"' for word in words) + "]"


ALL = names(*SHELL_FACE_ARRAYS)
# a strip that is pulled
PULLED = """\
format = "ddgcli-scene/1"
[time]
integrator = "static"
load_steps = 2
[[object]]
name = "s"
role = "shell"
grid = {{ size = [1, 0.2], cells = [4, 1] }}
density = 1
thickness = "2 mm"
young = 1e8
poisson = 0
face_arrays = {arrays}
[effects]
stretching = {{}}
bending = {{ model = "{bending}" }}
[[effects.pin]]
box = [[0, 0, 0], [0, 0.2, 0]]
clamp = true
[[effects.load]]
box = [[1, 0, 0], [1, 0.2, 0]]
line_force = [200, 0, 0]
"""


def with_arrays(text, arrays, name="s"):
    """The scene with arrays on the faces of a shell."""
    return text.replace(
        f'name = "{name}"\nrole = "shell"\n', f'name = "{name}"\nrole = "shell"\nface_arrays = {arrays}\n'
    )


def test_stress_of_a_pulled_strip_is_force_over_width_and_thickness_at_every_load_step():
    snapshots, _, _ = shell_run(PULLED.format(arrays=ALL, bending="midedge"))
    for factor, snapshot in zip((0.0, 0.5, 1.0), snapshots, strict=True):
        face = snapshot.observations["s"].face
        assert list(face) == list(SHELL_FACE_ARRAYS)
        stretch = 1 + face["strain_tensor"][:, 0]
        assert np.allclose(face["principal_stress"][:, 0], factor * 1e5, rtol=5e-3, atol=1e-3)
        assert np.allclose(face["stress"][:, 0], face["principal_stress"][:, 0], atol=1e-3)
        assert np.allclose(face["principal_strain"][:, 0], face["strain_tensor"][:, 0], atol=1e-12)
        assert np.allclose(stretch, 1 + factor * 1e-3, rtol=1e-5)
        assert np.abs(face["bending_moment"]).max() < 1e-9


def test_elastic_stress_of_metal_that_yields_stays_at_its_limit_and_is_gone_behind_a_crack():
    arrays = names("stress", "strain_tensor", "principal_strain", "principal_stress")
    text = with_arrays(TORN, arrays)
    snapshots, _, _ = shell_run(text)
    strain = np.array([s.observations["s"].face["principal_strain"][:, 0].max() for s in snapshots])
    assert strain.max() < 5e-3 * (1 + 1e-9) and strain[5] > 4.9e-3
    middle = snapshots[5].observations["s"].face
    assert np.allclose(middle["principal_stress"][:, 0], 1e8 * 5e-3, rtol=0.03)
    assert np.allclose(middle["stress"][:, 0], middle["principal_stress"][:, 0], rtol=1e-6)
    assert np.allclose(middle["strain_tensor"][:, 0], middle["principal_strain"][:, 0], rtol=1e-6)
    last = snapshots[-1].observations["s"]
    assert len(last.points) > len(snapshots[0].observations["s"].points)
    assert np.abs(last.face["stress"]).max() < 0.1 * 5e5


def test_file_has_the_arrays_of_every_frame_and_the_reader_of_vtk_shows_them(run, tmp_path):
    reader_module = pytest.importorskip("vtkmodules.vtkIOHDF")
    numpy_support = pytest.importorskip("vtkmodules.util.numpy_support")
    broken = BURSTING.format(integrator="implicit-euler", strain=1e-3)
    whole = PULLED.format(arrays=names("stress", "principal_moment"), bending="midedge")
    for k, text in enumerate((with_arrays(broken, names("stress")), whole)):
        path, out = tmp_path / f"{k}.toml", tmp_path / f"{k}.vtkhdf"
        path.write_text(text)
        assert run("shell-sim", path, "-o", out, "-o", tmp_path / f"{k}.vtu").exit_code == 0
        reader = reader_module.vtkHDFReader()
        reader.SetFileName(str(out))
        reader.UpdateInformation()
        with Trajectory(str(out)) as trajectory:
            own = [trajectory.read_frame(j).face for j in range(trajectory.n_frames)]
            assert not np.array_equal(own[0]["stress"], own[-1]["stress"])
            for j in range(trajectory.n_frames):
                reader.SetStep(j)
                reader.Update()
                data = reader.GetOutput().GetCellData()
                assert own[j]["stress"].shape == (trajectory.n_faces[j], 9)
                for name, values in trajectory.face(j).items():
                    assert np.array_equal(numpy_support.vtk_to_numpy(data.GetArray(name)), values)
        snapshot = shell_run(text)[0][-1].observations["s"].face["stress"]
        assert np.array_equal(own[-1]["stress"], snapshot)


def test_shells_without_arrays_have_nan_beside_one_with_them(run, tmp_path):
    text = PULLED.format(arrays=names("stress"), bending="midedge").replace("static", "newmark")
    text = text.replace("load_steps = 2", "duration = 2e-4\nstep = 1e-4")
    other = text[text.index("[[object]]") : text.index("[effects]")].replace('"s"', '"other"')
    text = text.replace("[effects]", other.replace(f"face_arrays = {names('stress')}\n", "") + "[effects]")
    text = text.replace("pin]]", 'pin]]\nobject = "s"').replace("load]]", 'load]]\nobject = "s"')
    path, out = tmp_path / "s.toml", tmp_path / "s.vtkhdf"
    path.write_text(text)
    assert run("shell-sim", path, "-o", out).exit_code == 0
    with Trajectory(str(out)) as trajectory:
        face = trajectory.face(1)
        assert np.isnan(face["stress"][face["object_id"] == 1]).all()
        assert np.isfinite(face["stress"][face["object_id"] == 0]).all()


def test_resumed_run_has_the_same_arrays(run, tmp_path, monkeypatch):
    path = tmp_path / "s.toml"
    text = BURSTING.format(integrator="implicit-euler", strain=1e-3)
    path.write_text(with_arrays(text, names("stress")))
    check_resumed_as_whole(run, tmp_path, monkeypatch, path, 5)
    with (
        Trajectory(str(tmp_path / "whole.vtkhdf")) as whole,
        Trajectory(str(tmp_path / "broken.vtkhdf")) as resumed,
    ):
        for k in range(whole.n_frames):
            assert whole.face(k)["stress"].size
            assert np.array_equal(whole.face(k)["stress"], resumed.face(k)["stress"])


@pytest.mark.parametrize("arrays, bending, message", [
    (names("bending_moment"), "hinge", "midedge"), (names("stres"), "hinge", "did you mean 'stress'"),
])  # fmt: skip
def test_arrays_that_the_models_do_not_have_are_refused(arrays, bending, message):
    with pytest.raises(SceneError, match=message):
        shell_run(PULLED.format(arrays=arrays, bending=bending))
