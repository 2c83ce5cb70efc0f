from __future__ import annotations

import pytest


@pytest.fixture
def config(tmp_path):
    def write(text):
        path = tmp_path / "deshake.toml"
        path.write_text(text, "utf-8")
        return path

    return write


@pytest.fixture
def seen(trial):
    """Parameters and context that the trial command was run with."""
    found = {}

    def function(ctx):
        found.clear()
        found.update(ctx.params, threads=ctx.obj.threads, verbosity=ctx.obj.verbosity)

    trial(function)
    return found


def test_flag_then_environment_then_file_then_default(deshake, config, seen, monkeypatch):
    path = config("[trial]\nblur-size = 10\n")
    assert deshake("trial").code == 0
    assert seen["blur_size"] is None
    assert deshake("--config", path, "trial").code == 0
    assert seen["blur_size"] == 10
    monkeypatch.setenv("DESHAKE_TRIAL_BLUR_SIZE", "20")
    deshake("--config", path, "trial")
    assert seen["blur_size"] == 20
    deshake("--config", path, "trial", "--blur-size", "30")
    assert seen["blur_size"] == 30


def test_general_options(deshake, config, seen, monkeypatch):
    path = config("threads = 3\nverbose = 1\n")
    deshake("--config", path, "trial")
    assert (seen["threads"], seen["verbosity"]) == (3, 1)
    monkeypatch.setenv("DESHAKE_THREADS", "4")
    deshake("--config", path, "trial")
    assert seen["threads"] == 4
    deshake("--config", path, "--threads", "5", "trial")
    assert seen["threads"] == 5
    deshake("--config", path, "--threads", "5", "trial", "--threads", "6")
    assert seen["threads"] == 6


def test_what_is_typed_before_the_command_beats_its_environment(deshake, seen, monkeypatch):
    monkeypatch.setenv("DESHAKE_TRIAL_THREADS", "7")
    deshake("--threads", "5", "trial")
    assert seen["threads"] == 5


def test_the_file_may_be_named_by_the_environment(deshake, config, seen, monkeypatch):
    monkeypatch.setenv("DESHAKE_CONFIG", str(config('[trial]\ntransfer = "linear"\n')))
    deshake("trial")
    assert seen["transfer"] == "linear"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("speed = 1\n", "speed: no such option"),
        ("blur-size = 1\n", "blur-size: no such option"),
        ("config = 'x'\n", "config: no such option"),
        ("[trial]\nblur_size = 1\nangle = 2\n", "[trial] blur_size, angle: no such option"),
        ("[trial]\nthreads = 2\n", "[trial] threads: no such option"),
        ("[mend]\nx = 1\n", "[mend]: no such command"),
        ("[trial\n", "not TOML"),
        ("[trial]\ntransfer = 'log'\n", "'log' is not one of"),
        ("[trial]\nblur-size = 'wide'\n", "'wide' is not a valid float"),
    ],
)
def test_a_wrong_file_is_wrong_usage(deshake, config, seen, text, says):
    outcome = deshake("--config", config(text), "trial")
    assert outcome.code == 2
    assert says in outcome.err
    assert not seen


def test_a_missing_or_binary_file_is_wrong_usage(deshake, seen, tmp_path):
    assert "No such file" in deshake("--config", tmp_path / "none.toml", "trial").err
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    outcome = deshake("--config", tmp_path / "binary.toml", "trial")
    assert outcome.code == 2
    assert "not a text file" in outcome.err
    assert not seen
