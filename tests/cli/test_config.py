from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from deshake.cli import main


@pytest.fixture
def config(tmp_path):
    def write(text):
        path = tmp_path / "deshake.toml"
        path.write_text(text, "utf-8")
        return path

    return write


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


@pytest.fixture
def real(deshake, monkeypatch):
    """Parameters that a real command gets, its defaults and its environment as in a real run."""

    def parse(*args, config=None):
        parsed = {}
        [command] = [main.cli.get_command(None, arg) for arg in args if arg in main.COMMANDS]
        monkeypatch.setattr(command, "invoke", lambda ctx: parsed.update(ctx.params))
        words = () if config is None else ("--config", config)
        outcome = deshake(*words, *args)
        assert outcome.code == 0, outcome.err
        return parsed

    return parse


@pytest.mark.parametrize(
    ("option", "values"),
    [
        ("strength", (0.25, 0.5, 0.75, 1.0)),
        ("estimator", ("variational", "edges", "variational", "edges")),
        ("region", ((1, 2, 3, 4), (5, 6, 7, 8), (9, 10, 11, 12), None)),
        ("mask", (Path("a.png"), Path("b.png"), Path("c.png"), None)),
        ("quality", ("fast", "high", "fast", "default")),
    ],
)
def test_every_kind_of_option_has_its_order(real, config, monkeypatch, option, values):
    def words(value):
        return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)

    typed, set_, filed, default = values
    assert real("fix", "a.jpg")[option] == default
    content = filed if isinstance(filed, float) else f'"{words(filed)}"'
    path = config(f"[fix]\n{option} = {content}\n")
    assert real("fix", "a.jpg", config=path)[option] == filed
    monkeypatch.setenv(f"DESHAKE_FIX_{option.upper()}", words(set_))
    assert real("fix", "a.jpg", config=path)[option] == set_
    assert real("fix", "a.jpg", f"--{option}", words(typed), config=path)[option] == typed


@pytest.mark.parametrize("option", ["preview", "uniform", "linear"])
def test_flags_are_set_by_file_and_environment(real, config, monkeypatch, option):
    assert real("fix", "a.jpg")[option] is False
    on, off = (config(f"[fix]\n{option} = true\n"), None)
    assert real("fix", "a.jpg", config=on)[option] is True
    monkeypatch.setenv(f"DESHAKE_FIX_{option.upper()}", "0")
    assert real("fix", "a.jpg", config=on)[option] is False
    monkeypatch.setenv(f"DESHAKE_FIX_{option.upper()}", "1")
    assert real("fix", "a.jpg", config=off)[option] is True
    assert real("fix", "a.jpg", f"--{option}", config=off)[option] is True


def test_a_list_in_the_file_is_a_list(real, deshake, config):
    assert real("fix", "a.jpg", config=config("[fix]\nregion = [1, 2, 3, 4]\n"))["region"] == (
        1,
        2,
        3,
        4,
    )
    outcome = deshake("--config", config("[fix]\nregion = [1, 2, 3]\n"), "fix", "a.jpg")
    assert outcome.code == 2
    assert "is not four whole numbers" in outcome.err


@pytest.mark.parametrize("text", ["maybe", "2"])
def test_a_flag_that_is_neither_on_nor_off_is_wrong_usage(deshake, monkeypatch, text):
    monkeypatch.setenv("DESHAKE_FIX_PREVIEW", text)
    outcome = deshake("fix", "a.jpg")
    assert outcome.code == 2
    assert "is not a valid boolean" in outcome.err


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
    assert "none.toml: no such file" in deshake("--config", tmp_path / "none.toml", "trial").err
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    outcome = deshake("--config", tmp_path / "binary.toml", "trial")
    assert outcome.code == 2
    assert "not a text file" in outcome.err
    assert not seen


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("threads = [1, 2]", "threads = [1, 2]: is not a whole number"),
        ("threads = 1.5", "threads = 1.5: is not a whole number"),
        ("threads = true", "threads = true: is not a whole number"),
        ("threads = 2020-01-01", "threads = 2020-01-01: is not a whole number"),
        ("verbose = '2'", "verbose = 2: is not a whole number"),
        ("progress = 1", "progress = 1: is not true or false"),
        ("threads = 0", "threads = 0: '0' is not a whole number from 1 to 1024"),
        ("[fix]\nmask = 3", "[fix] mask = 3: is not a text in quotes"),
        ("[fix]\nmask = ['a']", "[fix] mask = ['a']: is not a text in quotes"),
        ("[fix]\nmethod = false", "[fix] method = false: is not a text in quotes"),
        ("[fix]\ntransfer = 07:32:00", "[fix] transfer = 07:32:00: is not a text in quotes"),
        ("[fix]\nuniform = 'yes'", "[fix] uniform = yes: is not true or false"),
        ("[fix]\nstrength = true", "[fix] strength = true: is not a number"),
        ("[fix]\nblur-size = [5]", "[fix] blur-size = [5]: is not a number"),
        ("[fix]\nblur-size = nan", "nan is not a number above 0"),
        ("[fix]\nregion = [0, 0, 5.5, 5]", "region = [0, 0, 5.5, 5]: is not four whole numbers"),
        ("[fix]\nregion = [true, 0, 5, 5]", "is not four whole numbers"),
        ("[fix]\nregion = [0, 0, 99999999999999999999, 5]", "it reaches beyond any photo"),
        ("[fix]\nregion = '0,0,99999999999999999999,5'", "it reaches beyond any photo"),
        ("[fix]\nmemory = 4", "[fix] memory = 4: is not a text in quotes"),
        (f"threads = {'9' * 5000}", "a number in it has too many digits"),
        (f"threads = {'9' * 4000}", "is not a whole number from 1 to 1024"),
        (f"threads = {'[' * 3000}{']' * 3000}", "too many brackets within brackets"),
        (f"[fix]\nmask = [{'1, ' * 100}]", "1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, ...:"),
        ("[fix.mask]\na = 1", "[fix] mask = {'a': 1}: is not a text in quotes"),
        ("fix = 3", "fix is a command: its options stand in a table, [fix]"),
        ("[[fix]]\nmask = 'a'", "fix is a command: its options stand in a table"),
    ],
)
def test_a_value_of_the_wrong_kind_is_wrong_usage(deshake, config, tmp_path, text, what):
    path = config(text)
    outcome = deshake("--config", path, "fix", tmp_path / "gone.jpg")
    assert outcome.code == 2
    assert what in outcome.err
    assert "bug" not in outcome.err
    assert len(outcome.err.splitlines()) <= 2


@pytest.mark.parametrize(
    "text",
    [
        "threads = 2\nverbose = 1\nprogress = false",
        "threads = '2'",
        "[fix]\nstrength = 1\nmethod = 'rl'\niterations = 5\nuniform = true\nmemory = '4G'",
        "[fix]\nregion = [0, 0, 5, 5]\nblur-size = 3.5",
        "[fix]\nregion = '0,0,5,5'\nblur-size = '3'",
    ],
)
def test_values_of_the_right_kind_are_taken(deshake, config, tmp_path, text):
    outcome = deshake("--config", config(text), "fix", tmp_path / "gone.jpg")
    assert outcome.code == 1
    assert "gone.jpg: no such file" in outcome.err


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("preset = 'night'", "a preset is a table, such as [preset.night]"),
        ("[preset]\nnight = 1", "a preset is a table, such as [preset.night]"),
        ("[preset.night]\nspeed = 1", "[preset.night] speed: no such option; there are "),
        ("[preset.night.mend]\nx = 1", "[preset.night.mend]: no such command; there are fix"),
        ("[preset.night.fix]\nangle = 1", "[preset.night.fix] angle: no such option"),
        ("[preset.night]\nthreads = 'two'", "[preset.night] threads = two: 'two' is not a whole"),
        ("[preset.night]\nstrength = 3", "[preset.night] strength = 3: '3' is not a share"),
        ("[preset.night]\nmethod = 3", "[preset.night] method = 3: is not a text in quotes"),
        ("[preset.night.fix]\nmethod = 'x'", "[preset.night.fix] method = x: 'x' is not one of"),
        ("[preset.night]\npreset = 'day'", "[preset.night] preset: no such option"),
        ("[fix]\nstrength = '80'", "[fix] strength = 80: '80' is not a share"),
        ("[fix]\npreset = 'x'", "[fix] preset: no such option"),
    ],
)
def test_a_wrong_preset_or_value_is_wrong_usage_and_its_place_is_named(
    deshake, config, tmp_path, text, what
):
    path = config(text)
    outcome = deshake("--config", path, "fix", tmp_path / "gone.jpg")
    assert outcome.code == 2
    assert outcome.err.startswith(f"error: {path}: ")
    assert what in outcome.err


def test_an_option_of_a_preset_goes_to_each_command_that_has_it(real, config):
    path = config(
        "[fix]\niterations = 7\nstrength = 0.1\n"
        "[preset.night]\nstrength = '80%'\npreview = true\nblur-size = 9\n"
        "[preset.night.fix]\nblur-size = 5\n"
    )
    fix = real("--preset", "night", "fix", "a.jpg", config=path)
    assert (fix["strength"], fix["preview"], fix["blur_size"]) == (0.8, True, 5)
    assert fix["iterations"] == 7
    deblur = real("--preset", "night", "deblur", "a.jpg", "k.npz", config=path)
    assert (deblur["strength"], deblur["preview"]) == (0.8, True)
    assert real("--preset", "night", "estimate-blind", "a.jpg", config=path)["blur_size"] == 9
    # That of register is a file, and no flag.
    assert real("--preset", "night", "register", "a.jpg", "b.jpg", config=path)["preview"] is None
    assert real("fix", "a.jpg", config=path)["strength"] == 0.1


@pytest.mark.parametrize(
    ("typed", "name", "other"),
    [
        (("--max-angle", "2"), "max_angle", "blur_size"),
        (("--camera", "c.npz"), "camera", "focal_35mm"),
        (("--overwrite",), "overwrite", "skip_existing"),
        (("--scheduler", "tcp://a:1"), "scheduler", "jobs"),
        (("--method", "rl"), "method", "quality"),
    ],
)
def test_a_typed_option_cancels_contrary_ones_of_the_file(
    real, config, monkeypatch, *, typed, name, other
):
    path = config(
        "[fix]\nblur-size = 40\nfocal-35mm = 28\nskip-existing = true\njobs = 3\nquality = 'high'\n"
    )
    before = real("fix", "a.jpg", config=path)
    assert before[other] in {40, 28, True, 3, "high"}
    after = real("fix", "a.jpg", *typed, config=path)
    assert after[name]
    assert after[other] in {None, False, "default"}
    # The environment has priority over the file, and the command line over both.
    monkeypatch.setenv(f"DESHAKE_FIX_{name.upper()}", "1" if len(typed) == 1 else typed[1])
    assert real("fix", "a.jpg", config=path)[other] in {None, False, "default"}


def test_two_contrary_options_of_one_place_are_wrong_usage(deshake, config):
    path = config("[fix]\nblur-size = 40\nmax-angle = 2\n")
    outcome = deshake("--config", path, "fix", "a.jpg")
    assert outcome.code == 2
    assert "cannot both be given" in outcome.err
    outcome = deshake("fix", "a.jpg", "--overwrite", "--skip-existing")
    assert outcome.code == 2
    assert "--overwrite and --skip-existing cannot both be given" in outcome.err


@pytest.mark.parametrize(
    ("name", "value", "needs"),
    [
        ("search-angle", 5, ("--noisy", "b.jpg")),
        ("report-images", True, ("--report", "look.html")),
        ("open", True, ("--compare",)),
    ],
)
def test_what_the_file_says_counts_only_where_it_has_a_use(
    real, config, deshake, *, name, value, needs
):
    typed = (f"--{name}",) if value is True else (f"--{name}", value)
    outcome = deshake("fix", "a.jpg", *typed)
    assert outcome.code == 2
    assert f"--{name} needs --" in outcome.err
    path = config(f"[fix]\n{name} = {str(value).lower()}\n")
    key = {"open": "open_after"}.get(name, name.replace("-", "_"))
    assert not real("fix", "a.jpg", config=path)[key]
    assert real("fix", "a.jpg", *needs, config=path)[key] == value


def test_a_typed_option_cancels_contrary_ones_in_all_commands(
    deshake, config, pair, boards, tmp_path
):
    path = config(
        "[fix]\nregion = [0, 0, 5, 5]\nestimator = 'variational'\nfocal = 'auto'\n"
        "[estimate-pair]\nsearch-angle = 5\nfocal-px = 150\n"
        "[deblur]\nsearch-angle = 5\n"
        "[calibrate]\nfocal-px = 150\n"
    )
    own, out = ("--config", path), tmp_path / "out.png"
    blurred, noisy = pair
    dry = ("--noisy", noisy, "-o", out, "--dry-run")
    assert deshake(*own, "fix", blurred, *dry).code == 0
    outcome = deshake(*own, "fix", blurred, *dry, "--region", "0,0,5,5")
    assert outcome.code == 2
    assert "--region does not go with --noisy" in outcome.err
    registration, kernel = tmp_path / "pair.npz", tmp_path / "kernel.npz"
    near = ("--focal-px", 150, "--search-angle", 4)
    assert deshake("register", *pair, *near, "-o", registration).code == 0
    known = ("--registration", registration)
    estimate = ("estimate-pair", *pair, *known, "-o", kernel, "--blur-size", 8)
    assert deshake(*own, *estimate, "--dry-run").code == 0
    outcome = deshake(*own, *estimate, "--dry-run", "--focal-px", 150)
    assert outcome.code == 2
    assert "--registration and --focal-px cannot both be given" in outcome.err
    assert deshake(*own, *estimate).code == 0
    assert deshake(*own, "deblur", blurred, kernel, *dry, *known).code == 0
    photos = []
    for number, board in enumerate(boards[0]):
        photos.append(tmp_path / f"{number}.png")
        Image.fromarray(board).save(photos[-1])
    chessboard = ("calibrate", *photos, "--chessboard", "--board", "7x5", "--json")
    assert deshake(*own, *chessboard).code == 0
    assert deshake(*own, *chessboard, "--focal-px", 150).code == 2


def test_a_typed_estimator_cancels_a_least_confidence_of_the_file(
    deshake, config, sharp_photo, tmp_path
):
    args = ("fix", sharp_photo("a.png"), "-o", tmp_path / "b.png", "--dry-run")
    path = config("[fix]\nleast-confidence = 0.3\n")
    variational = ("--estimator", "variational")
    assert deshake("--config", path, *args, *variational).code == 0
    assert deshake("--config", path, *args, *variational, "--least-confidence", 0.3).code == 2
