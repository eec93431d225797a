"""`ddgcli view`: one page without a network; in a browser it draws, probes and plays."""

import base64
import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh import shapes
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.plots.web_page import ViewedObject, page_bytes
from tests.physics.test_willmore_flips import slanted_torus

NODE = shutil.which("node") or shutil.which("nodejs")
BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
ARGUMENTS = (
    "--headless --no-sandbox --disable-quic --no-first-run --disable-background-networking --disable-sync "
    "--disable-component-update --use-angle=swiftshader --enable-unsafe-swiftshader --window-size=900,700 "
    "--virtual-time-budget=20000 --dump-dom"
)


@pytest.fixture
def sphere(tmp_path):
    """A sphere with its height on vertices, its face indices on faces and a vector array."""
    mesh = shapes.icosphere(3)
    path = tmp_path / "sphere.vtu"
    vertex = {"height": mesh.points[:, 2], "position": mesh.points}
    write_mesh(str(path), AnnotatedMesh(mesh, vertex=vertex, face={"number": np.arange(mesh.n_faces) * 1.0}))
    return path, mesh


def evaluated(page, tmp_path, script):
    """Value of a JavaScript expression in the page, as a browser without a network gives it."""
    if BROWSER is None:
        pytest.skip("no Chromium: the page is not tried in a browser")
    copy = tmp_path / "probed.html"
    tail = f"<script>document.body.dataset.result = JSON.stringify({script});</script></body>"
    copy.write_text(page.read_text("utf-8").replace("</body>", tail), "utf-8")
    command = [BROWSER, *ARGUMENTS.split(), f"--user-data-dir={tmp_path / 'profile'}", copy.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    return json.loads(html.unescape(re.search(r'data-result="([^"]*)"', done.stdout)[1]))


def without_browser(page, tmp_path, script):
    """Value of a JavaScript expression in the page, as Node gives it with a document that draws nothing."""
    if NODE is None:
        pytest.skip("no Node: the logic of the page is not tried")
    text = page.read_text("utf-8")
    program = tmp_path / "page.js"
    source = re.search(r"<script>(.*?)</script>", text, re.S)[1]
    data = re.findall(r'<script[^>]* type="application/json">(.*?)</script>', text, re.S)
    head = (Path(__file__).parent / "document.js").read_text("utf-8")
    tail = f"\nconst viewer = window.viewer; console.log(JSON.stringify({script}));"
    program.write_text(f"const pageData = {json.dumps(data)};\n{head}\n{source}{tail}", "utf-8")
    done = subprocess.run([NODE, str(program)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


# share of the page that is drawn, its mean red, and how much of it is grey
PIXELS = """(() => { viewer.draw();
  const g = viewer.gl, w = g.drawingBufferWidth, h = g.drawingBufferHeight, p = new Uint8Array(4 * w * h);
  g.readPixels(0, 0, w, h, g.RGBA, g.UNSIGNED_BYTE, p);
  let n = 0, red = 0, grey = 0;
  for (let i = 0; i < p.length; i += 4) {
    if (p[i] + p[i + 1] + p[i + 2] >= 740) { continue; }
    n++; red += p[i]; grey += p[i] === p[i + 1] && p[i] === p[i + 2];
  }
  return [n / (w * h), red / Math.max(n, 1), grey / Math.max(n, 1)]; })()"""


def test_the_page_is_whole_small_and_the_same_each_time(summary, sphere, tmp_path):
    path, _ = sphere
    pages = [tmp_path / "a.html", tmp_path / "b.html"]
    for page in pages:
        result = summary("view", path, "-o", page)
    assert pages[0].read_bytes() == pages[1].read_bytes()
    text = pages[0].read_text("utf-8")
    assert not re.findall(r"(?:src|href)\s*=|https?://|@import|fetch\(", text)
    data = text.split('<script id="data"')[1].split("</script>")[0]
    assert len(text) - len(data) < 1 << 20
    assert result["results"]["arrays"] == ["height", "number", "position"]


def test_the_browser_draws_and_reads_the_values_of_the_file(summary, sphere, tmp_path):
    path, mesh = sphere
    page = tmp_path / "page.html"
    summary("view", path, "-o", page, "--array", "height")
    script = f"""{{ lost: viewer.gl.isContextLost(), pixels: {PIXELS},
      probe: viewer.probe(450, 350), outside: viewer.probe(880, 680), largest: viewer.jump(1),
      least: viewer.jump(-1), face: (viewer.choose("number"), viewer.probe(450, 350)) }}"""
    facts = evaluated(page, tmp_path, script)
    assert facts["lost"] is False and 0.1 < facts["pixels"][0] < 0.9
    assert facts["probe"]["value"] == mesh.points[facts["probe"]["vertex"], 2]
    assert facts["probe"]["vertex"] in mesh.faces[facts["probe"]["face"]]
    assert facts["outside"] is None
    assert facts["largest"]["value"] == mesh.points[:, 2].max()
    assert facts["least"]["value"] == mesh.points[:, 2].min()
    assert facts["face"]["value"] == facts["face"]["face"]


def test_a_click_gives_the_face_under_it_also_where_edges_are_smoothed(summary, tmp_path):
    mesh = shapes.icosphere(4)
    write_mesh(str(tmp_path / "fine.ply"), AnnotatedMesh(mesh))
    summary("view", tmp_path / "fine.ply", "-o", tmp_path / "page.html")
    script = """[...Array(40).keys()].map((i) => {
      const x = 450 + (i % 8 - 4) * 17, y = 350 + (i / 8 - 2) * 27;
      const { clientWidth: w, clientHeight: h } = viewer.gl.canvas, hit = viewer.probe(x, y);
      return [hit.face, [2 * x / w - 1, 1 - 2 * y / h]]; })"""
    hits = evaluated(tmp_path / "page.html", tmp_path, f"[{script}, [...Array({mesh.n_vertices}).keys()].map("
                     "(v) => viewer.place(viewer.data.objects[0], v))]")  # fmt: skip
    place, pixel = np.array(hits[1]), 2 / 500
    corner = place[mesh.faces[[face for face, _ in hits[0]]]]
    target = np.array([point for _, point in hits[0]])
    for j in range(3):  # on the inner side of each edge, but for a pixel
        a, b = corner[:, j], corner[:, (j + 1) % 3]
        cross = (b - a)[:, 0] * (target - a)[:, 1] - (b - a)[:, 1] * (target - a)[:, 0]
        assert (cross > -pixel * np.linalg.norm(b - a, axis=1)).all()


def test_values_that_are_not_finite_and_the_up_axis_of_the_shape(summary, tmp_path):
    mesh = shapes.grid(8, 8)
    for name, points in (("z.vtu", mesh.points), ("y.vtu", mesh.points[:, [0, 2, 1]])):
        values = np.where(mesh.points[:, 0] > 0.5, np.inf, mesh.points[:, 0])
        write_mesh(str(tmp_path / name), AnnotatedMesh(mesh.moved(points), {"x": values}))
        summary("view", tmp_path / name, "-o", tmp_path / (name + ".html"))
        assert f'"up": "{name[0]}"' in (tmp_path / (name + ".html")).read_text("utf-8")
    shown = evaluated(tmp_path / "z.vtu.html", tmp_path, PIXELS)
    assert shown[2] == pytest.approx(0.5, abs=0.15)  # the half without values is grey


def test_no_colour_beside_missing_values_is_that_of_a_value_which_does_not_occur(summary, tmp_path):
    mesh = shapes.grid(8, 8)
    x = mesh.points[:, 0]
    values = {"mean_curvature": np.where(x > 0.5, np.nan, -1 - x)}
    write_mesh(str(tmp_path / "part.vtu"), AnnotatedMesh(mesh, values))
    summary("view", tmp_path / "part.vtu", "-o", tmp_path / "page.html")
    red = PIXELS.replace("grey += p[i] === p[i + 1] && p[i] === p[i + 2]", "grey += p[i] > p[i + 2] + 20")
    blue = red.replace("p[i] > p[i + 2] + 20", "p[i + 2] > p[i] + 20")
    shares = evaluated(tmp_path / "page.html", tmp_path, f"[{red}[2], {blue}[2]]")
    assert shares[0] == 0 and shares[1] > 0.3


def test_a_signed_quantity_diverges_about_zero_also_where_one_sign_occurs(summary, sphere, tmp_path):
    mesh = sphere[1]
    values = {"mean_curvature": 1.0 + 0.1 * mesh.points[:, 2], "height": 1.0 + 0.1 * mesh.points[:, 2]}
    write_mesh(str(tmp_path / "signed.vtu"), AnnotatedMesh(mesh, values))
    page, ply = tmp_path / "page.html", tmp_path / "coloured.ply"
    summary("view", tmp_path / "signed.vtu", "-o", page)
    data = json.loads(page.read_text("utf-8").split('json">')[1].split("</script>")[0])
    shown = {array["name"]: array for array in data["objects"][0]["arrays"]}
    assert shown["mean_curvature"]["signed"] and not shown["height"]["signed"]
    assert shown["mean_curvature"]["low"] == -shown["mean_curvature"]["high"] < -1
    summary("curvature", sphere[0], "-o", ply, "--colors", "mean_curvature")
    assert b'"map": "RdBu_r"' in ply.read_bytes()[:2000]


def test_each_frame_has_its_own_faces(run, summary, tmp_path):
    path, out, page = tmp_path / "ring.ply", tmp_path / "run.vtkhdf", tmp_path / "page.html"
    write_mesh(str(path), AnnotatedMesh(slanted_torus()))
    assert run("willmore-flow", path, "--steps", 2, "-o", out).exit_code in (0, 1)
    assert summary("view", out, "-o", page)["results"]["frames"] == 3
    with Trajectory(str(out)) as trajectory:
        meshes = [trajectory.mesh_at(k) for k in range(3)]
    assert (meshes[0].faces != meshes[2].faces).any()
    script = "(() => { const hit = viewer.probe(450, 350); return [hit.face, hit.vertex]; })()"
    hits = evaluated(page, tmp_path, f"[0, 1, 2].map((k) => (viewer.setFrame(k), {script}))")
    for mesh, (face, vertex) in zip(meshes, hits):
        assert vertex in mesh.faces[face]
    object_faces = json.loads(page.read_text("utf-8").split('json">')[1].split("</script>")[0])["objects"][0][
        "faces"
    ]
    decoded = [
        np.frombuffer(base64.b64decode(packed["base64"]), "<u4").reshape(-1, 3) for packed in object_faces
    ]
    assert all((faces == mesh.faces).all() for faces, mesh in zip(decoded, meshes))


def test_range_map_isolines_and_visibility_change_the_picture(summary, sphere, tmp_path):
    path, _ = sphere
    page = tmp_path / "page.html"
    summary("view", path, "-o", page, "--array", "height")
    steps = ['set("map", "sequential", "change")', 'set("lines", 20, "input")', 'set("high", 5, "change")']
    steps += ['document.querySelector("#objects input").click()']
    pushes = "".join(f"{step}; out.push({PIXELS}); " for step in steps)
    script = f"""(() => {{ const out = [{PIXELS}];
      const set = (id, v, e) => {{ const x = document.getElementById(id); x.value = v;
        x.dispatchEvent(new Event(e)); }};
      {pushes} return out; }})()"""
    pixels = evaluated(page, tmp_path, script)
    assert len({red for _, red, _ in pixels}) == 5 and pixels[-1][0] == 0


def test_curves_and_trajectories_are_shown(run, summary, sphere, tmp_path):
    path, _ = sphere
    ring = np.stack([np.cos(np.arange(20)), np.sin(np.arange(20)), np.zeros(20)], axis=1) * 1.2
    curve = tmp_path / "ring.vtp"
    write_mesh(str(curve), AnnotatedMesh(CurveSet.from_paths([ring])))
    page = tmp_path / "both.html"
    assert summary("view", path, curve, "-o", page)["results"]["objects"] == ["sphere.vtu", "ring.vtp"]
    mesh = tmp_path / "grid.ply"
    write_mesh(str(mesh), AnnotatedMesh(shapes.grid(4, 4)))
    falling = tmp_path / "falling.vtkhdf"
    words = ("--effect", "gravity", "--effect", "stretching", "--steps", "8", "--dt", "0.05")
    assert run("shell-sim", mesh, *words, "--frame-every", "0.05", "-o", falling).exit_code == 0
    moving = tmp_path / "moving.html"
    result = summary("view", falling, "--every", "2", "-o", moving)
    assert result["results"]["frames"] == 5
    rows = PIXELS.replace("grey += p[i] === p[i + 1] && p[i] === p[i + 2]", "grey += i / p.length")
    values = evaluated(
        moving, tmp_path, f"[{rows}, (viewer.setFrame(4), {rows}), viewer.data.times, viewer.state.frame]"
    )
    assert values[0][2] > 0.6 and values[1][2] < 0.4 and values[3] == 4  # rows from the bottom
    assert values[2] == pytest.approx(np.arange(0, 0.41, 0.1))
    tubes = evaluated(
        page, tmp_path, f"[(viewer.data.objects[0].visible = false, viewer.choose(''), {PIXELS})]"
    )
    share, red, _ = tubes[0]
    assert 0.002 < share < 0.1 and red > 80  # the ring alone: a thick line in its own colour


def test_every_without_a_trajectory_is_refused(run, sphere, tmp_path):
    result = run("view", sphere[0], "--every", "2", "-o", tmp_path / "page.html")
    assert result.exit_code == 2 and "--every: applies to trajectories" in result.stderr
    assert not (tmp_path / "page.html").exists()


def test_two_surfaces_are_shown_one_after_the_other(summary, tmp_path):
    for name, radius in (("before.ply", 1.0), ("after.ply", 0.5)):
        write_mesh(str(tmp_path / name), AnnotatedMesh(shapes.icosphere(2, radius)))
    page = tmp_path / "page.html"
    summary("view", tmp_path / "before.ply", tmp_path / "after.ply", "-o", page)
    script = f"[viewer.compare(), {PIXELS}[0], viewer.compare(), {PIXELS}[0], viewer.compare()]"
    first, large, second, small, again = evaluated(page, tmp_path, script)
    assert (first, second, again) == ("before.ply", "after.ply", "before.ply")
    assert small == pytest.approx(large / 4, rel=0.1)


@pytest.mark.slow
def test_three_hundred_thousand_faces_are_drawn_in_five_seconds_of_processor_time(summary, tmp_path):
    """Processor time of the browser with its start: less than 5 s by the clock where a processor is free."""
    resource = pytest.importorskip("resource")
    mesh = shapes.grid(388, 388)
    write_mesh(str(tmp_path / "big.vtu"), AnnotatedMesh(mesh, {"x": mesh.points[:, 0]}))
    summary("view", tmp_path / "big.vtu", "-o", tmp_path / "big.html")
    began = resource.getrusage(resource.RUSAGE_CHILDREN)
    share, value = evaluated(tmp_path / "big.html", tmp_path, f"[{PIXELS}[0], viewer.probe(450, 350).value]")
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = ended.ru_utime + ended.ru_stime - began.ru_utime - began.ru_stime
    assert share > 0.05 and 0 < value < 1
    assert seconds < 5


@pytest.mark.parametrize(
    "words, text",
    [
        ((), "add -o page.html"),
        (("-o", "page.txt"), "unknown format .txt"),
        (("-o", "page.html", "--array", "nothing"), "--array: no array 'nothing'"),
    ],
)
def test_wrong_calls_are_refused_in_one_line(run, sphere, tmp_path, monkeypatch, words, text):
    monkeypatch.chdir(tmp_path)
    result = run("view", sphere[0], *words)
    assert result.exit_code == 2 and text in result.stderr
    assert len(result.stderr.splitlines()) == 1 and not (tmp_path / "page.html").exists()


def test_names_in_the_page_cannot_end_its_script(summary, tmp_path):
    path = tmp_path / "a<b&.vtu"
    mesh = shapes.icosphere(1)
    write_mesh(str(path), AnnotatedMesh(mesh, vertex={"</script>": mesh.points[:, 0]}))
    page = tmp_path / "page.html"
    summary("view", path, "-o", page)
    text = page.read_text("utf-8")
    assert "a&lt;b&amp;.vtu" in text and "a<b" not in text
    assert text.count("</script>") == 2


def test_jumps_are_to_drawn_places_of_shown_inputs_and_centre_on_them(summary, tmp_path):
    mesh, page = shapes.icosphere(2), tmp_path / "page.html"
    apart = mesh.moved(mesh.points + [3.0, 0, 0])
    unused = np.vstack([mesh.points, [[0, 0, 9.0]]])
    height = {"height": np.append(mesh.points[:, 2], 99.0)}
    write_mesh(str(tmp_path / "a.vtu"), AnnotatedMesh(TriangleMesh.from_arrays(unused, mesh.faces), height))
    write_mesh(str(tmp_path / "b.vtu"), AnnotatedMesh(apart, {"height": 5.0 + mesh.points[:, 2]}))
    report = summary("view", tmp_path / "a.vtu", tmp_path / "b.vtu", "-o", page)
    assert report["input"]["path"] == f"{tmp_path / 'a.vtu'} {tmp_path / 'b.vtu'}"
    assert report["input"]["faces"] == 2 * mesh.n_faces and report["input"]["vertices"] == 325
    place = "viewer.place(viewer.data.objects[viewer.state.probe.number], viewer.state.probe.vertex)"
    shown, hidden, centre, span = without_browser(page, tmp_path, f"""(() => {{
      const span = viewer.state.range, shown = viewer.jump(1); viewer.data.objects[1].visible = false;
      viewer.state.zoom = 8; return [shown, viewer.jump(1), {place}, span]; }})()""")  # fmt: skip
    assert (shown["object"], shown["value"]) == ("b.vtu", 5.0 + mesh.points[:, 2].max())
    assert (hidden["object"], hidden["value"]) == ("a.vtu", mesh.points[:, 2].max())
    assert hidden["vertex"] in mesh.faces[hidden["face"]]
    np.testing.assert_allclose(centre, 0.0, atol=1e-6)
    assert span[0] < -0.9 and span[1] > 5.9  # of both inputs


def test_the_values_of_a_place_follow_the_frames(run, summary, tmp_path):
    write_mesh(str(tmp_path / "ball.ply"), AnnotatedMesh(shapes.icosphere(2)))
    out, page = tmp_path / "run.vtkhdf", tmp_path / "page.html"
    words = ["--vorticity", "5*z+x*y", "--duration", "0.2", "--dt", "0.1", "-o", out]
    assert run("fluid-sim", tmp_path / "ball.ply", *words).exit_code == 0
    summary("view", out, "-o", page)
    script = """(() => { const first = viewer.jump(1); viewer.setFrame(2);
      return [first, viewer.state.probe, viewer.state.array,
        document.getElementById("probe").textContent]; })()"""
    first, last, array, text = without_browser(page, tmp_path, script)
    with Trajectory(str(out)) as trajectory:
        before, after = (float(trajectory.vertex(k)["vorticity"][first["vertex"]]) for k in (0, 2))
    assert array == "vorticity" and first["vertex"] == last["vertex"]
    assert (first["value"], last["value"]) == (before, after) and before != after
    assert f"vorticity {after!r}" in text


def test_the_place_of_a_mesh_with_other_vertices_is_cleared(tmp_path):
    spheres = [shapes.icosphere(k) for k in (1, 2)]
    values = [mesh.points[:, 2] for mesh in spheres]
    viewed = ViewedObject("x", [m.points for m in spheres], [m.faces for m in spheres], {"z": values})
    page = tmp_path / "page.html"
    page.write_bytes(page_bytes("x", [viewed], [0.0, 1.0]))
    script = "[viewer.jump(1).value, (viewer.setFrame(1), viewer.state.probe), viewer.jump(1).value]"
    first, gone, last = without_browser(page, tmp_path, script)
    assert gone is None and [first, last] == [values[0].max(), values[1].max()]


def test_tubes_have_the_values_of_their_vertices(summary, tmp_path):
    x = np.arange(5.0)
    curve = CurveSet.from_paths([np.stack([x, x**2, 0 * x], axis=1)])
    write_mesh(str(tmp_path / "curve.npz"), AnnotatedMesh(curve, {"curvature": 10 + x}))
    page = tmp_path / "page.html"
    summary("view", tmp_path / "curve.npz", "-o", page)
    script = "[viewer.state.array, viewer.jump(1), viewer.gl.uploads.map((x) => [...x])]"
    array, largest, uploads = without_browser(page, tmp_path, script)
    assert array == "curvature" and (largest["vertex"], largest["face"], largest["value"]) == (4, 3, 14.0)
    positions, values = np.reshape(uploads[0], (-1, 3)), np.array(uploads[1])
    data = json.loads(page.read_text("utf-8").split('json">')[1].split("</script>")[0])
    centres = (curve.points - data["centre"]) / data["size"]
    nearest = np.linalg.norm(positions[:, None] - centres, axis=2).argmin(axis=1)
    shown = next(a for a in data["objects"][0]["arrays"] if a["name"] == array)
    low, high = shown["low"], shown["high"]
    np.testing.assert_allclose(values, (10 + nearest - low) / (high - low), rtol=1e-5)


@pytest.mark.parametrize("arrays", [{"input_vertex": 1, "area": 2}, {"area": 2}, {"input_vertex": 1}])
def test_numbers_of_elements_are_no_default(summary, tmp_path, arrays):
    mesh, page = shapes.icosphere(1), tmp_path / "page.html"
    vertex = {name: k * np.arange(mesh.n_vertices) for name, k in arrays.items()}
    write_mesh(str(tmp_path / "m.npz"), AnnotatedMesh(mesh, vertex))
    summary("view", tmp_path / "m.npz", "-o", page)
    data = json.loads(page.read_text("utf-8").split('json">')[1].split("</script>")[0])
    assert data["show"] == ("area" if "area" in arrays else "")
    assert without_browser(page, tmp_path, "viewer.state.array") == data["show"]


def page_of(tmp_path, objects, times=(), **words):
    page = tmp_path / "page.html"
    page.write_bytes(page_bytes("x", objects, times, **words))
    return page


def test_long_data_are_in_parts_that_a_browser_reads_in_linear_time(tmp_path):
    mesh = shapes.icosphere(5)
    z = mesh.points[:, 2]
    heights = [k * z for k in range(1, 13)]
    viewed = ViewedObject("\N{GREEK SMALL LETTER PI}<", [mesh.points], [mesh.faces], {"z": heights})
    page = page_of(tmp_path, [viewed], list(range(12)))
    lengths = [len(piece) for piece in page.read_text("utf-8").split("</script>")]
    assert len(lengths) > 3 and max(lengths) < 1.1 * 2**20
    script = "[viewer.jump(1), (viewer.setFrame(2), viewer.jump(-1))]"
    first, last = without_browser(page, tmp_path, script)
    assert first["object"] == viewed.name and (first["value"], last["value"]) == (z.max(), 3 * z.min())


@pytest.mark.parametrize("factor", [1e-50, 1.0, 1e200])
def test_finite_values_of_every_size_have_colours(tmp_path, factor):
    mesh = shapes.icosphere(1)
    values = factor * (2 + mesh.points[:, 2])
    values[0] = np.nan
    page = page_of(tmp_path, [ViewedObject("x", [mesh.points], [mesh.faces], {"z": [values]})])
    array = json.loads(page.read_text("utf-8").split('json">')[1].split("</script>")[0])["objects"][0][
        "arrays"
    ][0]
    uploaded = np.array(without_browser(page, tmp_path, "[...viewer.gl.uploads[1]]"))
    shares = (values - array["low"]) / (array["high"] - array["low"])
    missing = mesh.faces.ravel() == 0
    np.testing.assert_allclose(uploaded[~missing], shares[mesh.faces.ravel()[~missing]], atol=1e-6)
    assert (uploaded[missing] > 1e38).all() and array["ends"] == [np.nanmin(values), np.nanmax(values)]


def test_a_range_is_typed_reversed_and_emptied(tmp_path):
    mesh = shapes.icosphere(1)
    page = page_of(tmp_path, [ViewedObject("x", [mesh.points], [mesh.faces], {"z": [mesh.points[:, 2]]})])
    script = """(() => {
      const type = (id, value) => { const field = document.getElementById(id); field.value = value;
        field.send("change"); return [...viewer.gl.uploads.at(-1)]; };
      const first = viewer.state.range.slice();
      return [type("low", "1"), type("high", "-1"), (type("low", ""), type("high", "")), first,
        viewer.state.range]; })()"""
    _, reversed_range, emptied, first, last = without_browser(page, tmp_path, script)
    z = mesh.points[mesh.faces.ravel(), 2]
    np.testing.assert_allclose(reversed_range, (1 - z) / 2, atol=1e-6)
    np.testing.assert_allclose(emptied, (z - first[0]) / (first[1] - first[0]), atol=1e-6)
    assert first == last


def test_the_wheel_keeps_the_place_under_the_pointer(tmp_path):
    mesh = shapes.icosphere(2)
    page = page_of(tmp_path, [ViewedObject("x", [mesh.points], [mesh.faces], {"z": [mesh.points[:, 2]]})])
    place = "viewer.place(viewer.data.objects[0], viewer.state.probe.vertex)"
    script = f"""(() => {{ viewer.jump(1); viewer.state.pan = [0.3, -0.2]; const before = {place};
      const pointer = {{ deltaY: -900, offsetX: 400 * (1 + before[0]), offsetY: 300 * (1 - before[1]) }};
      const canvas = document.getElementById("canvas"), zoom = viewer.state.zoom;
      canvas.send("wheel", {{ ...pointer, clientX: pointer.offsetX + 280, clientY: pointer.offsetY }});
      return [before, {place}, viewer.state.zoom / zoom]; }})()"""
    before, after, factor = without_browser(page, tmp_path, script)
    np.testing.assert_allclose(after, before, atol=1e-6)
    assert factor == pytest.approx(np.exp(0.9))


def test_keys_rotate_move_and_zoom_as_the_mouse_does(tmp_path):
    mesh = shapes.icosphere(1)
    page = page_of(tmp_path, [ViewedObject("x", [mesh.points], [mesh.faces])])
    script = """(() => { const canvas = document.getElementById("canvas"), state = viewer.state;
      const view = () => [...state.rotation, ...state.pan, state.zoom], out = [view()];
      const key = (key, shiftKey = false) => { canvas.send("keydown", { key, shiftKey }); out.push(view()); };
      const drag = (shiftKey, x, y) => {
        canvas.send("pointerdown", { clientX: 0, clientY: 0, button: 0, shiftKey });
        canvas.send("pointermove", { clientX: x, clientY: y }); canvas.send("pointerup", {});
        out.push(view()); };
      key("ArrowRight"); drag(false, -20, 0); key("ArrowUp"); drag(false, 0, 20);
      key("ArrowLeft", true); drag(true, 20, 0); key("+"); key("-"); key("a"); return out; })()"""
    views = np.array(without_browser(page, tmp_path, script))
    for before, changed, back in (views[0:3], views[2:5], views[4:7], views[6:9]):
        assert np.abs(changed - before).max() > 0.04
        np.testing.assert_allclose(back, before, atol=1e-12)
    np.testing.assert_array_equal(views[-1], views[-2])


@pytest.mark.parametrize("size", [(800, 600), (400, 385), (300, 900)])
@pytest.mark.parametrize("shape", [shapes.grid(4, 4), shapes.icosphere(2), shapes.cylinder(12, 4, 0.01, 2.0)])
def test_all_of_a_shape_is_in_the_window_at_first(tmp_path, size, shape):
    page = page_of(tmp_path, [ViewedObject("x", [shape.points], [shape.faces])])
    script = f"""(() => {{ const canvas = document.getElementById("canvas");
      [canvas.clientWidth, canvas.clientHeight] = [{size[0]}, {size[1]}]; viewer.draw();
      const vertices = [...Array({shape.n_vertices}).keys()];
      return vertices.map((v) => viewer.place(viewer.data.objects[0], v)); }})()"""
    reach = np.abs(without_browser(page, tmp_path, script)).max()
    assert 0.4 < reach < 0.95


def test_an_input_with_the_array_is_drawn_before_others_at_the_same_place(tmp_path):
    """Of equal depths the first is seen: a grey copy hid the colours."""
    mesh = shapes.icosphere(1)
    line = ViewedObject("line", [mesh.points], [mesh.faces[:, :2]], {"z": [mesh.points[:, 2]]})
    objects = [
        ViewedObject("grey", [mesh.points], [mesh.faces]),
        line,
        ViewedObject("b", [mesh.points], [mesh.faces]),
    ]
    objects[2].vertex["w"] = [mesh.points[:, 0]]
    page = page_of(tmp_path, objects)
    script = """["z", "w", ""].map((name) => { viewer.gl.drawn.length = 0; viewer.choose(name);
      return viewer.gl.drawn.map(({ object, mode }) => [object, mode]); })"""
    by_array = without_browser(page, tmp_path, script)
    assert by_array == [[[1, 0], [0, 0], [2, 0]], [[2, 0], [0, 0], [1, 2]], [[0, 0], [1, 2], [2, 0]]]


def test_times_are_short_and_the_values_of_all_frames_have_their_ends(tmp_path):
    mesh = shapes.icosphere(2)
    values = [mesh.points[:, 2], 3 * mesh.points[:, 2]]
    viewed = ViewedObject("x", [mesh.points], [mesh.faces], {"z": values})
    page = page_of(tmp_path, [viewed], [0.0, 0.1 + 0.2])
    script = """(viewer.setFrame(1), ["clock", "ends", "low"].map((id) => {
      const { textContent, value } = document.getElementById(id); return textContent || value; }))"""
    clock, ends, low = without_browser(page, tmp_path, script)
    assert clock == "1 of 1, t = 0.3" and ends == "values from -3 to 3" and low > -3


def test_arrays_that_the_page_cannot_show_are_named(run, tmp_path):
    mesh = shapes.icosphere(1)
    arrays = AnnotatedMesh(
        mesh, {"z": mesh.points[:, 2]}, edge={"dihedral": np.ones(len(mesh.topology.edges))}
    )
    write_mesh(str(tmp_path / "edges.npz"), arrays)
    result = run("view", tmp_path / "edges.npz", "-o", tmp_path / "page.html")
    assert (
        result.exit_code == 0
        and "edges.npz: the page does not show arrays on edges (dihedral)" in result.stderr
    )
