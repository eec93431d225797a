"""Parameters in the messages of the core become options on the command line."""

import ast
import re

import click
import pytest

from ddgcli.cli.main import COMMANDS
from ddgcli.cli.parameters import error_text, option_names, with_option_names, with_repair_command
from ddgcli.errors import MeshError, ParameterError, renamed_parameters
from ddgcli.library.arguments import with_repair_call
from tests.test_layers import PACKAGE


@click.command()
@click.option("--heat-time", type=float)
@click.option("-n", "--count", "n_values", type=int)
def command(heat_time, n_values):
    """Two options."""


NAMES = option_names(command)


def test_quoted_parameters_become_options_and_other_quotes_stay():
    text = "use `heat_time`, `n_values=3` or `count`; `d.array` and `unknown=2` stay"
    expected = "use --heat-time, --count 3 or --count; `d.array` and `unknown=2` stay"
    assert with_option_names(text, NAMES) == expected


def test_an_entry_of_a_dict_becomes_the_word_of_an_option():
    assert with_option_names("add `n_values={12: 0.5}`", NAMES) == "add --count 12=0.5"


def test_a_caller_names_its_own_parameters_in_errors_of_a_function():
    with pytest.raises(ParameterError) as caught, renamed_parameters(k="eigen", time="smooth"):
        raise ParameterError("exceeds `time=3` or `other`", parameter="k")
    assert caught.value.parameter == "eigen"
    assert str(caught.value) == "eigen: exceeds `smooth=3` or `other`"
    with pytest.raises(MeshError, match="^lower `smooth`$"), renamed_parameters("all", time="smooth"):
        raise MeshError("lower `time`")
    with pytest.raises(ParameterError, match="^all: is wrong$"), renamed_parameters("all", time="smooth"):
        raise ParameterError("is wrong")


def test_the_parameter_of_an_error_begins_the_message():
    error = ParameterError("must be positive", parameter="heat_time")
    assert error_text(error, NAMES) == "--heat-time: must be positive"
    assert str(error) == "heat_time: must be positive"
    assert error_text(MeshError("no faces; lower `heat_time`"), NAMES) == "no faces; lower --heat-time"


def test_quoted_meshes_become_the_commands_that_write_them_and_calls_in_the_library():
    text = "take their boundary, `boundary_mesh`, or begin with the mesh of `refined_mesh=25`"
    assert with_repair_command(text, ("a b.ply", "--input-format", "ply")) == (
        "take their boundary, ddgcli info 'a b.ply' --input-format ply -o surface.ply, or begin with the "
        "mesh of ddgcli delaunay 'a b.ply' --input-format ply --refine 25 -o finer.npz"
    )
    assert with_repair_command("`boundary_mesh=c.vtu`") == "ddgcli info c.vtu -o surface.ply"
    assert with_repair_call(text) == (
        "take their boundary, `mesh.boundary`, or begin with the mesh of "
        "`ddg.delaunay_refinement(mesh, 25).mesh`, its `points` and `faces`"
    )
    assert with_repair_call("begin with `subdivide=1`") == "begin with `ddg.subdivide(mesh)`"


def test_names_that_a_message_advises_are_quoted_in_the_library():
    text = "use `scheme=normal-voting` with `radius=0.5` or `radius=auto`; `repair=orient`, `steps`"
    assert with_repair_call(text) == (
        "use `scheme='normal-voting'` with `radius=0.5` or `radius='auto'`; "
        "`ddg.repair_mesh(mesh, orient=True)`, `steps`"
    )


def test_the_core_holds_no_command_line():
    """Text of messages; command lines in docstrings are documentation."""
    call = re.compile(rf"\bddgcli (?:{'|'.join(COMMANDS)})\b|(?<!pip install )(?<!\S)--[a-z]")
    core = [f for f in PACKAGE.rglob("*.py") if f.relative_to(PACKAGE).parts[0] != "cli"]
    lines = []
    for path in core:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        texts = [n for n in ast.walk(tree) if isinstance(n, ast.Constant) and isinstance(n.value, str)]
        stand_alone = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}  # docstrings
        lines += [f"{path}: {n.value}" for n in texts if id(n) not in stand_alone and call.search(n.value)]
    assert len(core) > 100 and not lines


def test_messages_of_wrong_calls_name_what_is_wrong_and_what_to_do(run):
    from tests.conftest import ROOT

    torus, scenes = ROOT / "sample_meshes" / "torus.ply", ROOT / "sample_scenes"
    calls = {
        ("geodesic", torus): "name a vertex, such as --source 0",
        ("laplacian", torus, "--eigen", "many"): "'many' is not a whole number",
        ("fluid-sim", scenes / "hat.toml"): "'shell' belongs to shell-sim",
        ("shell-sim", scenes / "vortex_pair_torus.toml"): "'fluid' belongs to fluid-sim",
    }
    for words, text in calls.items():
        result = run(*words)
        assert result.exit_code == 2 and text in result.stderr, result.stderr
        assert len(result.stderr.splitlines()) == 1
