"""The comparison of the kernels in a race, on tiles that no kernel was fitted to.

Each kernel is judged at the scale that resolves it well, whatever the width of the others. At a
coarser scale right and wrong kernels differ little; at a finer one a wide kernel is a thin line
that only few tiles can hold. Three measures always count. The first is the judge's margin. It
differs little between right and wrong kernels if the photo has fine texture or a nonlinear tone
curve. The second is how much sparser the gradients of the restored picture are. The third needs no
restored picture: how well the spectra of the photo match the kernel.
"""

from __future__ import annotations

from functools import cached_property
from threading import Lock
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from deshake.blind.agreement import agreement
from deshake.blind.judge import Judge, mean_margin
from deshake.blind.kernel_faults import is_filled
from deshake.blind.narrowing import narrower, narrowest
from deshake.blind.path_search import searched
from deshake.blind.path_worth import PathWorth
from deshake.blind.settings import SETTINGS, SpectrumTiles
from deshake.blind.spectral_match import SpectralMatch, mean_match, traced
from deshake.blind.spot import is_spot
from deshake.operators.strips import in_order
from deshake.run import Run
from deshake.signal.pyramid import RATIO

if TYPE_CHECKING:
    from collections.abc import Sequence

    from deshake.blind.entry import Entry
    from deshake.blind.tile_plan import Part
    from deshake.geometry.kernel import RotationKernel
    from deshake.signal.pyramid import Pyramid

__all__ = ["Comparison"]

Scores = NDArray[np.float64]

_S: Final = SETTINGS.kernel_comparison


class Comparison:
    """Scores of kernels for one photo; a higher one is better.

    A scale has one judge for all kernels that it has room for, so that their scores compare.

    Parameters
    ----------
    pyramid : Pyramid
        The photo.
    run : Run, optional
        Threads to use. The scores do not depend on them.

    """

    def __init__(self, pyramid: Pyramid, run: Run = Run()) -> None:
        self.pyramid = pyramid
        self.run = run
        self._judges: dict[int, Judge] = {}
        self._spectra: dict[tuple[int, Part, int], SpectralMatch] = {}
        self._making = Lock()
        self._matches: dict[tuple[RotationKernel, int], float] = {}
        self._paths: dict[RotationKernel, RotationKernel] = {}
        self._scores: dict[tuple[Judge, RotationKernel], float] = {}
        self._batches: dict[tuple[RotationKernel, int], list[Judge]] = {}

    def zoomed(self, ratio: float) -> Comparison:
        """Return the comparison for a focal length `ratio` times as long."""
        return Comparison(self.pyramid.zoomed(ratio), self.run)

    def scores(self, entries: Sequence[Entry]) -> Scores:
        """Return the scores of kernels; a kernel that cannot be right gets a penalty."""
        levels = [self.level(entry) for entry in entries]
        by_level: dict[int, list[Entry]] = {}
        for entry, level in zip(entries, levels, strict=True):
            by_level.setdefault(level, []).append(entry)
        for level, group in by_level.items():
            self._make_room(level, group)
        scores = self.scores_by(
            [(entry, self._judges[level]) for entry, level in zip(entries, levels, strict=True)]
        )
        return scores - _S.penalty * np.array([self.hopeless(entry) for entry in entries])

    def scores_by(self, pairs: Sequence[tuple[Entry, Judge]]) -> Scores:
        """Return the scores of kernels, each at its judge's scale; none is penalised."""
        new = {(judge, entry.kernel): (entry, judge) for entry, judge in pairs}
        waiting = [pair for key, pair in new.items() if key not in self._scores]
        for (entry, judge), score in in_order(lambda pair: self._score(*pair), waiting, self.run):
            self._scores[judge, entry.kernel] = score
        return np.array([self._scores[judge, entry.kernel] for entry, judge in pairs])

    def scores_at(self, level: int, entries: Sequence[Entry]) -> Scores:
        """Return the scores of kernels, all at one scale; none is penalised."""
        self._make_room(level, entries)
        return self.scores_by([(entry, self._judges[level]) for entry in entries])

    def hopeless(self, entry: Entry) -> bool:
        """Return whether a kernel is a small round spot, or far too wide for the photo."""
        widest = _S.widest * min(self.pyramid.camera.shape)
        return is_spot(entry.kernel) or entry.kernel.extent_px() > widest

    def is_wide(self, entry: Entry) -> bool:
        """Return whether a kernel is so wide that its scale has too few tiles for a match."""
        return self.level(entry) > self._last_matched

    def is_much_wider(self, wide: Entry, narrow: Entry) -> bool:
        """Return whether a kernel is about twice as wide as another, or wider."""
        return self.level(wide) >= self.level(narrow) + _S.coarser

    def judge(self, entry: Entry) -> Judge:
        """Return the judge at the scale of a kernel."""
        level = self.level(entry)
        self._make_room(level, [entry])
        return self._judges[level]

    def foremost(self, ranked: Sequence[Entry]) -> list[Entry]:
        """Move the best kernel to the front, where pairs are compared at one scale.

        Scores of different scales cannot be compared: at a fine scale, a fragment of a wide kernel
        may score higher than the whole kernel does at its own, coarser scale. So a kernel that is
        about twice as wide as another is better if it matches better and scores higher at its own
        scale.

        Parameters
        ----------
        ranked : sequence of Entry
            Kernels, those of the highest scores first.

        Returns
        -------
        list of Entry
            The same kernels, the best first.

        """
        best = 0
        for n in range(1, len(ranked)):
            if self._exceeds(ranked[n], ranked[best]):
                best = n
        return [*ranked[best : best + 1], *ranked[:best], *ranked[best + 1 :]]

    def _exceeds(self, wide: Entry, narrow: Entry) -> bool:
        """Return whether a kernel is much wider than another, and better at its scale."""
        level = self.level(wide)
        if not self.is_much_wider(wide, narrow) or self.hopeless(wide):
            return False
        if self.match(wide) <= self.match(narrow, level):
            return False
        one, other = self.scores_at(level, [wide, narrow])
        return bool(one > other)

    def _score(self, entry: Entry, judge: Judge) -> float:
        score = entry.margin(judge) + _S.sharpening_worth * judge.sharpening(entry.kernel)
        return score + _S.match_worth * self.match_share * self.match(entry, judge.level)

    @cached_property
    def match_share(self) -> float:
        """How much a match counts: less if the frame holds few tiles, three at least."""
        tiles = SETTINGS.spectral_match.tiles
        held = np.prod(self.pyramid.camera.shape) / tiles.size**2
        held = np.clip(held, _S.fewest_tiles, tiles.count)
        return float((1 + _S.scarce / tiles.count) / (1 + _S.scarce / held))

    def matches(self, entries: Sequence[Entry]) -> Scores:
        """Return the matches of kernels."""
        return np.array([match for _, match in in_order(self.match, entries, self.run)])

    def match(self, entry: Entry, level: int | None = None) -> float:
        """Return the match of a kernel, -1..1, on tiles that no kernel was fitted to.

        It is the mean over the scale of the kernel and the scales next to it. At finer scales the
        kernel is wider, and so are the tiles. Coarser scales with too few tiles do not count: on a
        single tile, a wrong kernel can match by chance. `level` is another scale in place of that
        of the kernel.
        """
        key = entry.kernel, self.level(entry) if level is None else level
        if key not in self._matches:
            self._matches[key] = self._match(*key)
        return self._matches[key]

    def zoomed_matches(self, entry: Entry, ratios: Scores) -> Scores:
        """Return the matches of a kernel for focal lengths `ratios` times as long."""
        level = min(self.level(entry), self._last_matched)  # wide tiles do not show the zoom
        return np.array([self._match(entry.kernel.zoomed(ratio), level) for ratio in ratios])

    def _match(self, kernel: RotationKernel, level: int) -> float:
        """Return the mean match of a kernel at a scale and the scales next to it.

        If the scale has too few tiles, finer ones take its place. The kernel is wide there, and so
        are the tiles.
        """
        return mean_match(self._matching(level), kernel)

    def _matching(self, level: int) -> list[SpectralMatch]:
        """Return the spectra of a scale and of the scales next to it, or of finer ones."""
        middle = min(level, self._last_matched)
        last = min(middle + _S.neighbours, self._last_matched)
        return [
            self._spectra_at(n, "apart", level - n if level > middle else 0)
            for n in range(max(middle - _S.neighbours, 0), last + 1)
        ]

    def matched(self, entry: Entry) -> Entry:
        """Draw a smooth path through a kernel, and fit it to the spectra of the photo."""
        if entry.kernel not in self._paths:
            spectra = self._spectra_at(self.level(entry), "fitted")
            self._paths[entry.kernel] = spectra.fitted(entry.kernel)
        return entry._replace(name=f"{entry.name}, path", kernel=self._paths[entry.kernel])

    def traced(self, entry: Entry) -> list[Entry]:
        """Draw smooth paths closely along a kernel, and fit them to the spectra of some scales.

        There are none at the size of the photo, which has no finer scales. There are none for a
        kernel that is wide for the frame, either: its tiles cover most of the frame, and a wrong
        path that is fitted to them matches the others, too.
        """
        level = self.level(entry)
        if level == 0 or self.is_wide(entry):
            return []
        name = f"{entry.name}, traced"
        paths = traced(self._finer_spectra(level), entry.kernel, self.run)
        return [entry._replace(name=name, kernel=path) for path in paths]

    def searched(self, entry: Entry, run: Run) -> Entry:
        """Search for a smooth path along a kernel that is better; else return the kernel.

        The search leaves out the sparsity, which prefers a kernel that is too wide where the photo
        is out of focus. The margin counts on many tiles: paths that are near each other are
        compared on a few of them at once, and on others in the next generation. There the match
        changes in proportion to the path. The search fits the path to its own measure, so a gain
        there may be no gain at all: the score and the margin at a finer scale count as much. There
        is no search for a kernel that is wide for the frame, nor for one of a few pixels.

        Parameters
        ----------
        entry : Entry
            The kernel.
        run : Run
            Threads to use, and who receives the progress.

        """
        if self.is_wide(entry) or entry.width < _S.narrowest:
            return entry
        level, kernel = self.level(entry), entry.kernel
        worth = self._path_worth(level, kernel, run)
        own = worth.of(kernel)
        found = searched(
            kernel,
            self._finer_spectra(level),
            worth=worth.of,
            around=worth.around,
            least=own - _S.vain,
            run=run,
        )
        if found is None:
            return entry
        path = entry._replace(name=f"{entry.name}, path", kernel=found)
        if self.hopeless(path):
            return entry
        before, after = self.scores_at(level, [entry, path])
        gain = worth.of(found) - own + after - before + self._finer_gain(entry, found)
        return path if gain > _S.gain else entry

    def narrowed(self, entry: Entry, run: Run) -> Entry:
        """Return the narrowest kernel that explains the photo about as well as the given one.

        Worth and score count, as in the search for a path. A kernel that is wide for the frame
        stays as it is, and so does a disk, which is no path.
        """
        if self.is_wide(entry) or is_filled(entry.kernel):
            return entry
        name = f"{entry.name}, narrower"
        others = [entry._replace(name=name, kernel=kernel) for kernel in narrower(entry.kernel)]
        entries = [entry, *(other for other in others if not self.hopeless(other))]
        if len(entries) == 1:
            return entry
        level = self.level(entry)
        worth = self._path_worth(level, entry.kernel, run)
        values = [value for _, value in in_order(lambda one: worth.of(one.kernel), entries, run)]
        return entries[narrowest(self.scores_at(level, entries) + values)]

    def _path_worth(self, level: int, kernel: RotationKernel, run: Run) -> PathWorth:
        """Return the worth of the paths along a kernel, at a scale."""
        return PathWorth(
            self._batches_at(level, kernel),
            self._matching(level),
            _S.search_match_worth * self.match_share,
            kernel.camera,
            run,
        )

    def _finer_gain(self, entry: Entry, other: RotationKernel) -> float:
        """Return how much the margin of a kernel exceeds that of an entry at a finer scale.

        It is that of many tiles.
        """
        judges = self._finer_batches(entry)
        if not judges[0].has_room(other):  # all have the same room
            return -_S.penalty
        return mean_margin(judges, other) - mean_margin(judges, entry.kernel)

    def lead(self, entry: Entry) -> float | None:
        """Return how much the photo has the direction of a kernel.

        It is the gain over the same kernel turned, for turned kernels that are as unlike as usual.
        A nearly round kernel hardly changes if it is turned. So there a small gain says as much. It
        is None for a disk.
        """
        gain, kernel = self.gain_over_turned(entry), entry.kernel
        if gain is None:
            return None
        alike = np.mean([agreement(kernel, kernel.turned(angle)) for angle in _S.turns])
        return gain / float(np.clip((1 - alike) / _S.unlike, _S.least_unlike, 1))

    def gain_over_turned(self, entry: Entry) -> float | None:
        """Return how much better a kernel explains the photo than the same kernel turned.

        It is the gain of the margin over the mean of some turns about the optical axis, on many
        tiles of a finer scale. If the camera did not move, no direction of a kernel is better than
        others. It is None for a disk, the kernel of a photo out of focus, which has no direction.
        """
        kernel = entry.kernel
        if is_filled(kernel):
            return None
        judges = self._finer_batches(entry)
        turned = [mean_margin(judges, kernel.turned(angle)) for angle in _S.turns]
        return self.finer_margin(entry) - float(np.mean(turned))

    def finer_margin(self, entry: Entry) -> float:
        """Return the margin of a kernel on many tiles of a finer scale."""
        return mean_margin(self._finer_batches(entry), entry.kernel)

    def _finer_batches(self, entry: Entry) -> list[Judge]:
        """Return the batches of judges for a kernel at a finer scale, or at the photo's size."""
        return self._batches_at(max(self.level(entry) - _S.confirming, 0), entry.kernel)

    def _batches_at(self, level: int, kernel: RotationKernel) -> list[Judge]:
        """Return the batches of judges for a kernel at a scale; see `Judge.batches`."""
        key = kernel, level
        if key not in self._batches:
            self._batches[key] = Judge.batches(self.pyramid, level, kernel)
        return self._batches[key]

    def weighed(self, entry: Entry) -> Entry:
        """Fit the weights of a kernel to the spectra of the photo."""
        kernel = self._spectra_at(self.level(entry), "fitted").weighed(entry.kernel)
        return entry._replace(name=f"{entry.name}, weights", kernel=kernel)

    def level(self, entry: Entry) -> int:
        """Return the scale that resolves a kernel well."""
        level = np.ceil(2 * np.log2(max(entry.width / _S.width, 1e-9)))
        return int(np.clip(level, 0, self.pyramid.coarsest))

    def suited(self, entry: Entry) -> Entry:
        """Take a kernel for one of the scale that suits it, if that is finer than its own."""
        return entry._replace(level=min(entry.level, self.level(entry)))

    @cached_property
    def _last_matched(self) -> int:
        """The coarsest scale that has enough tiles for a match."""
        level = self.pyramid.coarsest
        while level and len(self._spectra_at(level, "apart").centres) < _S.fewest_tiles:
            level -= 1
        return level

    def _spectra_at(self, level: int, part: Part, finer: int = 0) -> SpectralMatch:
        """Return the spectra of the tiles of a part, at a scale.

        The tiles suit kernels that are judged so many scales coarser.
        """
        key = level, part, finer
        with self._making:
            if key not in self._spectra:
                tiles = SETTINGS.spectral_match.tiles
                size = 4 * round(tiles.size * RATIO**finer / 4)
                wider = SpectrumTiles(size, max(tiles.count >> finer, 1))
                self._spectra[key] = SpectralMatch(self.pyramid, level, part, wider)
            return self._spectra[key]

    def _finer_spectra(self, level: int) -> list[SpectralMatch]:
        """Return the spectra of the tiles for fits, at finer scales and at this one."""
        finest = max(level - SETTINGS.spectral_match.finer, 0)
        return [self._spectra_at(n, "fitted", level - n) for n in range(finest, level + 1)]

    def _make_room(self, level: int, entries: Sequence[Entry]) -> None:
        """Replace the judge of a scale, unless it has room for the kernels."""
        kernels = [entry.kernel for entry in entries]
        judge = self._judges.get(level)
        if judge is None or not all(judge.has_room(kernel) for kernel in kernels):
            self._judges[level] = Judge.of(self.pyramid, level, kernels)
