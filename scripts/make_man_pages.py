"""Write man/: one page for deshake and one for each of its commands.

``--check`` compares instead, and fails if a page is missing, stale or left over.
"""

from __future__ import annotations

import argparse
import copy
import sys
from pathlib import Path

import click
from click_man.core import generate_man_page
from click_man.man import ManPage

from deshake.cli.main import COMMANDS, cli
from deshake.cli.option_groups import option_groups
from deshake.version import __version__

MAN = Path(__file__).resolve().parent.parent / "man"
# Pages bear no day: the same commands give the same bytes.
DATE = " "
OPTIONS = ".SH OPTIONS\n"


def man_pages() -> dict[str, str]:
    """Text of every page by its file name."""
    # click-man lists the commands that a group holds, and the lazy group holds none; it would
    # cut long summaries short, unless they are given as such.
    commands = {}
    for name, entry in COMMANDS.items():
        commands[name] = copy.copy(cli.get_command(click.Context(cli), name))
        commands[name].short_help = entry.summary
    summary = (cli.help or "").splitlines()[0]
    group = click.Group(
        "deshake", commands=commands, params=cli.params, help=cli.help, short_help=summary
    )
    top = click.Context(group, info_name="deshake", **cli.context_settings)
    pages = {"deshake.1": generate_man_page(top, version=__version__, date=DATE)}
    for name, command in commands.items():
        context = click.Context(command, info_name=name, parent=top)
        page = generate_man_page(context, version=__version__, date=DATE)
        before, _, _ = page.partition(OPTIONS)
        pages[f"deshake-{name}.1"] = before + OPTIONS + _grouped_options(context)
    return pages


def _grouped_options(context: click.Context) -> str:
    """Text of a command's options under the titles of their groups, as its help shows them."""
    text = ""
    for title, options in option_groups(context.command, context).items():
        page = ManPage(title)
        page.options = [option.get_help_record(context) for option in options]
        text += f".SS {title}\n" + str(page).partition(OPTIONS)[2]
    return text


def main() -> int:
    """Write the pages, or compare them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    check = parser.parse_args().check
    pages = man_pages()
    MAN.mkdir(exist_ok=True)
    stale = [path for path in MAN.glob("*.1") if path.name not in pages]
    for name, text in pages.items():
        path = MAN / name
        if not path.exists() or path.read_text("utf-8") != text:
            stale.append(path)
    if check:
        for path in stale:
            print(f"{path.name}: differs from the command's help; run: make man", file=sys.stderr)
        return 1 if stale else 0
    for path in stale:
        if path.name in pages:
            path.write_text(pages[path.name], "utf-8")
        else:
            path.unlink()
        print(path.name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
