"""Parameters in the messages of the core become options on the command line."""

import click

from ddgcli.cli.parameters import error_text, option_names, with_option_names
from ddgcli.errors import MeshError, ParameterError


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


def test_the_parameter_of_an_error_begins_the_message():
    error = ParameterError("must be positive", parameter="heat_time")
    assert error_text(error, NAMES) == "--heat-time: must be positive"
    assert str(error) == "heat_time: must be positive"
    assert error_text(MeshError("no faces; lower `heat_time`"), NAMES) == "no faces; lower --heat-time"
