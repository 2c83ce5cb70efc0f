"""The help of a command in groups: the options for every day come first.

The table below has the group of each option. An option that is in no group comes under "More
options", just before the general ones.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import click

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["GROUPS", "GroupedCommand", "option_groups"]

_COLUMN: Final = 30
"""Characters; an option with longer names has its description below them."""
_OTHERS: Final = "More options"

GROUPS: Final[Mapping[str, Sequence[str]]] = {
    "Every day": (
        *("--output", "--strength", "--preview", "--compare", "--report", "--open"),
        *("--blur-size", "--noisy", "--overwrite", "--preset"),
    ),
    "Estimating": (
        *("--region", "--max-angle", "--uniform", "--estimator", "--registration"),
        *("--search-angle", "--least-confidence", "--latent", "--tiles"),
    ),
    "Camera and lens": (
        *("--camera", "--focal", "--focal-px", "--focal-35mm", "--lens", "--lens-model"),
        *("--chessboard", "--board", "--keep-geometry"),
    ),
    "Restoring": (
        "--kernel",
        "--method",
        "--quality",
        "--iterations",
        "--mask",
        "--protect-moving",
    ),
    "Many photos": (
        *("--recursive", "--only-shaken", "--skip-existing", "--retry-failed", "--fail-fast"),
        *("--dry-run", "--json", "--jobs", "--memory", "--scheduler"),
    ),
    "Files": (
        *("--format", "--jpeg-quality", "--max-size", "--preserve", "--transfer", "--linear"),
        *("--keep-kernels", "--keep-masks", "--report-images", "--no-provenance"),
    ),
    "General": ("--verbose", "--quiet", "--log", "--progress", "--threads", "--help"),
}
"""The groups in the order of the help, each with the long names of its options in their order."""


class GroupedCommand(click.Command):
    """A command whose help shows its options in groups.

    Parameters
    ----------
    groups : mapping of str to sequence of str, optional
        Groups of this command alone, by their titles. They come after the first of `GROUPS`. An
        option that is in both is shown in these.

    """

    def __init__(
        self,
        *args: Any,  # noqa: ANN401 - what click takes
        groups: Mapping[str, Sequence[str]] | None = None,
        **more: Any,  # noqa: ANN401
    ) -> None:
        super().__init__(*args, **more)
        self.groups = groups or {}

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, group by group."""
        for title, options in option_groups(self, ctx).items():
            records = [record for each in options if (record := each.get_help_record(ctx))]
            with formatter.section(title):
                formatter.write_dl(
                    [(name.ljust(_COLUMN), text) for name, text in records], col_max=_COLUMN
                )


def option_groups(command: click.Command, ctx: click.Context) -> dict[str, list[click.Option]]:
    """Return the options that a command's help shows, by the titles of their groups.

    Parameters
    ----------
    command : click.Command
        The command; the own groups of a `GroupedCommand` come after the first of `GROUPS`.
    ctx : click.Context
        Its context.

    Returns
    -------
    dict
        Groups without options are left out.

    """
    own = command.groups if isinstance(command, GroupedCommand) else {}
    shown = {
        max(param.opts, key=len): param
        for param in command.get_params(ctx)
        if isinstance(param, click.Option) and not param.hidden
    }
    first, *_, last = GROUPS
    own_names = {name for names in own.values() for name in names}
    groups: dict[str, list[click.Option]] = {}
    for title in dict.fromkeys([first, *own, *GROUPS]):
        shared = [name for name in GROUPS.get(title, ()) if name not in own_names]
        names = [*own.get(title, ()), *shared]
        groups[title] = [shown.pop(name) for name in names if name in shown]
    groups[_OTHERS] = list(shown.values())
    groups[last] = groups.pop(last)
    return {title: options for title, options in groups.items() if options}
