from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from deshake.cli import config_options


@pytest.fixture
def own(tmp_path, monkeypatch):
    """Write the user's own file."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "settings"))

    def write(text):
        path = tmp_path / "settings" / "deshake" / "config.toml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
        return path

    return write


def test_the_users_own_file_is_read_and_v_says_so(deshake, own, seen):
    path = own("threads = 3\n[trial]\nblur-size = 10\n")
    assert deshake("trial").err == ""
    assert (seen["blur_size"], seen["threads"]) == (10, 3)
    assert deshake("trial", "-v").err == f"options are read from {path}\n"


def test_without_that_file_nothing_is_reported(deshake, own, seen):  # noqa: ARG001
    assert deshake("trial", "-v").err == ""
    assert seen["blur_size"] is None


def test_another_file_is_read_instead(deshake, own, seen, tmp_path):
    own("threads = 3\n[trial]\nblur-size = 10\n")
    other = tmp_path / "other.toml"
    other.write_text("[trial]\ntransfer = 'linear'\n", "utf-8")
    outcome = deshake("--config", other, "trial", "-v")
    assert outcome.err == f"options are read from {other}\n"
    assert (seen["transfer"], seen["blur_size"], seen["threads"]) == ("linear", None, None)


def test_no_file_is_read_where_none_is_wanted(deshake, own, seen, tmp_path, monkeypatch):
    own("[trial]\nblur-size = 10\n")
    assert deshake("--no-config", "trial", "-v").err == ""
    assert seen["blur_size"] is None
    monkeypatch.setenv("DESHAKE_NO_CONFIG", "1")
    deshake("trial")
    assert seen["blur_size"] is None
    other = tmp_path / "other.toml"
    other.write_text("[trial]\nblur-size = 20\n", "utf-8")
    deshake("--config", other, "trial")  # the command line has priority
    assert seen["blur_size"] == 20
    monkeypatch.delenv("DESHAKE_NO_CONFIG")
    monkeypatch.setenv("DESHAKE_CONFIG", str(other))
    deshake("trial")
    assert seen["blur_size"] == 20
    deshake("--no-config", "trial")
    assert seen["blur_size"] is None


@pytest.mark.parametrize(
    "typed", [("--config", "a.toml", "--no-config"), ("--no-config", "--config", "a.toml")]
)
def test_a_file_and_none_are_wrong_usage(deshake, seen, tmp_path, monkeypatch, typed):
    monkeypatch.chdir(tmp_path)
    Path("a.toml").touch()
    outcome = deshake(*typed, "trial")
    assert outcome.code == 2
    assert "--config and --no-config cannot both be given" in outcome.err
    assert not seen


@pytest.mark.parametrize("text", ["threads = ", "threads = 0", "[fix]\nspeed = 1", "speed = 1"])
def test_a_malformed_file_of_the_user_is_named(deshake, own, seen, text):
    path = own(text)
    outcome = deshake("trial")
    assert outcome.code == 2
    error, hint = outcome.err.splitlines()
    assert error.startswith(f"error: {path}: ")
    assert hint == "hint: mend the file, or run without it: deshake --no-config"
    assert not seen
    assert deshake("--no-config", "trial").code == 0
    assert deshake("--version").code == 0
    assert deshake("--help").code == 0


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may read everything")
def test_a_file_of_the_user_that_cannot_be_read_is_named(deshake, own, seen):
    path = own("threads = 2")
    path.chmod(0)
    outcome = deshake("trial")
    assert (outcome.code, bool(seen)) == (2, False)
    assert f"error: {path}: permission denied" in outcome.err


def test_a_folder_in_its_place_is_named(deshake, own, seen):
    path = own("")
    path.unlink()
    path.mkdir()
    outcome = deshake("trial")
    assert (outcome.code, bool(seen)) == (2, False)
    assert outcome.err.startswith(f"error: {path}: ")


@pytest.mark.parametrize(
    ("platform", "environment", "place"),
    [
        ("linux", {}, "/home/me/.config/deshake/config.toml"),
        ("darwin", {}, "/home/me/.config/deshake/config.toml"),
        ("win32", {"APPDATA": "/roaming"}, "/roaming/deshake/config.toml"),
        ("linux", {"APPDATA": "/roaming"}, "/home/me/.config/deshake/config.toml"),
        ("darwin", {"XDG_CONFIG_HOME": "/etc/me"}, "/etc/me/deshake/config.toml"),
        ("linux", {"XDG_CONFIG_HOME": "relative"}, "/home/me/.config/deshake/config.toml"),
        ("linux", {"XDG_CONFIG_HOME": ""}, "/home/me/.config/deshake/config.toml"),
    ],
)
@pytest.mark.skipif(os.name == "nt", reason="paths of POSIX")
def test_each_system_has_its_place(monkeypatch, platform, environment, place):
    monkeypatch.setenv("HOME", "/home/me")
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.setattr(sys, "platform", platform)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert config_options.user_config() == Path(place)


PRESETS = """
threads = 2
verbose = 1
[trial]
transfer = "linear"
blur-size = 10
[preset.night]
threads = 4
blur-size = 20
[preset.day.trial]
transfer = "srgb"
"""


@pytest.mark.parametrize("typed", [("--preset", "night", "trial"), ("trial", "--preset", "night")])
def test_a_preset_comes_before_the_rest_of_the_file(deshake, own, seen, typed):
    own(PRESETS)
    assert deshake(*typed).code == 0
    assert (seen["blur_size"], seen["threads"], seen["verbosity"]) == (20, 4, 1)
    assert seen["transfer"] == "linear"


def test_what_is_typed_and_the_environment_come_before_a_preset(deshake, own, seen, monkeypatch):
    own(PRESETS)
    deshake("--threads", 7, "trial", "--preset", "night", "--blur-size", 30)
    assert (seen["blur_size"], seen["threads"]) == (30, 7)
    monkeypatch.setenv("DESHAKE_THREADS", "5")
    monkeypatch.setenv("DESHAKE_TRIAL_BLUR_SIZE", "6")
    deshake("trial", "--preset", "night")
    assert (seen["blur_size"], seen["threads"]) == (6, 5)


def test_the_preset_after_the_command_replaces_the_one_before(deshake, own, seen, monkeypatch):
    own(PRESETS)
    monkeypatch.setenv("DESHAKE_PRESET", "night")
    deshake("trial")
    assert seen["blur_size"] == 20
    deshake("--preset", "night", "trial", "--preset", "day")
    assert (seen["blur_size"], seen["transfer"]) == (10, "srgb")


def test_v_names_the_preset(deshake, own, seen):  # noqa: ARG001
    path = own(PRESETS)
    outcome = deshake("--preset", "night", "trial")
    assert outcome.err == f"options are read from {path}, preset night\n"


@pytest.mark.parametrize("typed", [("--preset", "nite", "trial"), ("trial", "--preset", "nite")])
def test_an_unknown_preset_is_wrong_usage_that_lists_the_presets(deshake, own, seen, typed):
    path = own(PRESETS)
    outcome = deshake(*typed)
    assert outcome.code == 2
    assert f"no preset 'nite' in {path}, which has day, night" in outcome.err
    own("threads = 2")
    assert f"there is no [preset.nite] in {path}" in deshake(*typed).err
    path.unlink()
    assert "there is no configuration file" in deshake(*typed).err
    assert not seen


def test_a_preset_changes_what_a_real_command_does(deshake, own, shaken, pan, tmp_path):
    own("[preset.soft]\nstrength = '0%'\nno-provenance = true\n")
    photo = shaken("a.png")
    deblur = ("deblur", photo, pan, "--method", "rl", "--iterations", 2)
    assert deshake(*deblur, "-o", tmp_path / "full.png").code == 0
    assert deshake(*deblur, "-o", tmp_path / "soft.png", "--preset", "soft").code == 0
    typed = ("-o", tmp_path / "typed.png", "--strength", "0", "--no-provenance")
    assert deshake("--no-config", *deblur, *typed).code == 0
    soft = (tmp_path / "soft.png").read_bytes()
    assert soft == (tmp_path / "typed.png").read_bytes()
    assert soft != (tmp_path / "full.png").read_bytes()


@pytest.mark.parametrize("option", [("--config", "a.toml"), ("--no-config",)])
def test_what_comes_before_the_command_is_explained_behind_it(deshake, option):
    outcome = deshake("fix", "a.jpg", *option)
    assert outcome.code == 2
    file = " FILE" if len(option) > 1 else ""
    assert f"hint: it comes first, as in: deshake {option[0]}{file} fix\n" in outcome.err
