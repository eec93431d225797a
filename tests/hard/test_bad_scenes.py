"""Every bad scene is answered with one line: file, line, nearest name, what is allowed."""

import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh

GOOD = """\
format = "ddgcli-scene/1"
[time]
duration = 0.01
step = 1e-3
frame_every = 0.005
integrator = "newmark"
beta = 0.25
[[object]]
name = "hat"
role = "shell"
grid = { size = [1, 1], cells = [2, 2] }
material = "felt"
position = [0, 0, 1]
[[object]]
name = "floor"
role = "obstacle"
plane = { point = [0, 0, 0], normal = [0, 0, 1] }
[effects]
stretching = { model = "stvk" }
bending = { model = "hinge", rest = "input" }
gravity = { acceleration = [0, 0, -9.81] }
contact = { pairs = [["hat", "floor"]], friction = 0.5 }
"""

HANDLE = "handle = {{ {}, positions = [[0, 0, 0], [0, 0, 1], [0, 0, 2]] }} #"
FLOOR = "plane = { point = [0, 0, 0], normal = [0, 0, 1] }"
GRID = "grid = { size = [1, 1], cells = [2, 2] }"
STVK = 'stretching = { model = "stvk" }'
TWO_SHELLS = """role = "shell"
box = {}
[effects.pin]
vertices = [0]
[[object]]
role = "obstacle\""""
# (text to replace, replacement, line of the answer, words that must be in it)
BAD = [
    ('format = "ddgcli-scene/1"', 'format = "ddgcli-scene/9"', 1, ["ddgcli-scene/1"]),
    ('format = "ddgcli-scene/1"', "fromat = 1", 1, ["'fromat'", "'format'"]),
    ("[effects]", "[efects]", 18, ["'efects'", "'effects'"]),
    ("step = 1e-3", "stepp = 1e-3", 4, ["'stepp'", "'step'", "duration"]),
    ("step = 1e-3", 'step = "1 kg"', 4, ["step", "1 kg", "s is needed"]),
    ("step = 1e-3", 'step = "1 mss"', 4, ["'mss'", "'ms'"]),
    ("step = 1e-3", "step = -1", 4, ["greater than 0", "-1"]),
    ("step = 1e-3", "step = nan", 4, ["not finite"]),
    ("step = 1e-3", "step = true", 4, ["true/false"]),
    ("step = 1e-3", "step = [1]", 4, ["an array"]),
    ("step = 1e-3", 'step = "1 km^400"', 4, ["beyond the floating-point range"]),
    ("step = 1e-3", f"step = {10**400}", 4, ["not finite"]),
    ("step = 1e-3", "step = 1e-12", 4, ["1e+10", "lengthen"]),
    ("duration = 0.01", "duration = 1e300", 4, ["1e+303"]),
    ("step = 1e-3", "step = 1e300", 4, ["1e+300", "floating-point range"]),
    ("duration = 0.01\nstep = 1e-3", "duration = 1e-300\ntolerance = 1", 3, ["1e-300", "point range"]),
    ("[time]", "[[time]]", 2, ["table [time]"]),
    ("duration = 0.01", 'duration = "soon"', 3, ["'soon'", "number"]),
    ('integrator = "newmark"', 'integrator = "newmrak"', 6, ["'newmrak'", "'newmark'", "verlet"]),
    ('integrator = "newmark"', 'integrator = "verlet"', 7, ["'beta'", "allowed"]),
    ("beta = 0.25", "beta = 0.75", 7, ["at most 0.5"]),
    ("beta = 0.25", 'on_failure = "shrnk"', 7, ["'shrnk'", "'shrink'", "stop"]),
    ('role = "shell"', 'role = "shel"', 10, ["'shel'", "'shell'", "obstacle"]),
    ('role = "shell"', 'role = "fluid"', 10, ["fluid-sim"]),
    (GRID, "", 8, ["shape", "mesh, grid"]),
    (GRID, "grid = { size = [1, 1], cels = [2, 2] }", 11, ["'cels'", "'cells'"]),
    (GRID, "grid = { size = [1], cells = [2, 2] }", 11, ["size"]),
    (GRID, "grid = { size = [1, 1], cells = [2, 0] }", 11, ["cells"]),
    (GRID, "grid = { size = [1, 1], cells = [2, 2.5] }", 11, ["whole number"]),
    (GRID, 'mesh = "nowhere.ply"', 8, ["nowhere.ply", "no such file"]),
    (
        GRID,
        'grid = { size = [1, 1], cells = [4, 4], periodic = "xy" }',
        8,
        ["periodic", "fluid-sim"],
    ),
    ("grid = {", 'sphere = { radius = "2 s" } # grid = {', 11, ["radius", "2 s"]),
    ('material = "felt"', 'material = "flet"', 12, ["'flet'", "'felt'", "cotton"]),
    ('material = "felt"', 'thickness = "2 mm"\nthicknes = 1', 13, ["'thicknes'", "'thickness'"]),
    ('material = "felt"', "poisson = 0.7", 12, ["poisson", "at most 0.5"]),
    ('material = "felt"', 'young = "70 Gpa"', 12, ["'Gpa'", "'GPa'"]),
    ('material = "felt"', "poisson = -1", 12, ["poisson", "greater than -1"]),
    ("position = [0, 0, 1]", "position = [0, 1]", 13, ["three numbers"]),
    ("position = [0, 0, 1]", "position = [0, 0, -1]", 22, ["vertex 0", "inside", "floor"]),
    ('name = "floor"', 'name = "hat"', 15, ["two objects", "'hat'"]),
    ("plane = {", "plain = {", 17, ["'plain'", "'plane'"]),
    ("normal = [0, 0, 1]", "normal = [0, 0, 0]", 17, ["normal", "zero"]),
    ("normal = [0, 0, 1]", "radius = 1", 17, ["'radius'", "point, normal"]),
    (STVK, 'streching = { model = "stvk" }', 19, ["'streching'", "'stretching'", "gravity"]),
    (STVK, 'stretching = { model = "stkv" }', 19, ["'stkv'", "'stvk'", "edges"]),
    (STVK, "stretching = true", 19, ["table"]),
    (STVK, "[[effects.stretching]]", 19, ["only once"]),
    (STVK, "viscosity = { nu = 1 }", 19, ["fluid-sim", "stretching"]),
    ("acceleration = [0, 0, -9.81]", "aceleration = [0, 0, -9.81]", 21, ["'aceleration'", "'acceleration'"]),
    ("acceleration = [0, 0, -9.81]", 'acceleration = [0, 0, "9.81 m/s"]', 21, ["9.81 m/s", "m/s^2"]),
    ("acceleration = [0, 0, -9.81]", "enabled = false", 21, ["'enabled'", "acceleration"]),
    ('[["hat", "floor"]]', '[["hat", "flor"]]', 22, ["'flor'", "'floor'"]),
    ('[["hat", "floor"]]', '[["hat", "hat"]]', 22, ["one shell", "self_contact"]),
    ('[["hat", "floor"]]', '[["floor", "floor"]]', 22, ["a shell with an obstacle or a shell"]),
    ('[["hat", "floor"]]', "[]", 22, ["pairs", "self_contact"]),
    ("friction = 0.5", 'self_contact = ["hut"]', 22, ["'hut'", "'hat'"]),
    (FLOOR, "box = { corner = [0, 0, 0.5], size = [1, 1, 1] }", 22, ["vertex 4", "inside", "floor"]),
    (FLOOR, "cylinder = { start = [0, 0, 0], end = [0, 0, 0], radius = 1 }", 17, ["must differ"]),
    (FLOOR, "cylinder = { start = [0, 0, 0], end = [0, 0, 2] }", 17, ["radius"]),
    (FLOOR, "plane = {}\ntimes = [0, 2, 1]\npositions = [[0, 0, 0], [0, 0, 1], [0, 0, 2]]", 18, ["entry 2"]),
    (FLOOR, "plane = {}\npositions = [[0, 0, 0], [0, 0, 1]]", 14, ["positions needs times"]),
    (FLOOR, "plane = {}\ntimes = [0, 1]\npositions = [[0, 0, 1], [0, 0, 2]]", 14, ["positions[0]"]),
    (FLOOR, "plane = {}\ntimes = [0, 1]\npositions = [[0, 0, 0], [0, 0, 1]]\nvelocity = [0, 0, 1]", 14,
     ["either", "velocity"]),
    (FLOOR, "plane = {}\nscale = 2", 14, ["scale", "mesh"]),
    ('[["hat", "floor"]]', '[["hat", "floor"], ["floor", "hat"]]', 22, ["more than once"]),
    ("friction = 0.5", "friciton = 0.5", 22, ["'friciton'", "'friction'"]),
    ("friction = 0.5", "friction = -0.5", 22, ["at least 0"]),
    ("contact = {", "pin = { vertices = [99] } # contact = {", 22, ["vertex 99", "0..8"]),
    ("contact = {", "pin = { box = [[5, 5, 5], [6, 6, 6]] } # contact = {", 22, ["no vertex"]),
    ("contact = {", 'pin = { vertices = [0], axes = "xw" } # contact = {', 22, ["axes", "xyz"]),
    ("contact = {", "pin = {} # contact = {", 22, ["pin: give either vertices", "box"]),
    ("contact = {", "pin = { vertices = [] } # contact = {", 22, ["no vertex"]),
    ("contact = {", "pin = { box = [[0, 0, 0]] } # contact = {", 22, ["at least 2 entries (two", "[[x, y"]),
    ("contact = {", "pin = { box = { corner = [0, 0, 0] } } # contact = {", 22, ["corners, [[x, y, z], [x"]),
    ("contact = {", "pin = { vertices = 3 } # contact = {", 22, ["an array (vertex indices), found 3"]),
    ("contact = {", "load = { vertices = [0] } # contact = {", 22, ["force, traction, line_force, moment"]),
    ("contact = {", "load = { moment = 1, edge = [0, 8] } # contact = {", 22, ["interior edge", "[0, 8]"]),
    ("contact = {", HANDLE.format("vertices = [0], times = [0, 1, 1]"), 22, ["times", "entry 2"]),
    ("contact = {", HANDLE.format("vertices = [0], times = [0, 1]"), 22, ["positions has 3 entries"]),
    ("contact = {", HANDLE.format("vertices = [99], times = [0, 1, 2]"), 22, ["vertex 99"]),
    ("gravity = {", "pin = { vertices = [3] }\n" + HANDLE.format("vertices = [3], times = [0, 1, 2]"), 22,
     ["vertex 3", "pin"]),
    ("contact = {", "load = { force = [0, 0, 1], vertices = [0], times = [1, 0], factors = [0, 1] } #", 22,
     ["times", "entry 1"]),
    ("contact = {", "load = { force = [0, 0, 1], vertices = [0], times = [0, 1] } #", 22, ["ramp"]),
    ("contact = {", "pressure = { value = 3 } #", 22, ["open", "8 boundary edges", "traction"]),
    ("contact = {", "pressure = { gas = true } #", 22, ["open"]),
    ("contact = {", "pressure = { value = -2e5, gas = true } #", 22, ["absolute pressure", "-98675"]),
    ("contact = {", 'wind = { velocity = ["sni(t)", 0, 0] } #', 22, ["velocity", "'sni'", "'sin'"]),
    ("contact = {", "wind = { velocity = [1, 2] } #", 22, ["velocity", "three"]),
    ("contact = {", "pressure = { value = 3, ambient = 5 } #", 22, ["ambient", "gas = true"]),
    (", friction = 0.5", ", slip = 5", 22, ["slip has no effect", "friction"]),
    (", friction = 0.5", ", sharp = true", 22, ["sharp has no effect", "box"]),
    (f"{STVK}\nbending = {{", "damping = { stiffness = 5 } # {", 19, ["stiffness has no effect", "bending"]),
    ("contact = {", HANDLE.format("vertices = [0], times = [0, 1, 2], center = [3, 3, 3]"), 22,
     ["center needs rotations"]),
    ("contact = {", HANDLE.format("vertices = [0], times = [-1, 1, 2]"), 22, ["begin at -1 s", "add 1 s"]),
    (FLOOR, "plane = {}\ntimes = [-1, 0]\npositions = [[0, 0, 0], [0, 0, 1]]", 14, ["begin at -1 s"]),
    (FLOOR, "plane = {}\ntimes = [0, 1]\npositions = [[0, 0, 0], [0, 0, 1]]\ncenter = [1, 0, 0]", 14,
     ["center needs rotations"]),
    ("contact = {", "plasticity = { hardening = 1 } #", 22, ["yield_strain", "yield_angle"]),
    ("contact = {", "plasticity = { yield_angle = -1 } #", 22, ["yield_angle", "greater than 0"]),
    ('role = "obstacle"', TWO_SHELLS, 18, ["object", "hat"]),
    ("contact = {", "damping = {} # contact = {", 22, ["mass", "stiffness"]),
    ("contact = {", "contact = { pairs = 3 3 # {", 22, ["TOML"]),
    ("[effects]", "[effects", 18, ["TOML"]),
    ('"felt"', '"felt"\nthickness = 1e150', 21, ["bending", "inf N m", "change `thickness`", "other units"]),
    ('"felt"', '"felt"\ndensity = 1\nthickness = 1e-200', 22, ["bending", "0 N m", "change `thickness`"]),
    ('"felt"', '"felt"\ndensity = 1\nyoung = 1e-320', 21, ["stretching", "e-32", "change `young`"]),
    ('name = "hat"', 'name = "hat"\nname = "cap"', 10, ["TOML"]),
]  # fmt: skip


def answer(run, tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    result = run("shell-sim", path, "-o", tmp_path / "out.vtkhdf")
    assert list(tmp_path.iterdir()) == [path]
    return result, f"Error: {path}: "


@pytest.mark.parametrize("old, new, line, words", BAD, ids=range(len(BAD)))
def test_bad_scene_gives_its_one_line(run, tmp_path, old, new, line, words):
    assert old in GOOD
    result, prefix = answer(run, tmp_path, GOOD.replace(old, new, 1))
    assert result.exit_code == 2, result.stderr
    assert result.stdout == ""
    errors = result.stderr.strip().split("\n")
    assert len(errors) == 1, errors
    assert errors[0].startswith(f"{prefix}line {line}: "), errors[0]
    for word in words:
        assert word in errors[0], errors[0]


@pytest.mark.parametrize("key", ["int", "str", "none", "'function[x]'"])
def test_an_unknown_key_may_be_named_as_a_type(run, tmp_path, key):
    (tmp_path / "scene.toml").write_text(GOOD.replace("beta = 0.25", f"{key} = 1"))
    result = run("shell-sim", tmp_path / "scene.toml")
    assert result.exit_code == 2 and len(result.stderr.strip().splitlines()) == 1
    assert "line 7: unknown key" in result.stderr and key.strip("'") in result.stderr


@pytest.mark.parametrize("times", ["[-1, 0, 1]", "[0, 1, 2]"])
def test_key_frames_that_begin_earlier_may_rest_until_the_start(run, tmp_path, times):
    handle = (
        f"handle = {{ vertices = [0], times = {times}, positions = [[0, 0, 0], [0, 0, 0], [0, 0, 1]] }} #"
    )
    (tmp_path / "scene.toml").write_text(GOOD.replace("contact = {", handle))
    result = run("shell-sim", tmp_path / "scene.toml")
    assert result.exit_code == 0
    assert result.stderr.count("no contact or attach names obstacle 'floor'") == 1


def test_steps_of_lengths_that_a_tolerance_chooses_are_not_counted(run, tmp_path):
    """They set the duration to as many default steps: 108 steps for `--steps 1`."""
    (tmp_path / "scene.toml").write_text(GOOD.replace("step = 1e-3", "tolerance = 0.1"))
    result = run("shell-sim", tmp_path / "scene.toml", "--steps", 1)
    assert result.exit_code == 2 and result.stderr.count("\n") == 1
    assert "give --duration, or --dt without --tolerance" in result.stderr
    for remedy in (("--duration", 0.002), ("--steps", 1, "--dt", 1e-3)):
        assert run("shell-sim", tmp_path / "scene.toml", *remedy).exit_code == 0


def test_the_good_scene_runs(run, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(GOOD)
    assert run("shell-sim", path).exit_code == 0


@pytest.mark.parametrize(
    "text", ["", "[time]\nduration = 1\n", "\x00", "object = 3", "[[object]]\nrole='obstacle'\n"]
)
def test_scenes_without_a_shell_are_refused(run, tmp_path, text):
    result, prefix = answer(run, tmp_path, text)
    assert result.exit_code == 2
    assert result.stderr.startswith(prefix)
    assert result.stderr.count("\n") == 1


def test_missing_and_binary_scenes_are_refused(run, tmp_path):
    assert "no such file" in run("shell-sim", tmp_path / "no.toml").stderr
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    result = run("shell-sim", tmp_path / "b.toml")
    assert result.exit_code == 2 and "UTF-8" in result.stderr


@pytest.mark.parametrize(
    "words",
    [
        ("shell-sim", "--effect", "gravity", "--steps", 3, "--dt", 1e300),
        ("shell-sim", "--effect", "gravity", "--steps", 10**400),
        ("willmore-flow", "--steps", 10**400),
    ],
)
def test_times_and_counts_beyond_numbers(run, tmp_path, words):
    path = tmp_path / "ball.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(1)))
    result = run(words[0], path, *words[1:])
    assert result.exit_code == 2 and "range" in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.filterwarnings("error::RuntimeWarning")  # numpy's, once of the mass of no vertex
@pytest.mark.parametrize(
    "command, words", [("fluid-sim", ["--flow", "rotation"]), ("shell-sim", ["--effect", "gravity"])]
)
def test_a_mesh_of_the_wrong_kind_is_refused_in_one_clear_line(run, tmp_path, command, words):
    (tmp_path / "line.csv").write_text("0,0\n1,0\n1,1\n")
    message = run(command, tmp_path / "line.csv", *words).stderr
    assert message == f"Error: {tmp_path}/line.csv: object 'line': holds a curve; it takes a surface\n"
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 1 2 4\n")
    message = run(command, tmp_path / "flat.obj", *words).stderr
    if command == "shell-sim":  # one line, the face, and a remedy that works
        assert "face 1, vertices 0, 1, 3" in message and message.count("\n") == 1
        remedy = message.split("ddgcli ")[1].split()
        remedy[remedy.index("-o") + 1] = tmp_path / "repaired.ply"
        assert run(*remedy).exit_code == 0
        assert run(command, tmp_path / "repaired.ply", *words, "--steps", 2).exit_code == 0
    (tmp_path / "cloud.obj").write_text("v 0 0 0\nv 1 0 0\n")
    message = run(command, tmp_path / "cloud.obj", *words).stderr
    assert message.startswith(f"Error: {tmp_path}/cloud.obj: object 'cloud': no triangles")
    assert message.count("cloud.obj") == 1
