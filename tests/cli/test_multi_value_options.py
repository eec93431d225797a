"""Several values after one option, and everything else left as it is."""

import json

import click
import pytest

from ddgcli.cli.multi_value import repeat_options


@click.command()
@click.argument("mesh")
@click.option("--source", type=int, multiple=True)
@click.option("--time", "times", type=float, multiple=True)
@click.option("--trace", multiple=True)
@click.option("--method", multiple=True, type=click.Choice(["heat", "exact"]))
@click.option("-o", "--output", multiple=True, type=click.Path())
@click.option("--radius", type=float)
def command(**_):
    """All kinds of options."""


@pytest.mark.parametrize(
    "words, expected",
    [
        ("m.ply --source 0 5 12", "m.ply --source 0 --source 5 --source 12"),
        ("--source 0 m.ply", "--source 0 m.ply"),
        ("--source 0 5 m.ply --radius 3", "--source 0 --source 5 m.ply --radius 3"),
        ("m.ply --time 1e-3 -2 -v", "m.ply --time 1e-3 --time -2 -v"),
        ("m.ply --trace 0:1,0:2 3:0,1:1", "m.ply --trace 0:1,0:2 --trace 3:0,1:1"),
        ("--trace 0:1,0:2 m.ply", "--trace 0:1,0:2 m.ply"),
        ("m.ply --method heat exact", "m.ply --method heat --method exact"),
        ("-o a.ply m.ply", "-o a.ply m.ply"),
        ("--radius 3 4", "--radius 3 4"),
        ("--source 0 -- 5", "--source 0 -- 5"),
    ],
)  # fmt: skip
def test_words_are_spread(words, expected):
    assert repeat_options(command, words.split()) == expected.split()


@pytest.mark.parametrize("joined, apart", [("5,6,7", "5 6 7"), ("5 6,7", "5,6 7")])
def test_vertex_numbers_are_joined_by_commas_or_stand_apart(run, joined, apart):
    words = ("geodesic", "sample_meshes/sphere.ply", "--source", "0", "--json", "--path-to")
    paths, same = (json.loads(run(*words, *w.split()).stdout)["results"]["paths"] for w in (joined, apart))
    assert [path["target"] for path in paths] == [5, 6, 7] and paths == same


def test_pins_are_joined_by_commas(run):
    words = ("shell-sim", "sample_meshes/hat.ply", "--effect", "stretching", "--dry-run", "--json", "--pin")
    scene = json.loads(run(*words, "5,6", "7").stdout)["scene"]
    assert scene["effects"]["pin"]["vertices"] == [5, 6, 7]
