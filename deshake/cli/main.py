"""The group of commands, and how a run of it ends.

A command's module is imported when the command is run, or asked for its own help: the list of
commands below is all that ``deshake --help`` needs.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, NamedTuple, NoReturn

import click
from click.exceptions import NoSuchCommand

from deshake.cli.context import Context
from deshake.cli.general_options import program_options
from deshake.cli.messages import log_to_stderr, print_exception, print_note
from deshake.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

__all__ = ["COMMANDS", "EXIT_FAILED", "EXIT_INTERRUPTED", "EXIT_USAGE", "cli", "main"]

_log = logging.getLogger(__name__)

EXIT_FAILED: Final = 1
EXIT_USAGE: Final = 2
EXIT_INTERRUPTED: Final = 130

_LINEAR_ALGEBRA: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""The variables that NumPy's linear algebra reads when it is imported, after this module."""


class _Entry(NamedTuple):
    """The module of a command, and the first line of its help."""

    module: str
    summary: str


COMMANDS: Final = {
    "fix": _Entry("deshake.cli.fix", "Remove camera shake from photos, in one go."),
    "inspect": _Entry("deshake.cli.inspect", "Say what blurs photos, and what files are."),
    "calibrate": _Entry("deshake.cli.calibrate", "Find photos' focal lengths in pixels."),
    "register": _Entry("deshake.cli.register", "Find how a noisy photo lies to a blurred one."),
    "estimate-blind": _Entry(
        "deshake.cli.estimate_blind", "Estimate the blur kernels of shaken photos."
    ),
    "estimate-pair": _Entry(
        "deshake.cli.estimate_pair", "Estimate a blur kernel from a blurred and a noisy photo."
    ),
    "deblur": _Entry("deshake.cli.deblur", "Deblur photos whose blur kernels are known."),
    "render-kernel": _Entry("deshake.cli.render_kernel", "Draw a blur kernel as a picture."),
    "simulate": _Entry("deshake.cli.simulate", "Shake a sharp photo by a known rotation."),
}
"""The commands in the order of the help."""


class _LazyGroup(click.Group):
    """A group that knows its commands' names and summaries without importing them."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = import_module(COMMANDS[cmd_name].module).command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        try:
            return super().resolve_command(ctx, args)
        except NoSuchCommand as error:  # click looks for similar names among imported commands
            raise NoSuchCommand(error.command_name, possibilities=COMMANDS, ctx=ctx) from None

    def format_commands(
        self,
        ctx: click.Context,  # noqa: ARG002
        formatter: click.HelpFormatter,
    ) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.summary) for name, entry in COMMANDS.items()])


@click.group(
    cls=_LazyGroup,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "auto_envvar_prefix": "DESHAKE",
        "max_content_width": 100,
    },
    epilog="Options are also read from the environment (DESHAKE_THREADS, DESHAKE_FIX_TRANSFER) "
    "and from a configuration file: yours, ~/.config/deshake/config.toml, or that of --config. "
    "What is typed comes first, then the environment, then the preset, then the file.",
)
@click.version_option(__version__, prog_name="deshake", message="%(prog)s %(version)s")
@program_options
@click.pass_context
def cli(ctx: click.Context) -> None:
    """Remove camera-rotation shake from photographs.

    A shaken camera turns while the shutter is open, and blurs each part of the photo
    differently. deshake estimates those rotations from the photo itself and undoes the blur.
    """
    ctx.ensure_object(Context)


def main(args: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    args : sequence of str, optional
        The arguments; by default those of the process.

    Returns
    -------
    int
        The exit code: 0 done, 1 failed, 2 wrong usage, 130 interrupted. SIGTERM ends the process
        with 143.

    """
    context = Context(arguments=sys.argv[1:] if args is None else list(args))
    for name in _LINEAR_ALGEBRA:
        # The order of its sums depends on its threads: with one, equal inputs give equal bytes on
        # every machine of a kind. The work is split at a higher level anyway.
        os.environ.setdefault(name, "1")
    with log_to_stderr(), _exit_on_sigterm():
        try:
            code = _run(args, context)
            sys.stdout.flush()
        except (KeyboardInterrupt, click.Abort):
            print_note("interrupted", also_quiet=True)
            return EXIT_INTERRUPTED
        except Exception as error:  # noqa: BLE001  the last to hear of any error
            if isinstance(error.__cause__ or error, BrokenPipeError):
                _discard_stdout()  # the reader of stdout closed it
                return EXIT_FAILED
            print_exception(error)
            _log.debug("traceback", exc_info=error)
            return EXIT_USAGE if isinstance(error, click.UsageError) else EXIT_FAILED
    return code


def _run(args: Sequence[str] | None, context: Context) -> int:
    """Run the group; return the code that a command returns or exits with, else 0."""
    arguments = None if args is None else list(args)
    result: Any = cli.main(arguments, prog_name="deshake", standalone_mode=False, obj=context)
    return result if isinstance(result, int) else 0


def _discard_stdout() -> None:
    """Keep the interpreter from writing to the closed pipe once more as it ends."""
    try:
        descriptor = sys.stdout.fileno()
    except (OSError, ValueError):
        return
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, descriptor)
    os.close(null)


@contextmanager
def _exit_on_sigterm() -> Iterator[None]:
    """Leave by an exception on SIGTERM, so that unfinished outputs are removed."""

    def leave(number: int, frame: object) -> NoReturn:  # noqa: ARG001
        raise SystemExit(128 + number)

    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may catch signals
        return
    before = signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
