"""The shells' completion: the scripts, and the answers that they get."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest

from deshake.cli.main import COMMANDS

RUN = "from deshake.cli.main import main; raise SystemExit(main())"


@pytest.fixture(scope="module")
def ask():
    """Run deshake as a shell does to complete a line, and return what it prints."""

    def run(instruction, **variables):
        done = subprocess.run(
            [sys.executable, "-c", RUN],
            env=os.environ | {"_DESHAKE_COMPLETE": instruction} | variables,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.stderr == ""
        assert done.returncode in {0, 1}  # 1 is click's word for a script that was printed
        return done.stdout

    return run


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_shell_has_its_script(ask, shell):
    if shell == "bash" and shutil.which("bash") is None:
        pytest.skip("click asks bash for its version")
    script = ask(f"{shell}_source")
    assert f"_DESHAKE_COMPLETE={shell}_complete" in script
    assert "deshake" in script


def test_commands_and_options_are_completed(ask):
    choices = ask("zsh_complete", COMP_WORDS="deshake ", COMP_CWORD="1").splitlines()
    assert set(COMMANDS) <= set(choices)
    assert COMMANDS["fix"].summary in choices
    choices = ask("zsh_complete", COMP_WORDS="deshake estimate-", COMP_CWORD="1").splitlines()
    assert [word for word in choices if word.startswith("est")] == [
        "estimate-blind",
        "estimate-pair",
    ]
    choices = ask("zsh_complete", COMP_WORDS="deshake fix --str", COMP_CWORD="2").splitlines()
    assert choices[1] == "--strength"
    choices = ask("fish_complete", COMP_WORDS="deshake deblur --m", COMP_CWORD="--m")
    assert {"plain,--method", "plain,--mask"} <= {
        line.split("\t")[0] for line in choices.splitlines()
    }


def test_values_of_choices_are_completed(ask):
    choices = ask("bash_complete", COMP_WORDS="deshake fix --quality ", COMP_CWORD="3")
    assert choices.split() == ["plain,fast", "plain,default", "plain,high"]


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_with_the_script(ask, tmp_path):
    program = tmp_path / "deshake"
    program.write_text(f"#!/bin/sh\nexec {sys.executable} -c '{RUN}'\n")
    program.chmod(0o755)
    (tmp_path / "script").write_text(ask("bash_source"))
    lines = (
        "source script",
        "complete -p deshake | grep -o -- '-F [^ ]*' | cut -c4- > name",
        "COMP_WORDS=(deshake fix --prev) COMP_CWORD=2",
        '$(cat name) deshake; echo "${COMPREPLY[@]}"',
    )
    done = subprocess.run(
        ["bash", "--norc", "-c", "\n".join(lines)],
        cwd=tmp_path,
        env=os.environ | {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split() == ["--preview"]


def test_presets_are_completed(ask, tmp_path):
    config = tmp_path / "deshake" / "config.toml"
    config.parent.mkdir()
    config.write_text("[preset.night]\n[preset.noon]\n[preset.day]\n", "utf-8")
    line = {"COMP_WORDS": "deshake fix --preset n", "COMP_CWORD": "3"}
    choices = ask("zsh_complete", **line, XDG_CONFIG_HOME=str(tmp_path)).splitlines()
    assert [word for word in choices if word.startswith("n")] == ["night", "noon"]
