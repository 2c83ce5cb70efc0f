"""Fix photos at the defaults, and show the results on one sheet.

    python scripts/contact_sheet.py shaken/ another.jpg -o sheet.png
    python scripts/contact_sheet.py shaken/ -o sheet.png --jobs 2 --keep results

Each photo has a line: the photo, the result, the kernel's rotations, and a part with much detail at
100 %, before and after. The text above has its name, its size, the seconds, the estimator of the
kernel, the confidence and the extent, then the notes. A photo that fails has its error there.
"""

from __future__ import annotations

import sys
import textwrap
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING

from bench.arguments import add_jobs, at_least
from bench.program import check_sheet_name, explained, guarded, use_one_thread

from deshake.batch.folders import find_photos
from deshake.errors import DeshakeError, OutputError
from deshake.files.disk import check_output
from deshake.files.kernel_file import write_kernel
from deshake.formats.photo import read_photo
from deshake.formats.photo_writing import write_photo
from deshake.pictures.comparison import before_and_after
from deshake.pictures.sheets import CHARACTER, GAP, Row, sheet
from deshake.run import Run
from deshake.stages.blind_estimate import estimate_blind
from deshake.stages.deblurring import deblur
from deshake.stages.estimate_options import EstimateOptions
from deshake.stages.estimating import kernel_name

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from deshake.formats.photo import Photo
    from deshake.stages.estimate_result import Estimate

WIDTH = 480
LEAST_WIDTH = 120


def caption(photo: Photo, blind_estimate: Estimate, seconds: float, columns: int) -> list[str]:
    """Describe a photo and its estimate, in lines of so many characters."""
    facts = blind_estimate.report()
    text = (
        f"{photo.source.name}   {photo.shape[1]} x {photo.shape[0]}   {seconds:.0f} s"
        f"   {blind_estimate.content.provenance['estimated_by']}"
        f"   confidence {facts['confidence']:.2f}"
        f"   extent {facts['extent_px']:.1f} px, {facts['rotations']} rotations"
    )
    return [text, *(line for note in blind_estimate.notes for line in textwrap.wrap(note, columns))]


def keep(folder: Path, blind_estimate: Estimate, result: Photo) -> None:
    """Keep the result as PNG, and its kernel."""
    source = result.source
    write_photo(folder / f"{source.stem}.deshaken.png", result, overwrite=True)
    write_kernel(folder / kernel_name(source), blind_estimate.content, overwrite=True)


def fixed(source: Path, width: int, folder: Path | None) -> Row:
    """Fix one photo as `deshake fix` does, and lay out its line."""
    columns = int((5 * width + 4 * GAP) / CHARACTER)
    start = time.perf_counter()
    try:
        photo = read_photo(source)
        blind_estimate = estimate_blind(photo, EstimateOptions(), run=Run(1))
        result = deblur(photo, blind_estimate.content.kernel, run=Run(1)).photo
        seconds = time.perf_counter() - start
        if folder is not None:
            keep(folder, blind_estimate, result)
    except DeshakeError as error:
        text = f"{source.name}   failed: {error.message}"
        return Row(textwrap.wrap(text, columns), [], failed=True)
    cells = before_and_after(photo, result, blind_estimate.content.kernel, width)
    return Row(caption(photo, blind_estimate, seconds, columns), cells)


def checked(photos: Sequence[Path], output: Path, folder: Path | None) -> list[Path]:
    """Check what can be checked before the work, and list the photos."""
    check_sheet_name(output)
    paths = [paths.path for paths in find_photos(photos)]
    for source in paths:
        check_output(output, source, overwrite=True)
    if folder is not None:
        if len({source.stem for source in paths}) < len(paths):
            raise OutputError("two photos have one name", hint="leave out --keep", file=folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise OutputError(f"the folder cannot be made: {reason}", file=folder) from error
    return paths


def run(args: argparse.Namespace) -> int:
    """Fix the photos and draw the sheet."""
    photos = checked(args.photos, args.output, args.keep)
    lines = []
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        for line in pool.map(partial(fixed, width=args.width, folder=args.keep), photos):
            print(line.caption[0], flush=True)
            lines.append(line)
    sheet(lines, 5 * args.width + 6 * GAP).save(args.output)
    return int(any(line.failed for line in lines))


def main(argv: Sequence[str] | None = None) -> int:
    """Read the command line, and run."""
    parser = explained(__doc__)
    parser.add_argument("photos", nargs="+", type=Path, metavar="PHOTO", help="or a folder of them")
    parser.add_argument("-o", "--output", type=Path, required=True, help="the sheet, PNG or JPEG")
    parser.add_argument(
        "--width",
        type=partial(at_least, LEAST_WIDTH),
        default=WIDTH,
        help=f"of each picture on the sheet, in pixels; default: {WIDTH}",
    )
    add_jobs(parser, 1, "photos")
    parser.add_argument("--keep", type=Path, help="folder for the results and their kernels")
    args = parser.parse_args(argv)
    use_one_thread()  # before the processes that do the work load their libraries
    return guarded(partial(run, args))


if __name__ == "__main__":
    sys.exit(main())
