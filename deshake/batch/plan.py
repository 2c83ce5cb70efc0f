"""Where the result of each photo goes, and whether it can go there: decided before any work."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from deshake.batch.folders import InputPhoto, find_photos, identity
from deshake.errors import DeshakeError, OutputError
from deshake.files.disk import STREAM, check_output
from deshake.files.output_folder import check_folder, make_folder
from deshake.files.part_files import remove_stale_parts
from deshake.formats.output_names import output_name
from deshake.metadata.provenance import read_provenance

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from deshake.batch.name_template import NameTemplate

__all__ = ["Existing", "Extra", "Job", "PlanError", "plan"]

Existing = Literal["refuse", "skip", "replace"]
"""What is done about results that exist already."""


class PlanError(DeshakeError):
    """What was asked for contradicts itself."""


@dataclass(frozen=True)
class Extra:
    """An output beside the result: where it goes, and what it is called.

    Parameters
    ----------
    path : Path or None
        A folder, made if it is missing; without `name`, a file for one photo. None: beside the
        result.
    name : callable, optional
        Returns the name for a photo, or for its result if the output lies beside the result.

    """

    path: Path | None
    name: Callable[[Path], str] | None = None

    def place(self, photo: InputPhoto, result: Path | None) -> Path:
        """Return where it goes for a photo."""
        if self.path is None:
            beside = photo.path if result is None else result
            return beside.with_name(self.name(beside) if self.name else beside.name)
        return self.path / photo.below / self.name(photo.path) if self.name else self.path


@dataclass(frozen=True)
class Job:
    """One photo to work on.

    Parameters
    ----------
    source : Path
        The photo.
    output : Path or None
        Where its result goes.
    others : mapping of str to Path
        Where other outputs go, by their kinds: ``kernel``, ``latent``,
        ``moving_mask``, ``sheet``, ``tiles``.
    needs : mapping of str to Path
        Other inputs, by their kinds: ``noisy``, ``kernel``, ``mask``.
    problem : DeshakeError or None
        Why the outputs cannot go there.
    existing : {"refuse", "skip", "replace"}
        What is done about a result that exists already. "skip" skips a photo if all its outputs
        exist, and replaces its other outputs if the result is missing.

    """

    source: Path
    output: Path | None
    others: Mapping[str, Path] = field(default_factory=dict)
    needs: Mapping[str, Path] = field(default_factory=dict)
    problem: DeshakeError | None = None
    existing: Existing = "refuse"

    @property
    def overwrite(self) -> bool:
        """Whether an existing result may be replaced."""
        return self.existing == "replace"

    @property
    def overwrite_others(self) -> bool:
        """Whether other existing outputs may be replaced."""
        return self.existing != "refuse"

    @property
    def keeps_result(self) -> bool:
        """Whether the result exists already and is kept."""
        exists = self.output is not None and os.path.lexists(self.output)
        return exists and self.existing == "skip" and self.problem is None

    @property
    def missing(self) -> list[str]:
        """The kinds of the other outputs that are missing."""
        files = {kind: path for kind, path in self.others.items() if str(path) != STREAM}
        return [kind for kind, path in files.items() if not os.path.lexists(path)]

    @property
    def skipped(self) -> bool:
        """Whether all outputs exist already and are kept."""
        return self.keeps_result and not self.missing

    @property
    def place(self) -> Path:
        """Where the result goes, for a stage that always has one."""
        if self.output is None:
            raise ValueError("this stage has a result")
        return self.output

    @property
    def outputs(self) -> list[Path]:
        """All files that it may write."""
        return [*filter(None, [self.output]), *self.others.values()]

    def files(self) -> dict[str, str | None]:
        """Return the names of all files as JSON data."""
        files = {"input": self.source, **self.needs, "output": self.output, **self.others}
        return {name: None if path is None else str(path) for name, path in files.items()}


def plan(
    inputs: Sequence[Path],
    output: Path | None = None,
    *,
    into: bool = False,
    template: NameTemplate | None = None,
    name: Callable[[Path], str] = output_name,
    beside: bool = True,
    extras: Mapping[str, Extra] | None = None,
    needs: Mapping[str, Callable[[InputPhoto], Path | None]] | None = None,
    recursive: bool = False,
    existing: Existing = "refuse",
    dry: bool = False,
    check: Callable[[Sequence[Job]], None] | None = None,
) -> list[Job]:
    """Decide where the results for photos go, and check that they can go there.

    Folders for results are made. Unfinished outputs of killed runs in them are removed.

    Parameters
    ----------
    inputs : sequence of Path
        Photos and folders of photos.
    output : Path, optional
        For one photo, a file or an existing folder. For several, or a folder of them, a folder,
        which is made if it is missing and its parent is there; it gets the folders below the named
        ones that have photos.
    into : bool
        Whether `output` is a folder, even for one photo.
    template : NameTemplate, optional
        Gives the place of each result instead of `output`. The folder that it begins with is made
        if it is missing and its parent is there. Earlier results of the template do not count as
        photos; their provenance identifies them.
    name : callable
        Gives the name of a photo's result.
    beside : bool
        Whether results lie beside the photos where there is no `output`; else there are none.
    extras : mapping of str to Extra, optional
        Further outputs.
    needs : mapping of str to callable, optional
        Further inputs, which functions find for a photo; None: it has none.
    recursive : bool
        Whether folders in folders are searched, too.
    existing : {"refuse", "skip", "replace"}
        What is done about results that exist already.
    dry : bool
        Whether nothing is made or removed.
    check : callable, optional
        Receives the jobs before anything is made.

    Returns
    -------
    list of Job
        In the order of the inputs. A job has its own problem, if there is one.

    Raises
    ------
    PlanError
        If two outputs would be the same file, or several photos have one file to go to.
    PhotoError
        For the reasons of `find_photos`.
    OutputError
        If a folder for the outputs is missing and cannot be made.

    """
    extras, needs = extras or {}, needs or {}
    several = len(inputs) > 1 or inputs[0].is_dir()
    _check_places(output, extras, several=several)
    into = output is not None and (into or several or output.is_dir())
    tops = [extra.path for extra in extras.values() if extra.path and extra.name]
    if template is not None:
        tops.insert(0, template.top)
    elif output is not None and into:
        tops.insert(0, output)
    own = [top for top in tops if identity(top) not in [identity(path) for path in inputs]]

    def place(photo: InputPhoto) -> Path | None:
        source = photo.path
        if template is not None:
            return template.place(photo)
        if output is None:
            return source.with_name(name(source)) if beside else None
        return output / photo.below / name(source) if into else output

    jobs = [
        _job(photo, place, extras, needs, existing)
        for photo in find_photos(inputs, recursive=recursive, without=own)
    ]
    if template is not None:
        jobs = _without_results(jobs, inputs)
    _check_collisions(jobs, "add more fields to the name" if template else None)
    if check is not None:
        check(jobs)
    jobs = [_staying(job, tops) for job in jobs]
    if dry:
        for top in tops:
            check_folder(top)
    else:
        _prepare_folders(tops, jobs)
    inputs_by_identity = {
        mark: path
        for job in jobs
        for path in (job.source, *job.needs.values())
        if (mark := identity(path))
    }
    return [_checked(job, inputs_by_identity, tops if dry else []) for job in jobs]


def _job(
    photo: InputPhoto,
    place: Callable[[InputPhoto], Path | None],
    extras: Mapping[str, Extra],
    needs: Mapping[str, Callable[[InputPhoto], Path | None]],
    existing: Existing,
) -> Job:
    """Return the job of a photo, with a problem if its names are wrong."""
    try:
        result = place(photo)
    except DeshakeError as error:
        return Job(photo.path, None, problem=error, existing=existing)
    others = {kind: extra.place(photo, result) for kind, extra in extras.items()}
    given: dict[str, Path] = {}
    problem: DeshakeError | None = None
    for kind, find in needs.items():
        try:
            path = find(photo)
        except DeshakeError as error:
            problem = error
        else:
            given |= {} if path is None else {kind: path}
    return Job(photo.path, result, others, given, problem, existing=existing)


def _check_places(output: Path | None, extras: Mapping[str, Extra], *, several: bool) -> None:
    """Refuse one file for the results of several photos."""
    if not several:
        return
    files = {"-o": output}
    files |= {f"--{kind}": extra.path for kind, extra in extras.items() if extra.name is None}
    for option, path in files.items():
        if path is not None and str(path) == STREAM:
            raise PlanError(
                f"several results cannot go to standard output: name a folder with {option}"
            )
        if path is not None and path.exists() and not path.is_dir():
            raise PlanError(f"{path} is a file; for several photos, {option} names a folder")


def _without_results(jobs: Sequence[Job], named: Sequence[Path]) -> list[Job]:
    """Leave out jobs whose photos are results of other jobs, unless the user named the photos."""
    made = {mark: job for job in jobs if job.output and (mark := identity(job.output))}

    def is_result(job: Job) -> bool:
        other = made.get(identity(job.source) or (0, 0), job)
        return other is not job and read_provenance(job.source) is not None

    return [job for job in jobs if job.source in named or not is_result(job)]


def _check_collisions(jobs: Sequence[Job], hint: str | None = None) -> None:
    """Refuse two outputs of one name."""
    taken: dict[str, Job] = {}
    folders: dict[Path, str] = {}
    for job in jobs:
        for path in job.outputs:
            if path.parent not in folders:
                folders[path.parent] = os.path.realpath(path.parent)  # also of links in circles
            # A symbolic link is replaced, not followed: its folder counts, and its own name.
            key = os.path.normcase(os.path.join(folders[path.parent], path.name))  # noqa: PTH118
            other = taken.setdefault(key, job)
            if other is not job:
                raise PlanError(
                    f"{other.source} and {job.source} would both be written to {path}",
                    hint=hint or "name each photo once, or run them one by one",
                )


def _staying(job: Job, tops: Sequence[Path]) -> Job:
    """Return a job, with a problem if a link leads an output out of its folder.

    The folder itself may be a link: the user named it.
    """
    for path in job.outputs:
        above = [top for top in tops if path.parent.is_relative_to(top)]
        top = max(above, key=lambda top: len(top.parts), default=None)
        if top is None or job.problem is not None:
            continue
        real = os.path.realpath(path.parent)
        if os.path.commonpath([real, os.path.realpath(top)]) != os.path.realpath(top):
            problem = OutputError(
                f"lies behind a link that leads out of {top}, to {real}",
                hint="remove the link, or name that folder with -o",
                file=path.parent,
            )
            return replace(job, problem=problem)
    return job


def _prepare_folders(tops: Sequence[Path], jobs: Sequence[Job]) -> None:
    """Make the folders that are missing; remove from the others what killed runs left."""
    for top in tops:
        make_folder(top)
    good = [job for job in jobs if job.problem is None]
    outputs = [path for job in good for path in job.outputs if str(path) != STREAM]
    for folder in dict.fromkeys(path.parent for path in outputs):
        if any(folder.is_relative_to(top) for top in tops):
            make_folder(folder, parents=True)
        remove_stale_parts(folder)


def _checked(job: Job, inputs: Mapping[tuple[int, int], Path], to_be_made: Sequence[Path]) -> Job:
    """Return a job, with a problem if its outputs are wrong; some folders are made only later."""
    if job.problem is not None:
        return job
    for path in job.outputs:
        folder = path.parent
        if not folder.exists() and any(folder.is_relative_to(top) for top in to_be_made):
            continue
        try:
            other = inputs.get(identity(path) or (0, 0), job.source)
            check_output(path, job.source, other, overwrite=job.overwrite_others)
        except DeshakeError as error:
            return replace(job, problem=error)
    return job
