from __future__ import annotations

from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from deshake.cli.restoration_options import noisy_option, restoration, restoration_options
from deshake.stages.methods import RestorationOptions


@pytest.fixture
def parse():
    """Return what the options give, or what is wrong."""

    def run(*args):
        @click.command()
        @noisy_option
        @restoration_options
        def command(**choices):
            chosen.append(restoration(**choices))

        chosen = []
        result = CliRunner().invoke(command, args)
        return chosen[0] if result.exit_code == 0 else result.output

    return run


def test_the_default_depends_on_the_noisy_photo(parse):
    assert parse() == RestorationOptions()
    assert parse("--noisy", "n.png") == RestorationOptions("fusion")


def test_choices_are_passed_on(parse):
    assert parse("--quality", "high", "--iterations", "3") == RestorationOptions(
        "sparse", "high", 3
    )
    args = ("--noisy", "n.png", "--method", "residual", "--iterations", "7")
    assert parse(*args) == RestorationOptions("residual", "default", 7)
    assert parse("--noisy", "n.png", "--quality", "fast") == RestorationOptions("fusion", "fast")


@pytest.mark.parametrize("method", ["fusion", "residual"])
def test_methods_for_pairs_need_a_noisy_photo(method):
    with pytest.raises(click.UsageError, match=f"--method {method} needs --noisy"):
        restoration(None, method=method)


@pytest.mark.parametrize("method", ["sparse", "rl", "wiener"])
def test_methods_for_one_photo_take_no_noisy_one(method):
    with pytest.raises(click.UsageError, match=f"does not go with --method {method}"):
        restoration(Path("n.png"), method=method)


@pytest.mark.parametrize("method", ["rl", "residual", "wiener"])
def test_other_methods_have_one_quality(parse, method):
    text = parse("--method", method, "--quality", "high")
    assert f"--quality does not go with --method {method}" in text


def test_the_help_shows_both_defaults():
    command = click.Command("c", params=restoration_options(lambda: None).__click_params__)
    text = " ".join(CliRunner().invoke(command, ["--help"]).output.split())
    assert "[default: sparse; with --noisy, fusion]" in text
    assert "--iterations N" in text
