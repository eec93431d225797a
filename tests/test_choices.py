"""Names of methods exist once: the core's tables and the command line use the lists of `ddgcli.choices`."""

import ast
from pathlib import Path

import click
import pytest

from ddgcli import choices
from ddgcli.algorithms.curvature.surface_curvature import DEFAULT_SCHEME, SCHEME_PROMISES
from ddgcli.algorithms.laplacian.laplace_operator import MASS_FUNCTIONS
from ddgcli.cli.main import main
from ddgcli.models.willmore.energies import ENERGIES
from ddgcli.models.willmore.flow_options import SCHEMES

LISTS = {name: value for name, value in vars(choices).items() if isinstance(value, tuple)}
TABLES = {
    "CURVATURE_SCHEMES": SCHEME_PROMISES,
    "MASSES": MASS_FUNCTIONS,
    "WILLMORE_ENERGIES": ENERGIES,
    "WILLMORE_FLOWS": SCHEMES,
}


def click_choices():
    """(command, option, names) of every option with a fixed list of names that are words."""
    context = click.Context(main)
    for verb in main.list_commands(context):
        for parameter in main.get_command(context, verb).params:
            if isinstance(parameter, click.Option) and isinstance(parameter.type, click.Choice):
                names = tuple(parameter.type.choices)
                if not all(name.isdigit() for name in names):
                    yield verb, parameter.name, names


def test_choices_imports_nothing():
    tree = ast.parse(Path(choices.__file__).read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(tree) if isinstance(node, (ast.Import, ast.ImportFrom))]
    assert [getattr(node, "module", None) for node in imports] == ["__future__"]


@pytest.mark.parametrize("name", TABLES)
def test_a_table_of_the_core_has_the_names_of_its_list(name):
    assert tuple(TABLES[name]) == LISTS[name]


def test_every_choice_of_the_command_line_is_a_list_of_choices():
    options = list(click_choices())
    assert len(options) >= 10
    assert [option for option in options if option[2] not in LISTS.values()] == []


def test_no_list_repeats_a_name():
    assert choices.CURVATURE_SCHEMES[0] == DEFAULT_SCHEME
    assert all(len(set(names)) == len(names) for names in LISTS.values())
