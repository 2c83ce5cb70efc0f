"""``deshake inspect``: say what blurs photos, and what files are."""

from __future__ import annotations

import json
from collections import Counter
from typing import TYPE_CHECKING, Any

import click

from deshake.cli.batch import planned, reading_options, run_batch
from deshake.cli.general_options import general_options
from deshake.cli.messages import print_note
from deshake.cli.option_groups import GroupedCommand
from deshake.cli.options import FILE, no_stdin

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from deshake.batch.plan import Job
    from deshake.batch.task import Result
    from deshake.cli.batch import Batch
    from deshake.cli.context import Context

__all__ = ["command"]


@click.command("inspect", cls=GroupedCommand)
@click.argument(
    "files", type=FILE, nargs=-1, required=True, metavar="FILE|DIR...", callback=no_stdin
)
@reading_options
@general_options
@click.pass_obj
def command(context: Context, /, *, files: tuple[Path, ...], batch: Batch) -> int:
    """Say what blurs photos, and what files are.

    Of a photo: whether it is sharp, shaken, soft or out of focus, and how sure that is; how wide a
    shake is in pixels of the photo, and its direction (0 degrees is level, 90 upright, 45 rises to
    the right); the noise at a mid grey; the focal length, and where it comes from. This takes a
    second or two. No kernel is estimated, so the verdict is a judgement: fix knows better.

    Of a photo that deshake made, of a kernel, camera or registration file (.npz): what it is and
    how it was made. One FILE is described in several lines, several in a line each.
    """
    from deshake.batch.inspect_work import Inspect

    jobs = planned(files, None, batch, beside=False)
    describe = _described(jobs)
    verdicts: Counter[str] = Counter()

    def line(result: Result) -> str:
        if result.figures["kind"] == "photo":
            verdicts[_verdict(result.figures)] += 1
        return describe(result)

    code = run_batch(context, jobs, Inspect(), batch, line)
    if len(jobs) > 1 and verdicts:
        counts = [f"{count} {verdict}" for verdict, count in verdicts.most_common()]
        print_note(f"  {', '.join(counts)}")
    return code


def _described(jobs: Sequence[Job]) -> Callable[[Result], str]:
    """Return a function that describes a result: in lines, or in one if there are several jobs."""
    if len(jobs) == 1:
        return _in_lines
    width = max(len(str(job.source)) for job in jobs)
    return lambda result: f"{result.job.source!s:{width}}  {_summary(result.figures)}"


def _in_lines(result: Result) -> str:
    """Describe a file in lines: its name and what it is, then its figures."""
    figures = result.figures
    rows = [*_own_rows(figures), *_camera_rows(figures), *_origin_rows(figures)]
    width = max((len(name) for name, _ in rows), default=0)
    lines = [f"  {name:{width}}  {text}" for name, text in rows]
    return "\n".join([f"{result.job.source}: {_title(figures)}", *lines])


def _summary(figures: Mapping[str, Any]) -> str:
    """Describe a file in one line."""
    match figures["kind"]:
        case "photo":
            more = f"noise {_percent(figures['noise'])}, {_film(figures)}"
            made = ", made by deshake" if "provenance" in figures else ""
            return f"{_title(figures):46}  {more}{made}"
        case "kernel":
            more = f"{figures['extent_px']:g} px, confidence {figures['confidence']:g}"
        case "registration":
            more = f"confidence {figures['confidence']:g}"
        case _:
            more = f"{_film(figures)} ({figures['source']})"
    return f"{_title(figures):46}  {more}"


def _title(figures: Mapping[str, Any]) -> str:
    """Return in a few words what a file is."""
    from deshake.batch.verdict import blur_words

    match figures["kind"]:
        case "photo":
            return blur_words(figures)
        case "kernel":
            models = {"still": "a camera that stood still", "uniform": "shifts of the whole frame"}
            return f"kernel of {models.get(figures['model'], 'rotations')}"
        case _:
            return f"{figures['kind']} file"


def _verdict(figures: Mapping[str, Any]) -> str:
    """Return the verdict on a photo in a word or two."""
    doubtful = not figures["certain"] and figures["verdict"] != "unclear"
    return f"perhaps {figures['verdict']}" if doubtful else str(figures["verdict"])


def _own_rows(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the figures that only this kind of file has."""
    match figures["kind"]:
        case "photo":
            rows = [("noise", f"{_percent(figures['noise'])} of white at a mid grey")]
            return [*rows, ("format", figures["format"])]
        case "kernel":
            return [
                ("extent", f"{figures['extent_px']:g} px"),
                ("angles", f"{_angles(figures['angles_deg'])} about X, Y, Z"),
                ("weights", str(figures["rotations"])),
                ("confidence", f"{figures['confidence']:g}"),
            ]
        case "registration":
            return [
                ("rotation", f"{_angles(figures['rotation_deg'])} about X, Y, Z"),
                ("brightness", f"the noisy photo is 1/{figures['scale']:g} as bright"),
                ("confidence", f"{figures['confidence']:g}"),
            ]
        case _:
            return []


def _camera_rows(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the figures of the camera, which all kinds have."""
    source = figures.get("focal_source") or figures.get("source")
    focal = f"{figures['focal_px']:g} px, {_film(figures)}"
    rows = [("size", f"{figures['width']} x {figures['height']} px")]
    rows.append(("focal length", focal if source is None else f"{focal} ({source})"))
    if "distortion" in figures:
        rows.append(("lens", "with distortion"))
    return rows


def _origin_rows(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return how a file was made, by its provenance."""
    provenance = figures.get("provenance")
    if provenance is None:
        return []
    if not provenance:
        return [("made by", "unknown: it does not say")]
    rows = [("made by", f"deshake {provenance.get('deshake', '')} {provenance.get('command', '')}")]
    names = {"input_sha256": "photo SHA-256", "noisy_sha256": "noisy SHA-256", "camera": "camera"}
    rows += [(text, str(provenance[name])) for name, text in names.items() if name in provenance]
    rows += _option_rows("options", provenance.get("options"))
    kernel = provenance.get("kernel")
    if isinstance(kernel, dict) and kernel:
        rows.append(("kernel by", str(kernel.get("command", "unknown"))))
        rows += _option_rows("its options", kernel.get("options"))
    notes = provenance.get("notes")
    rows += [("note", str(note)) for note in (notes if isinstance(notes, list) else [])]
    return [(name, text.strip()) for name, text in rows]


def _option_rows(name: str, options: object) -> list[tuple[str, str]]:
    """Return the options of a stage, without those that are empty."""
    if not isinstance(options, dict):
        return []
    given = [
        f"{key}={_as_text(value)}" for key, value in options.items() if value not in (None, False)
    ]
    return [(name, ", ".join(given))] if given else []


def _as_text(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _film(figures: Mapping[str, Any]) -> str:
    return f"{figures['focal_35mm']:.3g} mm-equivalent"


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"


def _angles(degrees: Sequence[float]) -> str:
    return ", ".join(f"{angle:.3g}" for angle in degrees) + " degrees"
