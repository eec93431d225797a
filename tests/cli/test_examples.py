"""`ddgcli examples` copies what the README's commands read."""

from tests.conftest import ROOT


def test_examples_copies_samples_once_and_keeps_what_exists(run, summary, tmp_path):
    first = summary("examples", tmp_path)
    expected = {
        name: sum(p.is_file() and p.suffix != ".py" for p in (ROOT / name).iterdir())
        for name in ("sample_meshes", "sample_scenes")
    }
    assert first["results"]["copied"] == expected and expected["sample_meshes"] > 10
    for name in expected:
        for source in (tmp_path / name).iterdir():
            assert source.read_bytes() == (ROOT / name / source.name).read_bytes()
    torus = tmp_path / "sample_meshes" / "torus.ply"
    torus.write_text("mine")
    assert set(summary("examples", tmp_path)["results"]["copied"].values()) == {0}
    assert torus.read_text() == "mine"


def test_a_folder_that_cannot_be_created_is_refused(run, tmp_path):
    (tmp_path / "file").write_text("")
    result = run("examples", tmp_path / "file")
    assert result.exit_code == 2 and "name another folder" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_samples_are_read_from_a_package_without_init_as_the_wheel_has_it(summary, tmp_path, monkeypatch):
    from ddgcli.cli.commands import examples

    for name in ("meshes", "scenes"):
        folder = tmp_path / "site" / "wheel_samples" / name
        folder.mkdir(parents=True)
        (folder / f"{name}.ply").write_text(name)
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    folders = {"sample_meshes": "wheel_samples.meshes", "sample_scenes": "wheel_samples.scenes"}
    monkeypatch.setattr(examples, "FOLDERS", folders)
    assert set(summary("examples", tmp_path / "out")["results"]["copied"].values()) == {1}
    assert (tmp_path / "out" / "sample_meshes" / "meshes.ply").read_text() == "meshes"
