"""What the documents say is what the commands do."""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import tomllib
from pathlib import Path

import click
import pytest

import deshake
from deshake.cli.main import COMMANDS, cli

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text("utf-8")


def shell_examples(text: str) -> list[str]:
    """Runs of deshake in the shell blocks of a document, each as one line."""
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    return [
        run.strip()
        for line in lines
        for run in line.split("|")
        if run.split("#")[0].strip().startswith("deshake ")
    ]


EXAMPLES = shell_examples(README)


def words(example: str) -> list[str]:
    """Arguments of one run of deshake, without its comment and redirections."""
    found = shlex.split(re.split(r"\s2?>|\s<", example)[0], comments=True)
    assert found[0] == "deshake"
    return found[1:]


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    path = ROOT / "scripts" / "make_man_pages.py"
    spec = importlib.util.spec_from_file_location("make_man_pages", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.man_pages()


def test_man_pages_are_those_of_the_commands(pages: dict[str, str]) -> None:
    assert set(pages) == {"deshake.1", *(f"deshake-{name}.1" for name in COMMANDS)}
    kept = {path.name: path.read_text("utf-8") for path in (ROOT / "man").glob("*.1")}
    assert kept == pages, "run: make man"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_is_in_the_man_page(pages: dict[str, str], name: str) -> None:
    page = pages[f"deshake-{name}.1"].replace(r"\-", "-")
    for param in cli.get_command(None, name).params:
        if isinstance(param, click.Option):
            assert all(option in page for option in param.opts), param.opts


@pytest.mark.skipif(shutil.which("man") is None, reason="needs man")
def test_man_finds_the_pages_of_an_installation_and_can_set_them(tmp_path: Path) -> None:
    version = subprocess.run(["man", "--version"], capture_output=True, text=True, check=False)
    if not version.stdout.startswith("man 2"):  # small images have a man that says it is not there
        pytest.skip("needs man-db")
    shared = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    shared = shared["tool"]["hatch"]["build"]["targets"]["wheel"]["shared-data"]
    shutil.copytree(ROOT / "man", tmp_path / shared["man"])
    (tmp_path / "bin").mkdir()
    env = os.environ | {"PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}", "LC_ALL": "C.UTF-8"}
    env.pop("MANPATH", None)
    for name in ("deshake", *(f"deshake-{name}" for name in COMMANDS)):
        where = subprocess.run(
            ["man", "-w", name], env=env, capture_output=True, text=True, check=True
        )
        assert where.stdout == f"{tmp_path}/share/man/man1/{name}.1\n"
        page = subprocess.run(
            ["man", "--warnings", name], env=env, capture_output=True, text=True, check=True
        )
        assert page.stderr == ""
        assert "SYNOPSIS" in page.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_readme_shows_every_command(name: str) -> None:
    assert any(words(example)[:1] == [name] for example in EXAMPLES)


@pytest.mark.parametrize("example", EXAMPLES)
def test_readme_examples_are_right_usage(example: str) -> None:
    name, *args = words(example)
    if name.startswith("-"):
        cli.make_context("deshake", [name, *args], resilient_parsing=True)
        return
    with click.Context(cli, info_name="deshake") as parent:
        command = cli.get_command(parent, name)
        assert command is not None
        with command.make_context(name, args, parent=parent):
            pass


def test_a_wrong_example_would_be_seen() -> None:
    text = "```sh\ndeshake render-kernel k.npz \\\n    --colour | deshake fix -o x  # why\n```\n"
    one, two = shell_examples(text)
    assert words(two) == ["fix", "-o", "x"]
    with pytest.raises(click.UsageError, match="--colour"):
        test_readme_examples_are_right_usage(one)


def test_readme_names_the_exit_codes() -> None:
    for code in ("0", "1", "2", "130"):
        assert re.search(rf"^\| `{code}` \|", README, re.MULTILINE), code


@pytest.mark.parametrize("document", ["README.md", "DESIGN.md", "CONTRIBUTING.md"])
def test_files_named_in_documents_exist(document: str) -> None:
    text = (ROOT / document).read_text("utf-8")
    named = re.findall(r"\]\(([\w./-]+)\)", text)
    named += re.findall(r"`((?:deshake|docs|scripts|tests|man)/[\w./-]+)`", text)
    missing = [name for name in named if not (ROOT / name).exists()]
    assert not missing


def test_changelog_has_this_version() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text("utf-8")
    assert f"## {deshake.__version__}" in changelog
