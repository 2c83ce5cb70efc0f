from __future__ import annotations

import re

import click
import pytest

from deshake.cli.main import COMMANDS, cli
from deshake.cli.option_groups import GROUPS, GroupedCommand, option_groups
from deshake.stages.methods import METHODS


def titles(text):
    """Titles of the groups of a help, in their order."""
    return re.findall(r"^([A-Z][\w ]*):$", text, re.MULTILINE)


def group(text, title):
    """Text of one group of a help."""
    return re.search(rf"^{title}:\n(.*?)(?:^\S|\Z)", text, re.MULTILINE | re.DOTALL)[1]


@pytest.mark.parametrize("name", ["fix", "deblur"])
def test_the_help_comes_in_groups_and_every_day_comes_first(deshake, name):
    text = deshake(name, "--help").out
    assert titles(text) == list(GROUPS)
    assert "--output FILE|DIR" in group(text, "Every day")
    assert "--method METHOD" in group(text, "Restoring")
    assert "--jobs N" in group(text, "Many photos")
    assert "--transfer" in group(text, "Files")
    assert "--help" in group(text, "General")


def test_estimates_have_their_group(deshake):
    for name in ("estimate-blind", "estimate-pair"):
        text = deshake(name, "--help").out
        assert "--max-angle DEGREES" in group(text, "Estimating")
        assert "Restoring" not in titles(text)


@pytest.mark.parametrize("name", COMMANDS)
def test_each_option_is_in_the_help_once(deshake, name):
    command = cli.get_command(None, name)
    assert isinstance(command, GroupedCommand)
    text = deshake(name, "--help").out.partition("\nEvery day:\n")[2]
    shown = re.findall(r"^  (?:-\w, )?(--[\w-]+)", text, re.MULTILINE)
    options = command.get_params(click.Context(command, help_option_names=["-h", "--help"]))
    names = [max(each.opts, key=len) for each in options if isinstance(each, click.Option)]
    assert sorted(shown) == sorted(names)


@pytest.mark.parametrize("name", COMMANDS)
def test_each_option_has_a_group(deshake, name):
    assert "More options" not in titles(deshake(name, "--help").out)


def test_an_option_without_a_group_comes_before_the_general_ones():
    command = GroupedCommand(
        "x",
        params=[
            click.Option(["-v", "--verbose"]),
            click.Option(["--sparkle"]),
            click.Option(["--secret"], hidden=True),
            click.Option(["--output"]),
        ],
    )
    groups = option_groups(command, click.Context(command))
    names = {title: [option.opts[-1] for option in each] for title, each in groups.items()}
    assert list(names.items()) == [
        ("Every day", ["--output"]),
        ("More options", ["--sparkle"]),
        ("General", ["--verbose", "--help"]),
    ]


def test_groups_of_a_command_alone_take_their_options():
    command = GroupedCommand(
        "x",
        params=[click.Option([f"--{name}"]) for name in ("kernel", "output", "mask", "quality")],
        groups={"Stars": ["--mask", "--kernel"], "Every day": ["--quality"]},
    )
    groups = option_groups(command, click.Context(command))
    names = {title: [option.opts[-1] for option in each] for title, each in groups.items()}
    assert list(names.items()) == [
        ("Every day", ["--quality", "--output"]),
        ("Stars", ["--mask", "--kernel"]),
        ("General", ["--help"]),
    ]


def test_descriptions_begin_in_one_column(deshake):
    lines = deshake("fix", "--help").out.splitlines()
    columns = {
        line.index(match[1]) for line in lines if (match := re.match(r"  -.*?  +(\w.*)", line))
    }
    assert len(columns) == 1


def test_the_help_names_every_method(deshake):
    text = group(deshake("fix", "--help").out, "Restoring")
    words = re.findall(r"[\w-]+", text)
    assert set(METHODS) <= set(words)


def test_metavars_name_the_unit_or_the_kind(deshake):
    text = deshake("fix", "--help").out
    for words in ("--blur-size PIXELS", "--strength SHARE", "--noisy PHOTO", "--focal-px PIXELS"):
        assert words in text
    assert "<=" not in text
    assert "--noise SHARE" in deshake("simulate", "--help").out
    assert "--size PIXELS" in deshake("render-kernel", "--help").out
