"""Camera paths that are found by the spectra of the photo alone, without any sharp picture.

A candidate's first latent picture may mislead it, and then all its kernels are wrong. The match
with the spectra (`spectral_match`) needs no latent picture, and it changes smoothly with the path
of the camera. So random smooth paths are drawn at a coarse scale. Those that match best descend,
and the best distinct ends are carried to the next finer scale. There they compete with new random
paths, because each scale resolves the shakes that are some pixels wide there.

The spectra cannot tell a path from its reflection. So both take part in the race.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from deshake.blind.agreement import agreement
from deshake.blind.camera_path import SmoothPath
from deshake.blind.entry import Entry
from deshake.blind.settings import SETTINGS
from deshake.blind.spectral_match import SpectralMatch, descended
from deshake.operators.strips import in_order
from deshake.signal.pyramid import RATIO

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from deshake.blind.candidate import Axes
    from deshake.blind.kernel_comparison import Comparison
    from deshake.blind.settings import PathScales
    from deshake.run import Run
    from deshake.signal.pyramid import Pyramid

__all__ = ["spectral_entries", "spectral_starts"]

Points = NDArray[np.float64]

_S: Final = SETTINGS.spectral_start
_SEED: Final = 0


def spectral_starts(
    pyramid: Pyramid, axes: Axes, run: Run, scales: PathScales = _S.usual
) -> list[tuple[int, SmoothPath]]:
    """Find the paths that match the spectra best, at several scales.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    axes : three bools
        The axes that the camera may turn about.
    run : Run
        Threads to use.
    scales : PathScales
        The scales, the tiles, and the widths of the paths.

    Returns
    -------
    list of (level, path)
        The scale of each path, and the path on the grid of that scale. At each scale the paths are
        distinct, and the best comes first.

    """
    rng = np.random.default_rng(_SEED)
    found: list[tuple[int, SmoothPath]] = []
    carried: list[SmoothPath] = []
    levels = [n for n in range(pyramid.coarsest + 1) if _is_wanted(pyramid, n, scales)]
    for level in levels[:: -scales.every]:
        spectra = SpectralMatch(pyramid, level, "fitted", scales.tiles)
        if len(spectra.centres) < scales.fewest:
            continue
        drawn = [_random_path(rng, spectra, axes, scales) for _ in range(_S.paths)]
        values = [value for _, value in in_order(spectra.of_path, drawn, run)]
        first = [drawn[n] for n in np.argsort(values, kind="stable")[: -_S.first - 1 : -1]]
        first += [path.on_scale(spectra.camera) for path in carried]
        second = _descended(spectra, first, _S.first_iterations, run)[: _S.second]
        carried = _descended(spectra, second, _S.second_iterations, run)
        found += [(level, path) for path in carried]
    return found


def spectral_entries(
    comparison: Comparison,
    axes: Axes,
    bound: float | None,
    run: Run,
    scales: PathScales,
    *,
    first: int,
) -> list[Entry]:
    """Return the kernels of distinct paths that match the spectra best, for the race.

    Parameters
    ----------
    comparison : Comparison
        The comparison of the race, which measures the match.
    axes : three bools
        The axes that the camera may turn about.
    bound : float, optional
        Pixels of the photo: no kernel is wider.
    run : Run
        Threads to use.
    scales : PathScales
        The scales, the tiles, and the widths of the paths.
    first : int
        Number of the first start; the others count downwards.

    Returns
    -------
    list of Entry
        The best kernel first. Each is followed by its reflection.

    """
    paths = spectral_starts(comparison.pyramid, axes, run, scales)
    found = [one for one in _numbered(comparison, paths, first) if one[0].keeps(bound)]
    matches = comparison.matches([entry for entry, _ in found])
    taken: list[Entry] = []
    for n in np.argsort(-matches, kind="stable"):
        entry, path = found[n]
        if all(agreement(entry.kernel, known.kernel) < _S.alike for known in taken):
            reflected = entry._replace(
                name=f"{entry.name}, reflected",
                start=entry.start - 1,
                kernel=path.reflected.kernel(comparison.pyramid.camera),
            )
            taken += [entry, reflected]
        if len(taken) == 2 * _S.most:
            break
    return taken


def _numbered(
    comparison: Comparison, paths: Sequence[tuple[int, SmoothPath]], first: int
) -> Iterator[tuple[Entry, SmoothPath]]:
    """Make entries of paths, with numbers that leave room for their reflections."""
    for n, (level, path) in enumerate(paths):
        kernel = path.kernel(comparison.pyramid.camera)
        name = f"spectral start {n}, scale {level}"
        yield comparison.suited(Entry(name, first - 2 * n, level, kernel)), path


def _is_wanted(pyramid: Pyramid, level: int, scales: PathScales) -> bool:
    """Return whether a frame of this scale has the wanted size."""
    least, largest = scales.sides
    return least <= min(pyramid.camera.shape) / RATIO**level <= largest


def _descended(
    spectra: SpectralMatch, paths: Sequence[SmoothPath], iterations: int, run: Run
) -> list[SmoothPath]:
    """Descend from every path; return the distinct ends, the best first."""
    ends = [
        end for _, end in in_order(lambda path: descended([spectra], path, iterations), paths, run)
    ]
    kept: list[SmoothPath] = []
    for _, path in sorted(ends, key=lambda end: -end[0]):
        if all(_distance(spectra, path, known) > _S.unlike for known in kept):
            kept.append(path)
    return kept


def _random_path(
    rng: np.random.Generator, spectra: SpectralMatch, axes: Axes, scales: PathScales
) -> SmoothPath:
    """Draw a path: its direction changes slowly, its speed fast, and it may rest."""
    kept = rng.uniform(*_S.turns)
    shape = SETTINGS.camera_path.fewest_controls, len(axes)
    steps = rng.normal(size=shape)
    for n in range(1, len(steps)):
        steps[n] = kept * steps[n - 1] + np.sqrt(1 - kept**2) * steps[n]
    steps *= np.exp(_S.rests * rng.normal(size=(shape[0], 1)))
    controls = np.cumsum(steps, 0) * axes
    controls[:, 2] *= rng.choice(_S.rolls)
    path = SmoothPath(controls - controls.mean(0), spectra.camera)
    width = np.linalg.norm(np.ptp(spectra.tracks(path, _S.times), axis=1), axis=1).mean()
    return path._replace(controls=path.controls * (rng.uniform(*scales.widths) / width))


def _distance(spectra: SpectralMatch, one: SmoothPath, other: SmoothPath) -> float:
    """Return the distance of two paths; a path is the same reflected, or backwards in time."""
    first, second = (spectra.tracks(path, _S.times) for path in (one, other))
    ways = [sign * second[:, ::step] for sign in (1, -1) for step in (1, -1)]
    return min(float(np.sqrt(np.square(first - way).sum(2).mean())) for way in ways)
