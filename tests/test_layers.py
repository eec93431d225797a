"""Arrows point one way: each room imports only the rooms below it."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "ddgcli"

CORE = {"errors", "progress", "mesh", "geometry", "operators", "linalg"}
MAY_IMPORT = {
    "__init__": set(),
    "__main__": {"cli"},
    "errors": set(),
    "progress": set(),
    "mesh": {"errors"},
    "io": {"errors", "mesh"},
    "geometry": {"errors", "mesh"},
    "operators": {"errors", "mesh", "geometry", "linalg"},
    "linalg": {"errors", "progress"},
    "algorithms": CORE,
    "simulation": {"errors", "progress", "mesh", "linalg"},
    "mechanics": {"errors", "linalg", "simulation"},
    "scenes": {"errors", "mesh", "simulation"},
    "models": CORE | {"algorithms", "simulation", "mechanics", "scenes"},
    "tradeoff": CORE | {"algorithms", "simulation", "mechanics", "scenes", "models"},
    "plots": {"errors", "mesh", "geometry"},
    "cli": CORE
    | {"__init__", "io", "algorithms", "simulation", "mechanics", "scenes", "models", "tradeoff", "plots"},
}
# packages of `algorithms`, and which of the others each may import
TOPICS = {
    "tracing": set(),
    "hodge": set(),
    "inspection": set(),
    "delaunay": {"tracing"},
    "curvature": {"delaunay"},
    "laplacian": {"delaunay"},
    "geodesics": {"tracing", "delaunay"},
    "tangent_fields": {"tracing", "delaunay", "geodesics"},
}
# third-party modules that live in one room only
ONE_ROOM = {"click": {"cli"}, "meshio": {"io"}, "trimesh": {"io"}, "h5py": {"io"}, "matplotlib": {"plots"}}
PEERS = {"igl", "potpourri3d", "pygeodesic", "robust_laplacian", "pymeshlab", "gpytoolbox"}


def imported(source: str) -> list[str]:
    """Dotted names that a source imports, wherever the statement stands."""
    names: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "absolute imports only"
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


def wrong_arrows(room: str, source: str) -> list[str]:
    """Names that a file of `room` may not import."""
    wrong = []
    for name in imported(source):
        top, *rest = name.split(".")
        if top == "ddgcli" and rest and rest[0] in MAY_IMPORT:
            if rest[0] != room and rest[0] not in MAY_IMPORT[room]:
                wrong.append(name)
        elif top in PEERS or (top in ONE_ROOM and room not in ONE_ROOM[top]):
            wrong.append(name)
    return wrong


def wing_of(path: Path) -> str | None:
    parts = path.relative_to(PACKAGE).parts
    return parts[1] if parts[0] == "models" and len(parts) > 2 else None


def files() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


@pytest.mark.parametrize("path", files(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_arrows_point_one_way(path):
    room = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    source = path.read_text(encoding="utf-8")
    assert wrong_arrows(room, source) == []
    wing = wing_of(path)
    if wing:
        others = [n for n in imported(source) if n.startswith("ddgcli.models.") and n.split(".")[2] != wing]
        assert [n for n in others if n.split(".")[2] in {"shell", "fluid", "willmore"}] == []


@pytest.mark.parametrize(
    "room, source",
    [
        ("geometry", "import ddgcli.cli.main"),
        ("geometry", "from ddgcli import io"),
        ("mesh", "def f():\n    from ddgcli.io.mesh_file import read_mesh"),
        ("algorithms", "import click"),
        ("algorithms", "import igl"),
        ("cli", "import h5py"),
    ],
)
def test_a_wrong_arrow_is_seen(room, source):
    assert wrong_arrows(room, source)


def wrong_topics(topic: str, source: str) -> list[str]:
    """Names of other topics that a file of `topic` may not import."""
    names = [name.split(".") for name in imported(source) if name.startswith("ddgcli.algorithms.")]
    return [".".join(n) for n in names if n[2] != topic and n[2] not in TOPICS[topic]]


@pytest.mark.parametrize("topic", sorted(TOPICS))
def test_topics_of_algorithms_point_one_way(topic):
    wrong = {
        f.name: wrong_topics(topic, f.read_text()) for f in (PACKAGE / "algorithms" / topic).rglob("*.py")
    }
    assert wrong and not any(wrong.values()), wrong


def test_a_topic_that_reaches_up_is_seen():
    assert {p.name for p in (PACKAGE / "algorithms").iterdir() if (p / "__init__.py").exists()} == set(TOPICS)
    assert wrong_topics("delaunay", "from ddgcli.algorithms.geodesics.paths import seen_from") != []
