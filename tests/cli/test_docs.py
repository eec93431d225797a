"""The pages and the program name the same options; their examples and links are right."""

import dataclasses
import functools
import re
import shlex
from pathlib import Path

import click
import pytest

from ddgcli.cli.main import COMMANDS, main
from ddgcli.cli.multi_value import repeat_options
from ddgcli.cli.options import CommonOptions

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
# command -> the pages that must name all of its own options
PAGES_OF = {
    "geodesic": ("geodesic", "geodesic-curves", "geodesic-waves"),
    "shell-sim": ("shell-sim", "scenes", "trajectory"),
    "fluid-sim": ("fluid-sim", "scenes", "trajectory"),
}
# headings of every command page, in this order
HEADINGS = ["What for", "Use", "Options", "Results", "Method and sources", "Limits"]
OPTION = re.compile(r"(?<![\w-])--?[a-zA-Z][a-z-]*")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.M | re.S)


def command_of(name: str) -> click.Command:
    return main.get_command(click.Context(main), name)


def options_of(name: str) -> list[click.Option]:
    return [p for p in command_of(name).params if isinstance(p, click.Option) and not p.hidden]


def shared() -> set[str]:
    """Names of the parameters that commands share."""
    return {"help_all", *(field.name for field in dataclasses.fields(CommonOptions))}


def text_of(*pages: str) -> str:
    return "\n".join((ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8") for page in pages)


def unnamed(options: list[click.Option], text: str) -> list[str]:
    """Options that a text names by none of their names."""
    named = set(OPTION.findall(text))
    return [option.opts[0] for option in options if not named & {*option.opts, *option.secondary_opts}]


@pytest.mark.parametrize("page", [*COMMANDS, "geodesic-curves", "geodesic-waves"])
def test_every_command_page_has_the_same_headings(page):
    text = FENCE.sub("code that is shown to the reader", text_of(page))
    assert re.findall(r"^## (.*)$", text, re.M) == HEADINGS
    assert re.findall(r"^# (.*)$", text, re.M)[0].startswith(
        f"`ddgcli {page.removesuffix('-curves').removesuffix('-waves')}`"
    )
    sections = re.split(r"^## .*$", text, flags=re.M)[1:]
    assert min(len(section.strip()) for section in sections) > 20


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_stands_on_its_page(name):
    own = [option for option in options_of(name) if option.name not in shared()]
    assert unnamed(own, text_of(*PAGES_OF.get(name, (name,)))) == []


def test_every_shared_option_stands_among_the_files():
    assert unnamed([o for o in options_of("info") if o.name in shared()], text_of("files", "pipelines")) == []


def test_an_undocumented_option_is_detected():
    assert unnamed([click.Option(["--no-such", "-z"])], text_of("files")) == ["--no-such"]


@functools.cache
def known_options() -> frozenset[str]:
    """Options of all commands, and whatever the benchmarks take."""
    options = {
        opt for name in COMMANDS for p in command_of(name).params for opt in (*p.opts, *p.secondary_opts)
    }
    options |= {"--help", "--debug", "--version"}
    options |= {
        word
        for bench in (ROOT / "benchmarks").rglob("*.py")
        for word in OPTION.findall(bench.read_text("utf-8"))
    }
    return frozenset(options)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_no_page_names_an_option_that_is_not_there(page):
    named = {word for word in OPTION.findall(page.read_text("utf-8")) if word.startswith("--")}
    assert named - known_options() == set()


def examples(page: Path) -> list[str]:
    """Command lines in the page's blocks of code, continued lines joined, comments off."""
    blocks = [body for _, body in FENCE.findall(page.read_text(encoding="utf-8"))]
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    return [
        line for line in lines if line.startswith("ddgcli ") and not re.search(r"[\[|]|\.\.\.|[A-Z]{4}", line)
    ]


def reads_samples(line: str) -> bool:
    """Whether all inputs of an example are there: samples, or a mechanical system without a file."""
    return ("sample_" in line or " pendulum " in line) and not line.startswith(
        "ddgcli check torus.json --arrays"
    )


LINES = list(dict.fromkeys(line for page in PAGES for line in examples(page)))


@pytest.mark.parametrize("line", [line for line in LINES if not reads_samples(line)])
def test_every_example_on_files_of_the_user_is_a_call(line):
    name, *words = shlex.split(line, comments=True)[1:]
    command = command_of(name)
    context = command.make_context(name, repeat_options(command, words), parent=click.Context(main))
    assert context.params.keys() == {parameter.name for parameter in command.params if parameter.expose_value}


@pytest.mark.parametrize("line", [line for line in LINES if reads_samples(line)])
def test_every_example_on_samples_passes_a_dry_run(line, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("sample_meshes", "sample_scenes"):
        (tmp_path / name).symlink_to(ROOT / name)
    words = shlex.split(line, comments=True)[1:]
    own = words.index("--") if "--" in words else len(words)
    result = run(*words[:own], "--dry-run", *words[own:])
    assert result.exit_code == 0, result.stderr


def test_every_sample_that_an_example_names_exists():
    lines = [line for page in PAGES for line in examples(page)]
    samples = [
        word for line in lines for word in shlex.split(line, comments=True) if word.startswith("sample_")
    ]
    assert len(samples) > 60
    assert [word for word in samples if not list(ROOT.glob(word))] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_every_link_leads_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if target.startswith("http"):
            continue
        path, _, anchor = target.partition("#")
        linked_page = (page.parent / path) if path else page
        assert linked_page.exists(), target
        headings = re.findall(r"^#+ (.*)$", linked_page.read_text(encoding="utf-8"), re.M) if anchor else []
        assert not anchor or anchor in [
            re.sub(r"[^\w -]", "", h).lower().replace(" ", "-") for h in headings
        ], target


def test_links_lead_from_the_readme_to_every_page():
    reached, waiting = set(), [ROOT / "README.md"]
    while waiting:
        page = waiting.pop()
        if page not in reached and page.suffix == ".md":
            reached.add(page)
            targets = re.findall(r"\]\(([^)\s#]+)", page.read_text(encoding="utf-8"))
            waiting += [(page.parent / target).resolve() for target in targets if "://" not in target]
    samples = [ROOT / name / "README.md" for name in ("benchmarks", "sample_meshes")]
    assert {*PAGES, *samples, ROOT / "CHANGELOG.md"} - reached == set()


def test_the_readme_lists_every_command_with_its_page():
    rows = re.findall(
        r"^\| \[`([\w-]+)`\]\(docs/([\w-]+)\.md\)", (ROOT / "README.md").read_text("utf-8"), re.M
    )
    assert [name for name, _ in rows] == list(COMMANDS)
    assert all(page in PAGES_OF.get(name, (name,)) for name, page in rows)


@pytest.mark.parametrize("name, count", [("shell-sim", 2), ("fluid-sim", 1)])
def test_a_simulator_takes_the_models_that_its_help_names(name, count, run):
    command = command_of(name)
    option = next(o for o in options_of(name) if o.name == "model")
    models = re.findall(r"(\w+)=(\w+)", option.get_help_record(click.Context(command))[1])
    assert len(models) == count
    for effect, model in models:
        line = "viscosity nu=1e-3" if effect == "viscosity" else effect
        material = () if name == "fluid-sim" else ("--material", "rubber")
        words = ("--effect", line, "--model", f"{effect}={model}", *material, "--dry-run")
        result = run(name, ROOT / "sample_meshes" / "sphere.ply", *words)
        assert result.exit_code == 0, result.stderr


def test_the_global_options_stand_among_those_of_pipelines():
    assert unnamed([o for o in main.params if isinstance(o, click.Option)], text_of("pipelines")) == []


def test_the_changelog_names_every_command():
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    assert [name for name in COMMANDS if f"`{name}`" not in text] == []


@pytest.mark.parametrize("name", ["shell-sim", "fluid-sim"])
def test_the_help_of_a_simulator_names_its_integrators_materials_and_flows(name):
    from ddgcli.models.fluid.initial import NAMED_FLOWS
    from ddgcli.models.fluid.scene import KIND as FLUID
    from ddgcli.models.shell.scene import KIND as SHELL
    from ddgcli.scenes.materials import MATERIALS

    command = command_of(name)
    text = command.get_help(click.Context(command, info_name=name))
    words = set(re.findall(r"[a-z][a-z0-9-]*[a-z0-9]", re.sub(r"-\n\s*", "-", text)))
    kind, others = (SHELL, MATERIALS) if name == "shell-sim" else (FLUID, NAMED_FLOWS)
    assert {*kind.integrators, *others} - words == set()
