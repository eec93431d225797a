"""Mutated inputs of every kind we read ourselves: nothing but our own errors, within time and memory.

`python -m benchmarks.fuzz [--format NAME] [--seconds S] [--seed N]`: mutates valid files of a kind until the
seconds are over; prints one line a kind (inputs tried, accepted, refused, the slowest) and every escape: an
exception that is not ours, a message over two lines' length, or an input that takes too long. They are in
`build/fuzz/`, and the exit code is 1.
"""

from __future__ import annotations

import argparse
import io
import json
import random
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ddgcli.errors import DdgError

LONGEST_MESSAGE = 600  # characters, beside the path
SECONDS_FOR_ONE = 20.0  # of processor time, for inputs of some kilobytes
WORDS = [
    b"nan", b"inf", b"-1", b"1e400", b"0", b"4294967297", b"99999999999999999999", b"1.5", b"", b"\0", b" ",
    b"\n", b"[", b"]", b'"', b"UInt8", b"Float64", b"vertex", b"#", b"<", b">", b"-", b"1e-320", b"true",
]  # fmt: skip


def mutated(data: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    """Random changes: bytes, numbers, words; pieces moved, doubled, cut, or copied from another file."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        at = rng.randrange(len(changed) + 1)
        end = min(len(changed), at + rng.choice((1, 1, 2, 4, 8, 40, 400)))
        kind = rng.randrange(8)
        if kind == 0 and changed:
            changed[min(at, len(changed) - 1)] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
        elif kind == 1:
            changed[at:end] = rng.choice(WORDS)
        elif kind == 2:
            del changed[at:end]
        elif kind == 3:
            changed[at:at] = changed[at:end]
        elif kind == 4:
            other = rng.choice(others)
            start = rng.randrange(len(other) + 1)
            changed[at:end] = other[start : start + rng.choice((1, 8, 100))]
        elif kind == 5 and end - at >= 4:
            value = rng.choice((0, 1, -1, 2**31 - 1, -(2**31), rng.randrange(2**31)))
            changed[at : at + 4] = value.to_bytes(4, rng.choice(("little", "big")), signed=True)
        elif kind == 6:
            text = bytes(changed)
            digits = [k for k, letter in enumerate(text[:20000]) if 48 <= letter < 58]
            if digits:
                place = rng.choice(digits)
                changed[place : place + 1] = rng.choice(WORDS)
        else:
            changed = changed[:at] if rng.random() < 0.3 else changed
    return bytes(changed)


@dataclass
class Account:
    """What came of the inputs of one kind."""

    tried: int = 0
    accepted: int = 0
    refused: int = 0
    slowest: float = 0.0
    escapes: list[tuple[str, bytes]] = field(default_factory=list)


def outcome(read: Callable[[bytes], object], data: bytes) -> tuple[str, str]:
    """('accepted' | 'refused' | 'escape', message)."""
    began = time.process_time()
    try:
        read(data)
        kind, message = "accepted", ""
    except DdgError as error:
        message = str(error)
        kind = "refused" if len(message) <= LONGEST_MESSAGE else "escape"
    except Exception as error:
        kind, message = "escape", f"{type(error).__name__}: {error}"
    if time.process_time() - began > SECONDS_FOR_ONE:
        kind, message = "escape", f"took {time.process_time() - began:.0f} s"
    return kind, message


def fuzz(
    name: str, seeds: list[bytes], read: Callable[[bytes], object], seconds: float, count: int, seed: int
) -> Account:
    """Try mutations of the seeds until `seconds` or `count` inputs are over."""
    rng, account, end = random.Random(f"{name} {seed}"), Account(), time.monotonic() + seconds
    while account.tried < count and time.monotonic() < end:
        data = mutated(rng.choice(seeds), rng, seeds)
        began = time.monotonic()
        kind, message = outcome(read, data)
        account.tried += 1
        account.accepted += kind == "accepted"
        account.refused += kind == "refused"
        account.slowest = max(account.slowest, time.monotonic() - began)
        if kind == "escape" and len(account.escapes) < 20:
            account.escapes.append((message[:300], data))
    return account


# -- the kinds: valid inputs, and how each is read --


def mesh_seeds(suffix: str) -> list[bytes]:
    """Small valid files of a format, as we write them, with arrays."""
    from ddgcli.io.mesh_file import WRITERS, write_mesh
    from ddgcli.mesh import shapes
    from ddgcli.mesh.fields import AnnotatedMesh

    ball = shapes.icosphere(0)
    arrays = {"f": ball.points[:, 2], "v": ball.points, "k": np.arange(ball.n_vertices)}
    annotated = AnnotatedMesh(ball, arrays, {"face": np.arange(20)})
    rows = "\n".join(" ".join(f"{x:.3g}" for x in p) for p in ball.points)
    faces = "\n".join("3 " + " ".join(map(str, f)) for f in ball.faces)
    axes = "".join(f"property float {c}\n" for c in "xyz")
    scalars = f"POINT_DATA 12\nSCALARS s int 1\nLOOKUP_TABLE default\n{'1 ' * 12}\n"
    texts = {
        ".csv": "x,y,z\n0,0,0\n1,0,0\n1,1,0\n0,0,0\n",
        ".wkt": "TIN (((0 0 0, 1 0 0, 0 1 0, 0 0 0)), ((1 0 0, 1 1 0, 0 1 0, 1 0 0)))",
        ".stl": "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
        "endfacet\nendsolid a\n",
        ".ply": "ply\nformat ascii 1.0\nelement vertex 12\n"
        + axes
        + f"element face 20\nproperty list uchar int vertex_indices\nend_header\n{rows}\n{faces}\n",
        ".vtk": "# vtk DataFile Version 3.0\na\nASCII\nDATASET POLYDATA\nPOINTS 12 float\n"
        f"{rows}\nPOLYGONS 20 80\n{faces}\n{scalars}",
    }
    inputs = [texts[suffix].encode()] if suffix in texts else []
    if suffix in WRITERS:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"a{suffix}"
            write_mesh(str(path), annotated)
            inputs.append(path.read_bytes())
    return inputs


def read_mesh_bytes(suffix: str) -> Callable[[bytes], object]:
    """How a file of a format is read; HDF5, whose process would be made each time, by its own process too."""
    from ddgcli.io.mesh_file import read_mesh

    folder = tempfile.mkdtemp(prefix="ddgcli-fuzz-")
    path = Path(folder) / f"a{suffix}"

    def read(data: bytes) -> object:
        path.write_bytes(data)
        return read_mesh(str(path))

    return read


def read_scene_bytes(data: bytes) -> object:
    """A scene as shell-sim reads it, up to its models."""
    return _ended("shell-sim", data, "scene.toml")


def read_expected(data: bytes) -> object:
    """A stored summary as `check` reads it."""
    from ddgcli.algorithms.inspection.compare_summaries import Tolerances, compare
    from ddgcli.cli.commands.check import read_expected as read

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "e.json"
        path.write_bytes(data)
        stored = read(str(path), may_miss=False)
    return compare(stored["summary"], {"results": {"a": 1}}, Tolerances(**stored.get("tolerances", {})))


def read_expression(data: bytes) -> object:
    """An expression, whose own refusal is ValueError."""
    from ddgcli.scenes.expressions import evaluate

    x = np.linspace(-1, 1, 5)
    try:
        return evaluate(data.decode("utf-8", "replace"), {"x": x, "y": x, "z": x})
    except ValueError as error:
        raise DdgError(str(error)[:LONGEST_MESSAGE]) from None


def read_array_bytes(suffix: str) -> Callable[[bytes], object]:
    """A file of `--field-file`."""
    from ddgcli.io.arrays import read_array

    path = Path(tempfile.mkdtemp(prefix="ddgcli-fuzz-")) / f"a{suffix}"

    def read(data: bytes) -> object:
        path.write_bytes(data)
        return read_array(str(path))

    return read


def _ended(command: str, data: bytes, name: str) -> object:
    """The command line in this process; its refusals become DdgError."""
    from click.testing import CliRunner

    from ddgcli.cli.main import main as command_line

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(data)
        done = CliRunner().invoke(command_line, [command, str(path), "--json"])
        message = done.stderr.strip().replace(folder, "")
    if done.exit_code == 0:
        return done
    if "internal error" in message or done.exit_code not in (1, 2):
        raise RuntimeError(message or repr(done.exception))
    raise DdgError(message)


def array_seeds(suffix: str) -> list[bytes]:
    stream = io.BytesIO()
    if suffix == ".npy":
        np.save(stream, np.arange(12.0).reshape(4, 3))
    elif suffix == ".npz":
        np.savez_compressed(stream, f=np.arange(12.0))
    else:
        stream.write(b"1,2,3\n4,5,6\n" if suffix == ".csv" else b"1 2 3\n4 5 6\n")
    return [stream.getvalue()]


SCENE = b"""format = "ddgcli-scene/1"
[time]
duration = 1e-3
step = 1e-3
[[object]]
name = "hat"
role = "shell"
grid = { size = [1, 1], cells = [2, 2] }
material = "felt"
[effects]
stretching = { model = "stvk" }
pin = { vertices = [0, 1] }
gravity = { acceleration = [0, 0, -9.81] }
"""
EXPECTED_SUMMARY = json.dumps(
    {"run": ["info", "a.ply"], "tolerances": {"rtol": 1e-6, "ignore": ["a"], "keys": {"b": {"rtol": 1}}},
     "summary": {"results": {"a": 1.0, "b": [1, 2, "c"]}, "input": {"path": "a.ply"}}}
).encode()  # fmt: skip
EXPRESSIONS = [b"exp(-(x^2+y^2)/0.1)*where(x<0, 1, 2)", b"sin(3*x) + min(y, z)**2 % 3", b"-hypot(x, y)"]
MESHES = [".ply", ".off", ".obj", ".stl", ".vtk", ".vtu", ".vtp", ".vtkhdf", ".npz", ".csv", ".wkt"]
ARRAYS = [".npy", ".npz", ".csv", ".txt"]


def kinds() -> dict[str, tuple[Callable[[], list[bytes]], Callable[[], Callable[[bytes], object]]]]:
    """name -> (valid inputs, reader), each computed on demand."""
    formats: dict = {s[1:]: (lambda s=s: mesh_seeds(s), lambda s=s: read_mesh_bytes(s)) for s in MESHES}
    formats |= {f"array{s}": (lambda s=s: array_seeds(s), lambda s=s: read_array_bytes(s)) for s in ARRAYS}
    formats["scene"] = (lambda: [SCENE], lambda: read_scene_bytes)
    formats["expression"] = (lambda: EXPRESSIONS, lambda: read_expression)
    formats["expected"] = (lambda: [EXPECTED_SUMMARY], lambda: read_expected)
    return formats


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--format", choices=list(kinds()), help="one kind only")
    parser.add_argument("--seconds", type=float, default=5.0, help="for each kind")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    bad = 0
    for name, (seeds, reader) in kinds().items():
        if options.format not in (None, name):
            continue
        account = fuzz(name, seeds(), reader(), options.seconds, sys.maxsize, options.seed)
        print(
            f"{name:12s} {account.tried:7d} inputs, {account.accepted:6d} accepted, "
            f"{account.refused:7d} refused, {len(account.escapes)} escapes, slowest {account.slowest:.2f} s",
            flush=True,
        )
        for number, (message, data) in enumerate(account.escapes):
            folder = Path("build/fuzz")
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f"{name.replace('.', '_')}_{number}").write_bytes(data)
            print(f"  escape {number}: {message}")
            bad += 1
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
