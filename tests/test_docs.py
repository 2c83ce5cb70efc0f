"""What the documents say is what the commands, the scripts and the library do."""

from __future__ import annotations

import argparse
import importlib.util
import os
import pkgutil
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

import click
import pytest
from PIL import Image
from skimage import data

import deshake
from deshake.cli.config import Config
from deshake.cli.context import Context
from deshake.cli.main import COMMANDS, cli, main
from deshake.cli.messages import log_to_stderr

if TYPE_CHECKING:
    from collections.abc import Sequence

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").glob("*.md"))
DOCUMENTS = [
    *(ROOT / name for name in ("README.md", "DESIGN.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *PAGES,
]
TEXTS = {path.relative_to(ROOT).as_posix(): path.read_text("utf-8") for path in DOCUMENTS}
README_LINES = 200
DESIGN_LINES = 100
PICTURE_BYTES = 150_000

NOT_PLAIN = r"(?i)\b(?:anew|told by|is told|gone by|gone on with)\b"


def blocks(language: str, text: str) -> list[str]:
    """Code blocks of a document in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def shell_examples(text: str) -> list[str]:
    """Runs of deshake in the shell blocks of a document, each as one line."""
    lines = "".join(blocks("sh", text)).replace("\\\n", " ").splitlines()
    return [
        run.strip()
        for line in lines
        for run in line.split("|")
        if run.split("#")[0].strip().startswith("deshake ")
    ]


def script_runs(text: str) -> list[str]:
    """Runs of our programs that a document names, in shell blocks, tables and sentences."""
    programs = r"python ((?:scripts/|-m tests\.)[^`|\n#]+)"
    return [run.strip() for run in re.findall(programs, text)]


def anchors(text: str) -> set[str]:
    """Anchors of the headings of a document, as GitHub makes them."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def dead_links(path: Path, text: str) -> list[str]:
    """Links of a document to files or headings that do not exist."""
    dead = []
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if link.startswith("https://"):
            continue
        name, _, anchor = link.partition("#")
        target = path.parent / name if name else path
        if not target.exists() or (anchor and anchor not in anchors(target.read_text("utf-8"))):
            dead.append(link)
    return dead


def missing_files(text: str) -> list[str]:
    """Files of the project that a document names, but that do not exist."""
    named = re.findall(r"(?<![\w/])((?:deshake|docs|scripts|tests|man)/[\w./-]*\w/?)", text)
    return [name for name in named if not (ROOT / name).exists()]


EXAMPLES = [(name, run) for name, text in TEXTS.items() for run in shell_examples(text)]
RUNS = [(name, run) for name, text in TEXTS.items() for run in script_runs(text)]
PYTHON = [(name, code) for name, text in TEXTS.items() for code in blocks("python", text)]


def words(example: str) -> list[str]:
    """Arguments of one run of deshake, without its comment and redirections."""
    program, *args = shlex.split(re.split(r"\s2?>|\s<", example)[0], comments=True)
    assert program == "deshake"
    return args


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
def test_the_readme_names_every_command_and_a_page_shows_it(name: str) -> None:
    assert f"| `{name}` |" in TEXTS["README.md"]
    assert any(words(run)[:1] == [name] for page, run in EXAMPLES if page == "docs/commands.md")


def test_examples_are_right_usage() -> None:
    wrong = {}
    for document, example in EXAMPLES:
        try:
            check_usage(example)
        except click.UsageError as error:
            wrong[document, example] = error.message
    assert wrong == {}


def check_usage(example: str) -> None:
    """Raise UsageError if an example is wrong usage."""
    with log_to_stderr():  # which -q and -v change
        check_words(*words(example))


def check_words(name: str, *args: str) -> None:
    """Raise UsageError if the words of a run are wrong usage."""
    if name.startswith("-"):
        cli.make_context("deshake", [name, *args], resilient_parsing=True)
        return
    config = Config(presets={"night": {}, "quick": {}})
    with click.Context(cli, info_name="deshake", obj=Context(config=config)) as parent:
        command = cli.get_command(parent, name)
        assert command is not None
        with command.make_context(name, list(args), parent=parent):
            pass


def test_a_wrong_example_would_be_seen() -> None:
    text = "```sh\ndeshake render-kernel k.npz \\\n    --colour | deshake fix -o x  # why\n```\n"
    one, two = shell_examples(text)
    assert words(two) == ["fix", "-o", "x"]
    with pytest.raises(click.UsageError, match="--colour"):
        check_usage(one)


class ParsedError(Exception):
    """The command line of a script was parsed without fault."""


def parse(run: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a script until its command line is parsed.

    Raises
    ------
    ParsedError
        If it is right usage.
    SystemExit
        If it is wrong usage, with code 2; with code 0 if it only asks for help.

    """
    name, *args = shlex.split(run, comments=True)
    parse_args = argparse.ArgumentParser.parse_args

    def parse_only(parser: argparse.ArgumentParser, args: Sequence[str] | None = None) -> None:
        parse_args(parser, args)
        raise ParsedError

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse_only)
    monkeypatch.setattr(sys, "argv", [name, *args[name == "-m" :]])
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    if name == "-m":
        module = args[0].removeprefix("tests.")
        monkeypatch.delitem(sys.modules, module, raising=False)  # another test may have imported it
        runpy.run_module(module, run_name="__main__")
    else:
        runpy.run_path(str(ROOT / name), run_name="__main__")


@pytest.mark.parametrize("run", sorted({run for _, run in RUNS}))
def test_scripts_in_documents_are_right_usage(
    run: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    if "--help" in run:
        with pytest.raises(SystemExit, match="0"):
            parse(run, monkeypatch)
    else:
        with pytest.raises(ParsedError):
            parse(run, monkeypatch)


def test_a_wrong_run_of_a_script_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "by `python scripts/figure5.py --n 1`\n```sh\npython scripts/figure8.py  # why\n```"
    usage, missing = script_runs(text)
    with pytest.raises(SystemExit, match="2"):
        parse(usage, monkeypatch)
    with pytest.raises(FileNotFoundError):
        parse(missing, monkeypatch)


def test_every_table_and_figure_is_documented() -> None:
    scripts = ROOT / "scripts"
    modules = [path.stem for path in (scripts / "bench" / "tables").glob("[a-z]*.py")]
    tables = {f"scripts/bench.py {name.replace('_', '-')}" for name in modules}
    figures = {f"scripts/{path.name}" for path in scripts.glob("figure*.py")}
    assert tables
    assert figures
    assert tables <= {" ".join(run.split()[:2]) for _, run in RUNS}
    assert figures <= {run.split()[0] for _, run in RUNS}


@pytest.fixture
def folder_of_examples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that the Python examples read, in the working directory."""
    monkeypatch.chdir(tmp_path)
    Image.fromarray(data.coffee()).resize((120, 84)).save("before.jpg", quality=95)
    shake = ["--kernel", "photo.kernel.npz", "--blur-size", "4", "--focal-35mm", "28"]
    assert main(["simulate", "before.jpg", "-o", "photo.jpg", *shake]) == 0
    Path("notes.txt").write_text("no photo", "utf-8")


@pytest.mark.parametrize(("document", "code"), PYTHON)
@pytest.mark.usefixtures("folder_of_examples")
def test_python_examples_run(document: str, code: str) -> None:
    exec(compile(code, document, "exec"), {"__name__": "example"})  # noqa: S102 - our own words


def test_python_examples_are_seen() -> None:
    assert {name for name, _ in PYTHON} >= {"README.md", "docs/python.md", "docs/kernel-files.md"}


def test_documents_name_the_exit_codes() -> None:
    for code in ("0", "1", "2", "130", "143"):
        assert re.search(rf"^\| `{code}` \|", TEXTS["docs/commands.md"], re.MULTILINE), code


def test_links_lead_somewhere() -> None:
    dead = {name: links for name, text in TEXTS.items() if (links := dead_links(ROOT / name, text))}
    assert dead == {}


def test_files_named_in_documents_exist() -> None:
    missing = {name: files for name, text in TEXTS.items() if (files := missing_files(text))}
    assert missing == {}


def test_python_names_in_sentences_exist() -> None:
    for name in re.findall(r"`(deshake(?:\.\w+)+)", "\n".join(TEXTS.values())):
        assert pkgutil.resolve_name(name) is not None


def test_a_dead_link_would_be_seen() -> None:
    text = "# One, two\n\n[a](#one-two) [b](#three) [c](LICENSE) [d](LICENCE) `scripts/none.py`"
    assert anchors(text) == {"one-two"}
    readme = ROOT / "README.md"
    assert dead_links(readme, text.replace("#one-two", "#install")) == ["#three", "LICENCE"]
    assert missing_files(text) == ["scripts/none.py"]


def test_the_readme_leads_to_every_page() -> None:
    linked = set(re.findall(r"\]\(([\w./-]+)\)", TEXTS["README.md"]))
    assert {name for name in TEXTS if name != "README.md"} <= linked


def test_readme_and_design_are_short() -> None:
    assert len(TEXTS["README.md"].splitlines()) <= README_LINES
    assert len(TEXTS["DESIGN.md"].splitlines()) <= DESIGN_LINES


def test_pictures_of_documents_are_small() -> None:
    pictures = [*(ROOT / "docs").glob("*.jpg"), *(ROOT / "docs").glob("*.png")]
    assert pictures
    shown = " ".join(TEXTS.values())
    for path in pictures:
        assert path.stat().st_size <= PICTURE_BYTES, path.name
        assert path.name in shown, f"{path.name} is shown nowhere"


def test_documents_use_plain_words() -> None:
    used = {name: words for name, text in TEXTS.items() if (words := re.findall(NOT_PLAIN, text))}
    assert used == {}


def test_changelog_has_this_version() -> None:
    assert f"## {deshake.__version__}" in TEXTS["CHANGELOG.md"]
