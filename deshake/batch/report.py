"""The report of a run: collected a photo at a time, and written as one page at the end.

The part of the page about each photo is kept in a temporary file until the end. So a report of
hundreds of photos takes no more memory than a report of one.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final, Self
from urllib.parse import quote

from deshake.batch.verdict import UNSHAKEN, confidence_words, summary_words
from deshake.errors import OutputError
from deshake.files.disk import STREAM, atomic_write, check_output, write_bytes
from deshake.pictures.report_page import Entry, article, embedded, page_head, page_tail
from deshake.pictures.report_pictures import room_for

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from deshake.batch.plan import Job
    from deshake.batch.task import Result
    from deshake.pictures.report_pictures import Encoded

__all__ = ["Report", "ReportPlace"]

_NAME: Final = "report.html"
_SUFFIXES: Final = {".html", ".htm"}
# By this ending, a later run in the same folder recognises that these pictures are no photos.
_PICTURE: Final = re.compile(r"\d+-[a-z-]+-[0-9a-f]{16}\.deshaken\.(jpg|png)")
_HINT: Final = "choose another place with --report"


@dataclass(frozen=True)
class ReportPlace:
    """Where a report goes.

    Parameters
    ----------
    path : Path
        The page, whose name ends in .html, or a folder for a page called report.html.
    beside : bool
        Whether the pictures are files in a folder beside the page, not embedded in it.
    overwrite : bool
        Whether an existing page may be replaced.

    """

    path: Path
    beside: bool = False
    overwrite: bool = False

    @property
    def page(self) -> Path:
        """The page."""
        named = self.path.suffix.lower() in _SUFFIXES and not self.path.is_dir()
        return self.path if named else self.path / _NAME

    @property
    def pictures(self) -> Path:
        """The folder of pictures beside the page."""
        return self.page.with_name(f"{self.page.stem}-pictures")

    def room(self, photos: int) -> int:
        """Return how many bytes the pictures of one photo may take, for so many photos."""
        return room_for(photos, beside=self.beside)

    def check(self, jobs: Sequence[Job], *, dry: bool = False) -> None:
        """Check that the report can be written, before any work; unless `dry`, make its folder.

        Raises
        ------
        OutputError
            If the page exists and may not be replaced, is a photo or an output of the run, or lies
            in a folder that is missing or not writable.

        """
        page = self.page
        if page != self.path and not self.path.exists() and self.path.parent.is_dir():
            if self.path.is_symlink():  # that leads nowhere
                raise OutputError("is not a folder", hint=_HINT, file=self.path)
            if dry:
                return
            try:
                self.path.mkdir()
            except OSError as error:
                reason = (error.strerror or str(error)).lower()
                raise OutputError(
                    f"the folder cannot be made: {reason}", hint=_HINT, file=self.path
                ) from error
        taken = [
            path
            for job in jobs
            for path in (job.source, *job.needs.values(), *job.outputs)
            if str(path) != STREAM
        ]
        if any(_one_file(page, path) for path in taken):
            raise OutputError("is a photo or an output of this run", hint=_HINT, file=page)
        if self.beside and self.pictures.exists() and not self.pictures.is_dir():
            raise OutputError("is not a folder", hint=_HINT, file=self.pictures)
        try:
            check_output(page, overwrite=self.overwrite)
        except OutputError as error:
            replaceable = error.hint is not None and "--overwrite" in error.hint
            error.hint = _HINT + replaceable * ", or allow replacing it with --overwrite"
            raise


class Report:
    """A report during the run, as a context manager; without the page, no pictures are left.

    Parameters
    ----------
    place : ReportPlace
        Where it goes.
    jobs : sequence of Job
        All photos, in the order of the page.
    command : str
        The command of the run.
    command_of : callable
        Returns the command that makes the result of one job again.

    """

    def __init__(
        self,
        place: ReportPlace,
        jobs: Sequence[Job],
        command: str,
        command_of: Callable[[Job], str],
    ) -> None:
        self._place = place
        self._command = command
        self._command_of = command_of
        self._labels = _labels([job.source for job in jobs])
        self._numbers = {job.source: number for number, job in enumerate(jobs, 1)}
        self._entries: dict[int, Entry] = {}
        self._spans: dict[int, tuple[int, int]] = {}
        self._made: list[Path] = []
        self._used: set[str] = set()
        self._shown: list[Path] = []
        self._waiting: IO[bytes] | None = None

    def __enter__(self) -> Self:
        self._waiting = tempfile.TemporaryFile(dir=self._place.page.parent)
        return self

    def __exit__(self, *_: object) -> None:
        if self._waiting is not None:
            self._waiting.close()
        for path in self._made:  # a page that was not written leaves no pictures
            path.unlink(missing_ok=True)
        if self._made:
            with contextlib.suppress(OSError):
                self._place.pictures.rmdir()

    def add(self, result: Result) -> None:
        """Add the result of a photo.

        Raises
        ------
        OutputError
            If there is no room for it on the disk.

        """
        assert self._waiting is not None  # noqa: S101 - within the context
        number = self._numbers[result.job.source]
        entry = self._entry(number, result)

        photos = [result.job.source, *filter(None, [result.job.needs.get("noisy")])]
        if result.pictures:
            self._shown += photos

        def beside(name: str, picture: Encoded) -> str:
            return self._put_beside(f"{number:04}-{name}", picture, photos)

        text = article(entry, result.pictures, beside if self._place.beside else embedded)
        start = self._waiting.tell()
        try:
            self._waiting.write(text.encode("utf-8"))
        except OSError as error:
            raise OutputError(
                f"cannot be written: {(error.strerror or str(error)).lower()}",
                hint="free some space, or write elsewhere with --report",
                file=self._place.page,
            ) from error
        self._entries[number] = entry
        self._spans[number] = start, self._waiting.tell()

    def write(self) -> Path:
        """Write the page, and return it.

        Raises
        ------
        OutputError
            If it cannot be written.

        """
        assert self._waiting is not None  # noqa: S101 - within the context
        numbers = sorted(self._entries)
        page = self._place.page
        overwrite = self._place.overwrite
        with atomic_write(page, overwrite=overwrite, made_from=self._shown) as stream:
            entries = [self._entries[number] for number in numbers]
            stream.write(page_head(entries, self._command).encode("utf-8"))
            for number in numbers:
                start, end = self._spans[number]
                self._waiting.seek(start)
                stream.write(self._waiting.read(end - start))
            stream.write(page_tail().encode("utf-8"))
        self._made.clear()
        self._remove_old_pictures()
        return page

    def _entry(self, number: int, result: Result) -> Entry:
        """Return the entry of the page for a photo."""
        figures, job = result.figures, result.job
        name, command = self._labels[job.source], self._command_of(job)
        if result.status == "failed":
            why = (result.error or "").removeprefix(f"{job.source}: ")
            return Entry(
                number,
                name,
                "failed",
                why,
                command,
                result.seconds,
                warnings=result.warnings,
                hint=result.hint,
            )
        output = None if job.output is None else (str(job.output), self._address(job.output))
        if figures.get("verdict") == UNSHAKEN:
            return Entry(number, name, UNSHAKEN, figures["reason"], command, result.seconds)
        if result.status == "skipped":
            why = "its result exists already"
            return Entry(number, name, "skipped", why, command, result.seconds, output)
        left = figures["verdict"] == "left"
        return Entry(
            number,
            name,
            figures["verdict"],
            figures["reason"] if left else summary_words(figures),
            command,
            result.seconds,
            output,
            None if left else figures["extent_px"],
            None if left else figures["confidence"],
            confidence_words(figures["confidence"]),
            result.warnings,
        )

    def _address(self, path: Path) -> str:
        """Return the address of a file relative to the page."""
        try:
            relative = os.path.relpath(path, self._place.page.parent)
        except ValueError:  # on another drive
            return path.absolute().as_uri()
        return quote(os.fsencode(Path(relative).as_posix()))

    def _put_beside(self, name: str, picture: Encoded, photos: Sequence[Path]) -> str:
        """Write a picture of photos beside the page, and return its address.

        The name has a digest of the picture. So no picture of an earlier page is replaced by a
        different one.
        """
        digest = hashlib.sha256(picture.data).hexdigest()[:16]
        path = self._place.pictures / f"{name}-{digest}.deshaken.{picture.ending}"
        try:
            path.parent.mkdir(exist_ok=True)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise OutputError(
                f"the folder cannot be made: {reason}", hint=_HINT, file=path.parent
            ) from error
        if not path.exists():
            write_bytes(path, picture.data, made_from=photos)
            self._made.append(path)
        self._used.add(path.name)
        return self._address(path)

    def _remove_old_pictures(self) -> None:
        """Remove the pictures of the page that was replaced."""
        if not self._place.overwrite or not self._place.pictures.is_dir():
            return
        for path in self._place.pictures.iterdir():
            if _PICTURE.fullmatch(path.name) and path.name not in self._used:
                path.unlink(missing_ok=True)
        if not self._used:
            with contextlib.suppress(OSError):
                self._place.pictures.rmdir()


def _labels(photos: Sequence[Path]) -> dict[Path, str]:
    """Return short names of photos: relative to the folder that has them all."""
    if len(photos) == 1:
        return {photos[0]: photos[0].name}
    try:
        common = os.path.commonpath([path.parent for path in photos])
    except ValueError:  # absolute and relative ones, or several drives
        return {path: str(path) for path in photos}
    return {path: os.path.relpath(path, common or os.curdir) for path in photos}


def _one_file(one: Path, other: Path) -> bool:
    """Whether two names mean one file."""
    if os.path.realpath(one) == os.path.realpath(other):
        return True
    return one.exists() and other.exists() and one.samefile(other)
