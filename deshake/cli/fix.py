"""``deshake fix``: remove camera shake from photos, in one go."""

from __future__ import annotations

import json
import logging
from typing import TYPE_CHECKING, Any

import click

from deshake.cli.finishing import finish_options
from deshake.cli.messages import describe, print_error
from deshake.cli.options import (
    FILE,
    estimate_options,
    general_options,
    json_option,
    linear_option,
    output_option,
    overwrite_option,
    provenance_option,
)
from deshake.cli.restoration import noisy_option, restoration, restoration_options

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from deshake.cli.context import Context, Progress
    from deshake.pipelines.batch import Job

__all__ = ["command"]

_log = logging.getLogger(__name__)


@click.command("fix")
@click.argument("photos", type=FILE, nargs=-1, required=True, metavar="PHOTO...")
@output_option(
    "PHOTO's name with .deshaken before its ending",
    metavar="FILE|DIR",
    note="; for several photos or a folder of them, a folder",
)
@click.option(
    "--keep-kernels",
    type=FILE,
    metavar="DIR",
    help="Write each photo's kernel file into this folder.",
)
@noisy_option
@estimate_options
@restoration_options
@finish_options(folder=True)
@linear_option
@provenance_option
@json_option
@overwrite_option
@click.option(
    "--skip-existing", is_flag=True, help="Leave out the photos whose output exists already."
)
@click.option("--fail-fast", is_flag=True, help="Stop at the first photo that fails.")
@general_options
@click.pass_context
def command(
    ctx: click.Context,
    /,
    *,
    photos: tuple[Path, ...],
    output: Path | None,
    keep_kernels: Path | None,
    camera: Path | None,
    noisy: Path | None,
    method: str | None,
    quality: str,
    iterations: int | None,
    strength: float,
    mask: Path | None,
    preview: bool,
    compare: bool,
    linear: bool,
    no_provenance: bool,
    as_json: bool,
    overwrite: bool,
    skip_existing: bool,
    fail_fast: bool,
    **choices: Any,  # noqa: ANN401 - the fields of EstimateOptions
) -> int:
    """Remove camera shake from photos, in one go.

    Calibrates each PHOTO, estimates its blur kernel and deblurs it: the same bytes as calibrate,
    estimate-blind and deblur give one by one. A PHOTO may be a folder, whose photos are then
    taken by name; earlier results in it are passed over. If one photo fails, the others go on.

    With --noisy the kernel of the one PHOTO is estimated, and PHOTO deblurred, with the help of a
    noisy photo: the same bytes as register, estimate-pair and deblur --noisy give one by one.
    """
    from deshake.io.kernel_file import read_camera
    from deshake.pipelines.batch import PlanError, plan, run
    from deshake.pipelines.finishing import Finish
    from deshake.pipelines.stages import EstimateOptions

    if overwrite and skip_existing:
        raise click.UsageError("--overwrite and --skip-existing cannot both be given.")
    chosen = restoration(noisy, method=method, quality=quality, iterations=iterations)
    if noisy is not None:
        _check_pair_options(**choices)
    try:
        jobs = plan(
            photos,
            output,
            keep_kernels,
            noisy=noisy,
            mask=mask,
            compare=compare,
            overwrite=overwrite,
            skip_existing=skip_existing,
        )
    except PlanError as error:
        raise click.UsageError(str(error), ctx) from None
    known = None if camera is None else read_camera(camera)
    options = EstimateOptions(camera=known, **choices)
    context: Context = ctx.obj
    failed = 0
    for number, job in enumerate(jobs, 1):
        text = job.source.name + (f" ({number} of {len(jobs)})" if len(jobs) > 1 else "")
        try:
            with context.bar(text) as bar:
                found = run(
                    job,
                    options,
                    restoration=chosen,
                    finish=Finish(strength, job.mask, preview, compare),
                    linear=linear,
                    provenance=not no_provenance,
                    threads=context.threads,
                    progress=_titled(bar, text),
                )
            report = {"status": "skipped"} if found is None else {"status": "done"} | found.report()
        except Exception as error:  # noqa: BLE001  one bad photo never stops the rest
            failed += 1
            report = _failure(job, error, context)
        if as_json:
            click.echo(json.dumps(_files(job) | report))
        if failed and fail_fast:
            break
    if failed and len(jobs) > 1:
        _log.warning("%d of %d photos failed", failed, len(jobs))
    return 1 if failed else 0


def _check_pair_options(*, region: object, estimator: str, **_: object) -> None:
    """Refuse what only a blind estimate goes by."""
    for name, given in {"region": region is not None, "estimator": estimator != "auto"}.items():
        if given:
            raise click.UsageError(f"--{name} does not go with --noisy.")


def _titled(bar: Progress, title: str) -> Callable[[float, str], None]:
    """Return what shows a title on the bar before what is being done."""
    return lambda share, text: bar(share, f"{title}: {text}")


def _files(job: Job) -> dict[str, str]:
    files = {
        "input": job.source,
        "noisy": job.noisy,
        "mask": job.mask,
        "output": job.output,
        "kernel": job.kernel,
        "sheet": job.sheet,
    }
    return {name: str(path) for name, path in files.items() if path is not None}


def _failure(job: Job, error: Exception, context: Context) -> dict[str, Any]:
    """Print what went wrong with a photo, and return it."""
    message, hint = describe(error)
    if str(job.source) not in message and not getattr(error, "file", None):
        message = f"{job.source}: {message}"
    print_error(message, hint=hint)
    if context.verbosity > 1:
        _log.debug("traceback", exc_info=error)
    return {"status": "failed", "error": message, "hint": hint}
