"""Final gather: light scattered by thick cells to the camera, by short paths (stage 5).

A thick cell scatters far more light back towards its illuminated side than its mean source
describes. So paths start in thick cells on the line of sight, sampled from the phase function.
Their segments cross the thick region and collect the sources of its cells; they end with the
interface radiance of the final sweeps. In the thickest cells paths continue (Jensen, Global
Illumination using Photon Maps, Rendering Techniques 1996; kernels/gather.cl).
"""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from cldit.arrays import Floats, Ints
from cldit.transport.final_gather.paths import ChosenRays, PathSampler
from cldit.transport.image import ThickPixels


def neyman_allocation(energy: Floats, had: Ints, size: Ints, *, allowed: float) -> Ints:
    """Samples per pixel (T,) of each tile that reach a total variance at the lowest cost.

    They are proportional to the root of energy x had / size, since the variance is proportional to
    1 / samples (Neyman, J. R. Stat. Soc. 97, 1934), rounded to powers of two, for which
    low-discrepancy points are most uniform. At least one tile gets more than it had.

    Args:
        energy: (T,) sum of squared errors of a tile's pixels, after `had` samples each.
        had: (T,) samples per pixel so far.
        allowed: sum of the energies of all tiles.
    """
    spread = np.sqrt(energy * had / size)
    ideal = spread * float(spread @ size) / allowed
    power = np.exp2(np.round(np.log2(np.clip(ideal, 1.0, 2.0**40)))).astype(np.int64)
    if not np.any(power > had):
        worst = np.argmax(energy)
        power[worst] = 2 * had[worst]
    return power


class Gather:
    """Final gather of an image, in rounds of paths.

    samples, seconds: paths per pixel of the first call, and time, so far.
    short: reason why paths stopped before the wanted accuracy; empty if they did not.
    """

    def __init__(self, sampler: PathSampler) -> None:
        """Takes the sampler of the image's paths."""
        self.sampler = sampler
        self._image, self._settings = sampler.solution, sampler.settings
        self.samples, self.seconds = 0, 0.0
        self._spent, self._rays = 0.0, 0  # segments and rays of all calls
        self.short = ""

    def __call__(self, groups: Sequence[ThickPixels]) -> list[Floats]:
        """Traces paths until their noise in T_app is `noise_share` of accuracy_K, or to a limit.

        The limits are `max_samples` per pixel, and `paths` and `path_segments` in total. Rounds
        sample the tiles where they reduce the variance most; the first rounds of all groups are
        one.

        Returns:
            Means (2, C + 1, N) for each group, of two independent sets of paths, the part WITHIN
            last.
        """
        start = time.perf_counter()
        paths = self.sampler.paths(groups)
        rays = np.cumsum([0, *(len(group.pixels) * group.across**2 for group in groups)])
        chosen = []
        for group, offset in zip(groups, rays[:-1], strict=True):
            # Pixels of a tile cross the same cells.
            tile_order = np.argsort(self._tiles(group.pixels), kind="stable")
            chosen.append(ChosenRays(tile_order, group.across, int(offset), self._first(group)))
        round_means = self.sampler.means(paths, chosen)
        out = [
            self._refined(paths, *arguments)
            for arguments in zip(groups, chosen, round_means, strict=True)
        ]
        self.seconds += time.perf_counter() - start
        return out

    def _first(self, group: ThickPixels) -> int:
        """Paths of a ray in either half, in the first round.

        Light that diffuses takes paths of unknown length: one in each half.
        """
        rays, tuning = group.across**2, self._settings.tuning
        size = 1 if self.sampler.diffusive else max(tuning.first_samples // rays, 1)
        while size > 1 and 2 * size * rays * len(group.pixels) > tuning.paths / 4:
            size //= 2
        return size

    def _refined(
        self,
        paths: list[dict[str, Any]],
        group: ThickPixels,
        first: ChosenRays,
        round_means: tuple[Floats, float],
    ) -> Floats:
        """Means of a group by the rounds that follow the first, which gave `round_means`."""
        tile_order, across, count = first.pixels, group.across, len(group.pixels)
        tiles = self._tiles(group.pixels)
        sums = np.empty((2, self.sampler.components, count))
        sums[:, :, tile_order], segments = first.samples * round_means[0], round_means[1]
        samples = np.full(count, first.samples)  # of either half, in each of a pixel's rays
        while True:
            means = sums / samples
            next_samples = self._next_samples(means, samples, tiles, group, segments)
            if np.array_equal(next_samples, samples):
                break
            # Pixels with equal numbers of paths continue with the same points.
            for pair in np.unique((samples << 32 | next_samples)[next_samples > samples]):
                had, goal = divmod(int(pair), 1 << 32)
                continued = tile_order[
                    (samples[tile_order] == had) & (next_samples[tile_order] == goal)
                ]
                next_round = ChosenRays(continued, across, first.offset, goal - had)
                [(added, crossed)] = self.sampler.means(paths, [next_round], had)
                sums[:, :, continued] += (goal - had) * added
                segments += crossed
            samples = next_samples
        self._spent, self._rays = self._spent + segments, self._rays + count * across**2
        self.samples = self.samples or int(2 * samples.mean() * across**2)
        return np.asarray(means)

    def _next_samples(
        self, means: Floats, samples: Ints, tiles: Ints, group: ThickPixels, segments: float
    ) -> Ints:
        """Samples (N,) of each pixel after the next round; those so far if there is none.

        `means` (2, C + 1, N) are by `samples` (N,) with that many `segments` in all.
        """
        tuning, accuracy_K = self._settings.tuning, self._settings.accuracy_K
        max_samples, across = self._settings.max_samples, group.across
        energy, visible = self._energy(means, tiles, group)
        allowed = visible * (tuning.noise_share * accuracy_K) ** 2
        if energy.sum() <= allowed:
            return samples
        size = np.bincount(tiles)
        had = np.bincount(tiles, samples) // size
        ideal = neyman_allocation(energy, had, size, allowed=allowed)[tiles]
        limit = np.minimum(tuning.growth * samples, max_samples // (2 * across**2))
        longest = segments / samples.sum()  # mean number in a path of either half
        allowed_samples = (tuning.path_segments - self._spent) / max(longest, 1.0)
        next_samples = np.maximum(np.minimum(ideal, limit), samples)
        while next_samples.sum() > allowed_samples and not np.array_equal(next_samples, samples):
            next_samples = np.maximum(next_samples // 2, samples)
        if (
            np.array_equal(next_samples, samples)
            or 2.0 * across**2 * next_samples.sum() > tuning.paths
        ):
            noise_K = float(np.sqrt(energy.sum() / visible))
            self.short = (
                f"paths in thick cells: stopped at {max_samples} samples per pixel, or in "
                f"total {tuning.paths:.0e} or {tuning.path_segments:.0e} scatterings, with a "
                f"noise of {noise_K:.2g} K RMS; transport.accuracy_K: {accuracy_K:g} needs "
                f"{tuning.noise_share * accuracy_K:.2g} K; "
                "increase transport.max_samples or transport.accuracy_K"
            )
            return samples
        return next_samples

    def _energy(self, means: Floats, tiles: Ints, group: ThickPixels) -> tuple[Floats, int]:
        """Sum (T,) of each tile's squared errors of T_app, and the number of visible pixels.

        The trace must be accurate for any wall temperature: for that of the scene, and for walls
        half as bright as the medium. As warm walls would hide errors of the weights, since
        everything then looks alike; dark ones would ask for light that no image shows.
        """
        cells, view = self._image.cells, self._image.view
        temperature = cells.temperature(self._image.scene, visible=self._settings.visible)
        on_background = view.on_background(group.pixels)
        mean, difference = (means[0] + means[1]) / 2, (means[0] - means[1]) / 2
        weights = group.seen + mean[:-1]
        of_scene, of_bright = (
            on_background
            * np.nan_to_num(temperature.error_K(weights, difference[:-1], outside=outside))
            for outside in (None, 0.5 * cells.hottest)
        )
        noise_bright = self._settings.tuning.noise_bright
        error_K = np.maximum(np.abs(of_scene), np.abs(of_bright) / noise_bright)
        counted = on_background & (1 - weights[0] > temperature.visible)
        visible = max(int(np.count_nonzero(counted)) + group.other_visible, 1)
        return np.bincount(tiles, error_K**2).astype(np.float64), visible

    def affords(self, rays: int) -> bool:
        """True if the scatterings that an image may have suffice for so many more rays."""
        max_scatterings = self._settings.tuning.path_segments
        enough = not self._rays or self._spent * (1 + rays / self._rays) <= max_scatterings
        if not enough:
            self.short = self.short or (
                "paths in thick cells: no more rays for pixels, as an image may have "
                f"{max_scatterings:.0e} scatterings; allowed: more camera.pixels, or a larger "
                "transport.accuracy_K"
            )
        return enough

    def _tiles(self, pixels: Ints) -> Ints:
        """Numbers (N,) of the image tiles of the pixels."""
        tile = self._image.view.tile_of(pixels, self._settings.tuning.noise_tile)
        return np.unique(tile, return_inverse=True)[1].astype(np.int64)
