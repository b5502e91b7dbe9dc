"""Spoils a line at a time and reports which tier of the tests notices.

`python -m tests.bench mutations [--only N ...] [--workers N] [--short]`

Each row of `MUTATIONS` names a file, a text that occurs in it once, what replaces it, and the file
of tests that notices. The change is made in a copy of the tree. There the named tests, then all but
those of `tests/bench`, run up to the first failure: first those of the first tier, and if the
change survives these, those marked `slow`. The copy's code is what runs, in child processes too:
its folder comes first on PYTHONPATH, and it links `drivers` and `kernels` into `cldit`. That is
checked first.

--short runs the named tests alone. A row whose text is not found exactly once is an error.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COPIED = (
    "import cldit, cldit.drivers, cldit.kernels as kernels; "
    "print(*(each.__path__[0] for each in (cldit, cldit.drivers, kernels)))"
)
FOLDERS = tuple(f"tests/{room}" for room in "unit kernels drivers verify regression system".split())
FIRST, SECOND = "first tier", "second tier"
TIERS = {
    FIRST: "not slow and not long and not hardware",
    SECOND: "slow and not long and not hardware",
}
PATIENCE_S = 7200
ENDLESS = f"no end within {PATIENCE_S} s"
NOTHING_RAN = 5  # pytest's status if no test was selected


@dataclass(frozen=True)
class Mutation:
    """One spoiled line, and the file of tests that notices."""

    file: str
    old: str
    new: str
    test: str


def row(file: str, old: str, new: str, test: str) -> Mutation:
    return Mutation(file, old, new, f"tests/{test}")


MUTATIONS = (
    # kernels: a wrong share, a lost ray, a turned sign, an edge, a shifted pixel
    row("kernels/attenuation.h", "- n * 1.42860677e-6f", "+ n * 1.42860677e-4f",
        "kernels/test_headers.py"),
    row("kernels/boundary.h", "x * x + z * z <= disc.w)", "x * x + z * z <= R(1.1) * disc.w)",
        "kernels/test_boundary_shares.py"),
    row("kernels/phase.h", "while (low < PHASE_BINS - 1 && share[low + 1] <= u) ++low;", "",
        "kernels/test_random.py"),
    row("kernels/phase.h", "below = here;", "below = R(0);", "kernels/test_random.py"),
    row("kernels/path.cl", "address = cell.address;\n#ifdef", "\n#ifdef",
        "verify/test_size_classes.py"),
    row("kernels/directions.h", "(d.x > R(0)) + 2 * (d.y > R(0)) + 4 * (d.z > R(0))",
        "(d.x > R(0)) + 2 * (d.y > R(0)) + 4 * (d.z < R(0))", "kernels/test_gather.py"),
    row("kernels/path.cl", "if (!has_scattered && transmitted * decay(t) <= goal)",
        "if (!has_scattered && transmitted <= goal)", "kernels/test_path_ends.py"),
    row("kernels/path.cl", "if (unit(word.w) * floor_ >= weight) return;",
        "if (unit(word.w) * floor_ >= R(0.5) * weight) return;", "kernels/test_path_ends.py"),
    row("kernels/source_update.cl", "listed[mean] = albedo[i] * light[mean] + emission[mean];",
        "listed[mean] = albedo[i] * (light[mean] + emission[mean]);",
        "kernels/test_source_update.py"),
    row("kernels/sweep.cl", "ray[c * stride] = c == seen ? in->inflow : R(0);",
        "ray[c * stride] = c == WALL ? in->inflow : R(0);", "kernels/test_sweep.py"),
    row("kernels/sweep.cl", "own = gap * q - curved * view_weight;", "own = gap * q;",
        "kernels/test_sweep.py"),
    row("kernels/path_segment.h", "const real weight = LANE(f->weight, lane);",
        "const real weight = R(0.9) * LANE(f->weight, lane);", "kernels/test_path_segments.py"),
    row("kernels/ray.h", "const real up = (R(0.5) * rows - down) * pitch_z;",
        "const real up = (R(0.5) * rows - down + R(0.5)) * pitch_z;", "kernels/test_headers.py"),
    row("kernels/octree_traversal.h", "if (crosses) return down ? side - 1 : side;",
        "if (crosses) return down ? side - 2 : side;", "kernels/test_image.py"),
    # scene: a value that should be refused, a base that wins, a unit
    row("cldit/scene/curves.py", "if upper <= lower:", "if upper < lower:",
        "unit/optics/test_response.py"),
    row("cldit/scene/load.py", 'merged({**below, "name": name}, over)',
        'merged(over, {**below, "name": name})', "unit/scene/test_change.py"),
    row("cldit/scene/values.py", '"ms": -3, "us": -6', '"ms": -3, "us": -3',
        "unit/cfd/test_one_state.py"),
    # sprays: a moment, a mass that is lost, a force, a property, a look-up
    row("cldit/spray/sizes.py", "shapes = (p + 1 + orders) / n", "shapes = (p + orders) / n",
        "unit/spray/test_sizes.py"),
    row("kernels/spray/gas_sources.cl", "WRITE(READ(fuel + at) + (gain), fuel + at);",
        "WRITE(READ(fuel + at), fuel + at);", "kernels/test_gas_state.py"),
    row("kernels/spray/parcels.cl", "count * push.x, scales[2]", "push.x, scales[2]",
        "kernels/test_parcels.py"),
    row("kernels/spray/ray_place.h", "at.part[0] = R(1) - beyond;", "at.part[0] = beyond;",
        "kernels/test_parcels.py"),
    row("kernels/spray/gas_transport.cl", "(R(1) + magnitude(speed)) * R(1.0 / 3.0)",
        "R(1.0 / 3.0)", "kernels/test_gas_transport.py"),
    row("kernels/spray/gas_transport.cl", "R(2) * lower(magnitude(behind)",
        "R(4) * lower(magnitude(behind)", "kernels/test_gas_transport.py"),
    row("kernels/spray/gas_mixing.cl", "const lane_t weight = -closing / gamma;",
        "const lane_t weight = closing / gamma;", "kernels/test_gas_transport.py"),
    row("kernels/spray/gas_projection.cl", "#define MOST_EXPANSION R(0.5)",
        "#define MOST_EXPANSION R(5)", "kernels/test_gas_projection.py"),
    row("kernels/spray/gas_eddies.cl", "READ(mixing_length + i) * thin * sqrt(thin)",
        "READ(mixing_length + i) * thin", "kernels/test_gas_transport.py"),
    row("kernels/spray/gas_receipt.cl", "(copies * angle[ray] * shell[i + lane])",
        "(angle[ray] * shell[i + lane])", "kernels/test_gas_state.py"),
    row("cldit/spray/flow/projection.py", "closing = 1 / (azimuth[0]", "closing = 2 / (azimuth[0]",
        "kernels/test_gas_projection.py"),
    row("kernels/spray/evaporation.h", "R(0.077)", "R(0.078)", "kernels/test_droplets.py"),
    row("cldit/spray/cone/wet_bulb.py", "/ count / np.diff(bounds)", "/ np.diff(bounds)",
        "unit/spray/cone/test_fluid_properties.py"),
    row("cldit/spray/cone/fluid_properties.py", "7.2099e-6 * t * t", "7.2099e-6 * t",
        "unit/spray/cone/test_fluid_properties.py"),
    # cfd: parcels outside, a weight, a copy, bytes
    row("cldit/cfd/plausible.py", "slack = WRITTEN * float(", "slack = 1e-1 * float(",
        "unit/cfd/test_openfoam_layouts.py"),
    row("cldit/cfd/mapping/columns.py", "weight = pressure / temperature",
        "weight = pressure * temperature", "unit/cfd/test_paraview.py"),
    row("cldit/cfd/sectors.py", "(parcels.position_m - origin) @ rotation.T",
        "(parcels.position_m - origin) @ rotation", "unit/cfd/test_sectors.py"),
    row("cldit/cfd/openfoam/lists.py", "or numbers.size != count * width", "",
        "unit/cfd/test_refusals.py"),
    row("cldit/cfd/hdf/fluent.py", "sides[number, low - 1 : high] = stored",
        "sides[number, low - 1 : high] = 0 * stored", "unit/cfd/formats/test_fluent.py"),
    # medium: a sliver that is lost, cells that get a neighbour's share, a coarse leaf's volume
    row("cldit/medium/deposit.py",
        "high = np.where(step == count[box, axis] - 1, self.upper[box, axis], high)", "pass",
        "unit/medium/test_octree.py"),
    row("cldit/medium/deposit.py", "local = (z % BRICK * BRICK + y % BRICK) * BRICK + x % BRICK",
        "local = (z % BRICK * BRICK + x % BRICK) * BRICK + y % BRICK",
        "unit/medium/test_octree.py"),
    row("cldit/medium/octree.py", "side = min(BRICK, self.frame.cells) * self.frame.cell_m",
        "side = self.frame.cell_m", "unit/medium/test_octree.py"),
    # optics
    row("cldit/optics/liquid.py", "c2 / ratio - response.imag", "c2 / ratio - 0.95 * response.imag",
        "unit/optics/test_liquid.py"),
    row("cldit/optics/vapour.py", "+ t * np.sin(u) ** 2", "+ np.sin(u) ** 2",
        "unit/optics/test_vapour.py"),
    row("cldit/optics/planck.py", "_NODES = 16384", "_NODES = 64", "unit/optics/test_planck.py"),
    row("cldit/optics/windows.py", "surface * (1.0 + passage * transmission)", "surface",
        "unit/optics/test_windows.py"),
    row("cldit/optics/band.py", "emission_m2=absorption * band.radiance(parcels.temperature_K)",
        "emission_m2=scattering * band.radiance(parcels.temperature_K)",
        "unit/optics/test_droplets.py"),
    row("cldit/optics/scene_phase.py", "henyey_greenstein(phase))", "henyey_greenstein(-phase))",
        "unit/optics/test_scene_phase.py"),
    # gpu
    row("cldit/gpu/device.py", "range(start, stop)", "range(start, max(stop - 1, start))",
        "unit/gpu/test_device.py"),
    row("cldit/gpu/signature.py", "if argument.name == name:", "if argument.name >= name:",
        "unit/gpu/test_device.py"),
    # transport
    row("cldit/transport/angular_moments.py", "3 * moment_1] * 3", "3 * moment_1] * 2 + [moment_1]",
        "unit/transport/test_quadrature.py"),
    row("kernels/linear_cell.h", "* R(1.0 / 12.0);", "* R(1.0 / 10.0);",
        "kernels/test_cell_records.py"),
    row("cldit/transport/monte_carlo/path.py", "(self.halves[0] - self.halves[1]) / self.batches",
        "(self.halves[0] - self.halves[1]) / self.batches / 2", "verify/test_path.py"),
    row("cldit/transport/energy_balance.py", "+ within - 1.0", "+ within - 1.001",
        "verify/test_energy_balance.py"),
    row("cldit/transport/discrete_ordinates/quadrature.py", "_GOLDEN = (1 + 5**0.5) / 2",
        "_GOLDEN = (1 + 4**0.5) / 2", "kernels/test_gather.py"),
    # radiance and camera
    row("cldit/radiance/boundary.py", "emitted + shares.reflection * at(opposite_K)", "emitted",
        "verify/test_windows_dit.py"),
    row("cldit/radiance/boundary.py", "self.rear.transmission * disc + self.rear_added",
        "self.rear.transmission * disc", "unit/dit/test_budget.py"),
    row("cldit/radiance/apparent_temperature.py",
        "(radiance + background * apparent) / emissivity / slope",
        "(radiance - background * apparent) / emissivity / slope",
        "unit/radiance/test_apparent_temperature.py"),
    row("cldit/camera/sensor.py", "mean + np.sqrt(mean) *", "mean + 0.9 * np.sqrt(mean) *",
        "unit/camera/test_sensor.py"),
    row("cldit/camera/calibration.py", "electrons_per_count**2 + rounding",
        "electrons_per_count**2", "unit/camera/test_sensor.py"),
    row("cldit/camera/photon_transfer.py", "0.5)) / (exposures - 1)", "0.5)) / exposures",
        "verify/test_dit_outliers.py"),
    # prepare and accuracy: fuel outside the picture, an error too small
    row("cldit/prepare/case_fit.py", "(distance_m / (distance_m + offset[:, 1]))",
        "(distance_m / (distance_m - offset[:, 1]))", "unit/prepare/test_case_fit.py"),
    row("cldit/prepare/cell_choice.py", "(parcels / limit) ** (1 / 3)",
        "(parcels / limit) ** (1 / 6)", "unit/accuracy/test_problem.py"),
    row("cldit/accuracy/trace_error.py", "np.sqrt(max(square, 0.0) + doubt)",
        "np.sqrt(max(square, 0.0))", "unit/accuracy/test_trace_error.py"),
    row("cldit/accuracy/errors.py", "sum(error**2 for error in known_errors) ** 0.5",
        "max(known_errors)", "unit/accuracy/test_errors.py"),
    row("cldit/accuracy/richardson.py", "fine_step.times(1.0 / (once**order - 1.0))",
        "fine_step.times(1.0 / once**order)", "unit/accuracy/test_cells.py"),
    row("cldit/accuracy/error_maps.py", "local_map *= error / rms", "local_map *= rms / rms",
        "unit/accuracy/test_error_maps.py"),
    # run: a cache that mixes runs, labels in the wrong place
    row("cldit/run/labelled.py", "(width - 1) / 2) * across", "width / 2) * across",
        "unit/run/test_labelled.py"),
    row("cldit/run/octree_export.py", "emitting = (absorption > 0) & (emission > 0)",
        "emitting = absorption >= 0", "unit/run/test_octree_export.py"),
    row("cldit/run/folder.py", "if stored != scene:", "if False:", "unit/run/test_folder.py"),
    # dit: errors that are not told, pictures that are
    row("cldit/dit/fit.py", "squares += 2.0 * self.between * ref * inj",
        "squares -= 2.0 * self.between * ref * inj", "unit/dit/test_fit.py"),
    row("cldit/dit/fit.py", "gradient = np.stack([-radiance, -ones, radiance, ones], axis=1)",
        "gradient = np.stack([radiance, -ones, radiance, ones], axis=1)", "unit/dit/test_fit.py"),
    row("cldit/dit/solve.py", "self.in_reference * g, self.in_injection * s",
        "self.in_reference * s, self.in_injection * g", "unit/dit/test_budget.py"),
    row("cldit/dit/solve.py", "variance / signals.exposures[:, None]",
        "variance / self.signals[0].exposures[:, None]", "unit/dit/test_solve.py"),
    row("cldit/dit/profile.py", "z_m = start_m[1] - distance_m", "z_m = start_m[1] + distance_m",
        "unit/dit/test_profile.py"),
    row("cldit/dit/witness/kinds.py", "seen = difference / gain - read_difference",
        "seen = difference / gain", "verify/test_witnesses.py"),
    # rig, drivers and their contract: what stays hot, and what is not what was asked for
    row("cldit/rig/link.py", "self._unanswered = True\n                self._lose(error)",
        "self._unanswered = True", "unit/rig/test_link.py"),
    row("cldit/rig/stability.py", "held_s >= stability.hold_s + stability.settle_s",
        "held_s >= stability.hold_s", "unit/rig/test_clock.py"),
    row("drivers/line_blackbody.py", "is not (state == \"on\")", "is None",
        "drivers/test_given_controllers.py"),
    row("drivers/dg645.py", "level_V = _LOWEST_V\n", "level_V = self._settings.injector_V\n",
        "drivers/test_contract.py"),
    row("drivers/dg645.py", 'float(f"{burst.period_s:.8f}")', "1e-3 * burst.period_s",
        "drivers/test_contract.py"),
    row("drivers/modbus_registers.py", '"int16": ">h"', '"int16": ">H"',
        "drivers/test_given_controllers.py"),
    row("drivers/simulated_camera.py", "bad[roi.y : roi.y + roi.height, roi.x : roi.x + roi.width]",
        "bad[: roi.height, : roi.width]", "drivers/test_simulated.py"),
    row("cldit/testing/triggers.py", "trigger.make_safe()\n    refuses", "refuses",
        "drivers/test_check_driver.py"),
    # acquisition: shots that a kill loses, and fuel that nobody misses
    row("cldit/acquisition/journal.py", "os.ftruncate(self._file, self._end)  # of a line",
        "pass  # of a line", "unit/acquisition/test_journal.py"),
    row("cldit/acquisition/sequence.py",
        'journal.append("saved", **_saved(meta), file_sha256=digest, adopted=True)', "pass",
        "unit/acquisition/test_record.py"),
    row("cldit/acquisition/sequence.py", "self._rig.clock.catch_up(max(times).timestamp() + 1.0)",
        "pass", "unit/acquisition/test_runner.py"),
    row("cldit/acquisition/quality.py", "if frame.frame_id != expected:",
        "if expected_id is not None and frame.frame_id != expected:",
        "unit/acquisition/test_quality.py"),
    row("cldit/acquisition/pictures/hcc.py", "1e-7 * header", "1e-6 * header",
        "unit/acquisition/test_export.py"),
    row("cldit/acquisition/shot.py", "abs(reading_K - shot.background_K) <= self._plan.drift_K",
        "abs(reading_K - shot.background_K) <= 9 * self._plan.drift_K",
        "unit/acquisition/test_runner.py"),
    # show, study, bench, command line, files, api
    row("cldit/show/figures/colours.py", "np.searchsorted(share, at)",
        "np.searchsorted(share, 1 - at)", "unit/show/report/test_pictures.py"),
    row("cldit/comparison/chi_square.py", "np.sum(inside) - products *",
        "np.sum(inside) + products *", "unit/comparison/test_chi_square.py"),
    row("cldit/comparison/regions.py", "centre_m[1] - (np.arange(rows)",
        "centre_m[1] + (np.arange(rows)", "unit/comparison/test_difference.py"),
    row("cldit/show/view/packing.py", "kept = (word + half)", "kept = word",
        "unit/show/view/test_page.py"),
    row("cldit/study/page.py", "if agreed == len(words):", "if agreed:", "unit/study/test_page.py"),
    row("cldit/dit/separation.py", "draws=np.delete(self.draws, number, axis=1)",
        "draws=self.draws", "unit/dit/test_separation.py"),
    row("cldit/bench/budget.py", "self.stated_K / self.true_K", "self.true_K / self.stated_K",
        "unit/bench/test_budget.py"),
    row("cldit/cli/options.py", ".removesuffix(self.name)", "", "unit/cli/test_conventions.py"),
    row("cldit/cli/check_driver.py", "and tally[Verdict.PASSED] > 0", "",
        "drivers/test_check_driver.py"),
    row("cldit/io/tables.py", 'or head["check"] != zlib.crc32(values)', "",
        "unit/io/test_files.py"),
    row("cldit/io/free_memory.py", 'memory["MemAvailable"] * 1024', 'memory["MemAvailable"]',
        "unit/io/test_caches.py"),
    row("cldit/io/images.py", "resolution = (1e-3 / pixel_m[0], 1e-3 / pixel_m[1])",
        "resolution = (1e-3 / pixel_m[1], 1e-3 / pixel_m[0])", "unit/io/test_files.py"),
    row("cldit/api/series.py", "report.stat().st_mtime_ns < info.stat().st_mtime_ns", "False",
        "unit/run/test_series.py"),
)  # fmt: skip


def copy(to: Path) -> None:
    """Copies the tree as it is, changes that are not committed included."""
    skip = shutil.ignore_patterns("__pycache__", "*.nbi", "*.nbc")
    for name in ("cldit", "drivers", "kernels", "tests", "docs"):
        shutil.copytree(ROOT / name, to / name, symlinks=True, ignore=skip)
    for file in ROOT.glob("*.*"):
        if file.is_file():
            shutil.copy2(file, to)


@dataclass
class Runner:
    """Runs tests in the copy of the tree; a test that fails on whole code counts for nothing."""

    tree: Path
    workers: int
    environment: dict[str, str]
    broken: set[str] = field(default_factory=set)

    def failed(self, tests: Sequence[str], marks: str) -> str | None:
        """Name of the first test that fails, None if all pass."""
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-x",
            "-q",
            "-p",
            "no:cacheprovider",
            "-m",
            marks,
        ]
        command += [f"--deselect={test}" for test in self.broken]
        if self.workers > 1:
            command += ["-n", str(self.workers), "--dist", "worksteal"]
        try:
            ran = subprocess.run(
                [*command, *tests],
                cwd=self.tree,
                env=self.environment,
                capture_output=True,
                text=True,
                check=False,
                timeout=PATIENCE_S,
            )
        except subprocess.TimeoutExpired:
            return ENDLESS
        if ran.returncode in (0, NOTHING_RAN):
            return None
        for line in ran.stdout.splitlines():
            if line.startswith(("FAILED ", "ERROR ")):
                return line.partition(" ")[2].partition(" - ")[0]
        return sys.exit(f"{tests}: pytest ended with {ran.returncode}\n{ran.stdout[-2000:]}")

    def caught(self, mutation: Mutation, *, short: bool) -> tuple[str, str]:
        """Tier that notices, "" if none does; and the test that fails."""
        path = self.tree / mutation.file
        whole = path.read_text(encoding="utf-8")
        spoiled = whole.replace(mutation.old, mutation.new)
        for tier, marks in TIERS.items():
            for tests in ((mutation.test,),) if short else ((mutation.test,), FOLDERS):
                while True:
                    path.write_text(spoiled, encoding="utf-8")
                    found = self.failed(tests, marks)
                    path.write_text(whole, encoding="utf-8")
                    if found is None:
                        break
                    if found == ENDLESS or self.failed((found,), marks) is None:
                        return tier, found
                    self.broken.add(found)
        return "", ""


def wrong_rows(tree: Path, numbers: Iterable[int]) -> list[str]:
    """Rows that do not fit the code: a text that is not found once, a test that is missing."""
    out = []
    for number in numbers:
        mutation = MUTATIONS[number]
        path = tree / mutation.file
        count = path.read_text(encoding="utf-8").count(mutation.old) if path.is_file() else 0
        if count != 1:
            out.append(f"{number} {mutation.file}: {mutation.old!r} occurs {count} times")
        if not (tree / mutation.test).is_file():
            out.append(f"{number}: no {mutation.test}")
    return out


def main() -> None:
    """Prints a row for each mutation, then the share that each tier catches."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", type=int, nargs="+", help="numbers of rows")
    parser.add_argument("--workers", type=int, default=1, help="processes of pytest")
    parser.add_argument("--short", action="store_true", help="the named tests alone")
    chosen = parser.parse_args()
    numbers = chosen.only or range(len(MUTATIONS))
    if wrong := wrong_rows(ROOT, numbers):
        sys.exit("\n".join(wrong))
    tally: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="cldit-mutations-") as place:
        tree = Path(place).resolve() / "tree"
        tree.mkdir()
        copy(tree)
        environment = {**os.environ, "PYTHONPATH": str(tree)}
        found = subprocess.check_output(
            [sys.executable, "-c", COPIED], cwd=place, env=environment, text=True
        ).split()
        if len(found) != 3 or not all(Path(path).is_relative_to(tree) for path in found):
            sys.exit(f"the copy's code is not what runs: {found}")
        runner = Runner(tree, chosen.workers, environment)
        for number in numbers:
            mutation, start = MUTATIONS[number], time.monotonic()
            tier, test = runner.caught(mutation, short=chosen.short)
            tally[tier] += 1
            print(f"{number:2d} {mutation.file}: {mutation.old.strip()[:60]}")
            seconds = f"{time.monotonic() - start:.0f} s"
            print(f"   {tier or 'missed'}, {seconds}: {test[:150]}", flush=True)
    both = tally[FIRST] + tally[SECOND]
    print(f"of {len(numbers)}: {both} caught, {tally[FIRST]} of them in the first tier")
    print("fail on whole code:", ", ".join(sorted(runner.broken)) or "none")


if __name__ == "__main__":
    main()
