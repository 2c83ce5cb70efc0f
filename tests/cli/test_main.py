from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import warnings

import pytest

from deshake.cli.main import COMMANDS, cli
from deshake.errors import DeshakeError, PhotoError
from deshake.version import __version__

HEAVY = ("numpy", "scipy", "cv2", "PIL", "piexif", "tifffile", "tqdm")


def raising(error):
    def function(_):
        raise error

    return function


def run_python(code, **options):
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, **options
    )


def test_help_lists_every_command_and_imports_nothing_heavy():
    done = run_python(
        "import sys\nfrom deshake.cli.main import main\ncode = main(['--help'])\n"
        f"heavy = [name for name in {HEAVY!r} if name in sys.modules]\n"
        "print(*heavy, file=sys.stderr)\nsys.exit(code)"
    )
    assert done.returncode == 0
    assert done.stderr.split() == []
    for name, entry in COMMANDS.items():
        assert f"{name} " in done.stdout
        assert entry.summary in done.stdout


def test_help_answers_at_once():
    took = []
    for _ in range(3):  # of the processor, the best of three: the machine may be busy
        start = _processor_time_of_children()
        subprocess.run([sys.executable, "-m", "deshake", "--help"], capture_output=True, check=True)
        took.append(_processor_time_of_children() - start)
    assert min(took) < 0.5


def _processor_time_of_children():
    spent = os.times()
    return spent.children_user + spent.children_system


def test_version(deshake):
    assert deshake("--version").out == f"deshake {__version__}\n"


@pytest.mark.parametrize("name", COMMANDS)
def test_the_summary_is_the_first_line_of_the_help(name):
    command = cli.get_command(None, name)
    assert command.name == name
    assert command.help.splitlines()[0] == COMMANDS[name].summary


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help(deshake, name):
    outcome = deshake(name, "--help")
    assert outcome.code == 0
    assert COMMANDS[name].summary in " ".join(outcome.out.split())


def test_no_command_shows_the_help_and_is_wrong_usage(deshake):
    outcome = deshake()
    assert outcome.code == 2
    assert outcome.out == ""
    assert "Commands:" in outcome.err


def test_wrong_usage_names_what_is_wrong_and_where_to_look(deshake):
    outcome = deshake("render-kernel", "k.npz", "--colour")
    assert outcome.code == 2
    assert outcome.err == (
        "error: No such option '--colour'.\nhint: see deshake render-kernel --help\n"
    )


@pytest.mark.parametrize("name", COMMANDS)
def test_wrong_usage_of_every_command_is_2_to_the_shell(name):
    done = subprocess.run(
        [sys.executable, "-m", "deshake", name, "--colour"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: No such option '--colour'.")


def test_an_unknown_command_suggests_a_known_one(deshake):
    outcome = deshake("fixx")
    assert outcome.code == 2
    assert "No such command 'fixx'. Did you mean 'fix'?" in outcome.err


def test_the_exit_code_is_what_the_command_returns(deshake, trial):
    trial(lambda _: 1)
    assert deshake("trial").code == 1
    trial(lambda _: None)
    assert deshake("trial").code == 0


def test_an_error_raised_on_purpose_is_two_lines(deshake, trial):
    trial(raising(PhotoError("is torn", hint="glue it", file="photo.jpg")))
    outcome = deshake("trial")
    assert outcome.code == 1
    assert outcome.err == "error: photo.jpg: is torn\nhint: glue it\n"


def test_a_bug_is_one_line_and_its_traceback_needs_vv(deshake, trial):
    trial(raising(ZeroDivisionError("division by zero")))
    outcome = deshake("trial")
    assert outcome.code == 1
    assert outcome.err == (
        "error: ZeroDivisionError: division by zero\n"
        "hint: this is a bug in deshake: report it with what -vv prints\n"
    )
    for args in (("-vv", "trial"), ("trial", "-vv"), ("-v", "trial", "-v")):
        assert "Traceback (most recent call last)" in deshake(*args).err


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (MemoryError(), "error: not enough memory"),
        (OSError(28, "No space left on device", "out.png"), "error: out.png: No space left"),
        (OSError(5, "Input/output error"), "error: Input/output error"),
    ],
)
def test_what_the_system_refuses_is_no_bug(deshake, trial, error, line):
    trial(raising(error))
    outcome = deshake("trial")
    assert outcome.code == 1
    assert outcome.err.startswith(line)
    assert "bug" not in outcome.err


def test_an_interrupt_is_130_without_a_traceback(deshake, trial):
    trial(raising(KeyboardInterrupt()))
    outcome = deshake("trial")
    assert outcome.code == 130
    assert outcome.err.strip() == "interrupted"


@pytest.mark.parametrize("wrapped", [False, True])
def test_a_closed_pipe_is_quiet(deshake, trial, wrapped):
    def function(_):
        if not wrapped:
            raise BrokenPipeError
        raise DeshakeError("cannot be written") from BrokenPipeError()

    trial(function)
    outcome = deshake("trial")
    assert (outcome.code, outcome.err) == (1, "")


@pytest.mark.skipif(os.name == "nt", reason="needs a POSIX shell")
def test_a_reader_that_leaves_early_is_quiet():
    done = subprocess.run(
        f"{sys.executable} -c 'import time; time.sleep(.3); "
        'from deshake.cli.main import main; raise SystemExit(main(["--help"]))\' | true',
        shell=True,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")  # noqa: PTH110
def test_a_full_stdout_is_an_error():
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = subprocess.run(
            [sys.executable, "-m", "deshake", "--version"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 1
    assert done.stderr.startswith("error: ")
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")
def test_sigterm_leaves_by_an_exception(deshake, trial):
    left = []

    def function(_):
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(5)
        finally:
            left.append(True)

    trial(function)
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit) as caught:
        deshake("trial")
    assert caught.value.code == 128 + signal.SIGTERM
    assert left
    assert signal.getsignal(signal.SIGTERM) is before


def test_warnings_of_libraries_need_vv(deshake, trial):
    def function(_):
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.warn("strange tag", UserWarning, stacklevel=1)

    trial(function)
    assert deshake("trial").err == ""
    assert "strange tag" in deshake("-vv", "trial").err


@pytest.mark.skipif(sys.platform != "linux", reason="needs RLIMIT_AS and Linux's loader")
def test_too_little_memory_for_the_libraries_is_reported(shaken):
    code = (
        "import resource, sys\n"
        "from deshake.cli.main import main\n"
        "limit = 150 << 20\n"
        "resource.setrlimit(resource.RLIMIT_AS, (limit, limit))\n"
        f"sys.exit(main(['fix', {str(shaken('a.jpg'))!r}]))"
    )
    done = run_python(code)
    assert done.returncode == 1
    assert done.stderr.startswith("error: not enough memory")
    assert "hint: " in done.stderr
    assert "bug" not in done.stderr
