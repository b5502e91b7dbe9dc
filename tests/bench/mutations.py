"""Spoils a line at a time, and tells whether the default tests notice.

`python tests/bench/mutations.py [--only N ...] [--tests REF] [--whole]`

Each row of `MUTATIONS` names a file, what stands there once, what takes its place, and the tests
that could notice, the quickest first. The change is made in a copy of the tree, where these tests
then run up to the first failure. The copy's code is what runs, in child processes too: its folder
comes first on PYTHONPATH, with `drivers` and `kernels` linked into `cldit`. That is checked first.

--tests REF takes the tests of that commit, on the same spoiled code. A row whose text is not found
exactly once ends everything: the table must follow the code.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CHECK = (
    "import cldit, cldit.drivers, cldit.kernels as kernels; "
    "print(*(each.__path__[0] for each in (cldit, cldit.drivers, kernels)))"
)


@dataclass(frozen=True)
class Mutation:
    file: str
    old: str
    new: str
    tests: tuple[str, ...]


def row(file: str, old: str, new: str, *tests: str) -> Mutation:
    return Mutation(file, old, new, tuple(f"tests/{test}" for test in tests))


MUTATIONS = (
    # kernels: a wrong share, a lost ray, a turned sign, an edge, a shifted pixel
    row("kernels/attenuation.h", "- n * 1.42860677e-6f", "+ n * 1.42860677e-4f",
        "kernels/test_headers.py", "kernels/test_sweep.py", "verify/test_slab.py"),
    row("kernels/boundary.h", "x * x + z * z <= disc.w)", "x * x + z * z <= R(1.1) * disc.w)",
        "kernels/test_headers.py", "kernels/test_image.py", "verify/test_audit.py"),
    row("kernels/phase.h", "while (low < PHASE_BINS - 1 && share[low + 1] <= u) ++low;", "",
        "kernels/test_headers.py", "verify/test_phase.py", "verify/test_path.py"),
    row("kernels/phase.h", "below = here;", "below = R(0);", "kernels/test_random.py"),
    row("kernels/path.cl", "address = cell.address;", "", "verify/test_size_classes.py"),
    row("kernels/directions.h", "(d.x > R(0)) + 2 * (d.y > R(0)) + 4 * (d.z > R(0))",
        "(d.x > R(0)) + 2 * (d.y > R(0)) + 4 * (d.z < R(0))",
        "kernels/test_headers.py", "kernels/test_gather.py", "kernels/test_interface_radiance.py",
        "verify/test_path.py", "verify/test_thick.py"),
    row("kernels/path.cl", "if (!has_scattered && transmitted - taken <= goal)",
        "if (!has_scattered && transmitted <= goal)", "verify/test_path.py"),
    row("kernels/path.cl", "if (unit(word.w) * floor_ >= weight) return;",
        "if (unit(word.w) * floor_ >= R(0.5) * weight) return;", "verify/test_path.py"),
    row("kernels/source_update.cl",
        "out[k] = albedo[i] * (listed[k] + i_minus_s[k]) + emission[k];",
        "out[k] = albedo[i] * listed[k] + i_minus_s[k] + emission[k];",
        "kernels/test_gmres.py", "verify/test_cavity.py", "verify/test_path.py"),
    row("kernels/sweep.cl", "crossing[c * slots + u] = c == seen ? inflow : R(0);",
        "crossing[c * slots + u] = c == WALL ? inflow : R(0);",
        "kernels/test_sweep.py", "verify/test_slab.py"),
    row("kernels/sweep.cl", "own = gap * q - curved * view_weight;", "own = gap * q;",
        "kernels/test_spatial_gradients.py", "kernels/test_sweep.py", "verify/test_path.py"),
    row("kernels/gather.cl", "known = last ? weight : weight - path->floor;",
        "known = last ? weight : R(0);",
        "kernels/test_gather.py", "verify/test_path.py", "verify/test_thick.py",
        "verify/test_slab.py"),
    row("kernels/gather.cl", "score_later(pending, -weight, m->light",
        "score_later(pending, R(-0.5) * weight, m->light",
        "kernels/test_gather.py", "verify/test_path.py", "verify/test_thick.py",
        "verify/test_slab.py"),
    row("kernels/ray.h", "const real up = (R(0.5) * rows - down) * pitch_z;",
        "const real up = (R(0.5) * rows - down + R(0.5)) * pitch_z;",
        "kernels/test_headers.py", "kernels/test_image.py"),
    row("kernels/octree_traversal.h", "if (crosses) return down ? side - 1 : side;",
        "if (crosses) return side;", "kernels/test_image.py", "verify/test_slab.py",
        "kernels/test_headers.py"),
    # deposit: a sliver that is lost, and cells that get a neighbour's share
    row("cldit/medium/deposit.py",
        "high = np.where(step == count[box, axis] - 1, self.upper[box, axis], high)", "pass",
        "unit/medium"),
    row("cldit/medium/deposit.py",
        "local = (z % BRICK * BRICK + y[:, None] % BRICK) * BRICK + x % BRICK",
        "local = (z % BRICK * BRICK + x % BRICK) * BRICK + y[:, None] % BRICK", "unit/medium"),
    # dit: errors that are not told, pictures that are
    row("cldit/dit/fit.py", "squares += 2.0 * p_both * off_ref * off_inj",
        "squares -= 2.0 * p_both * off_ref * off_inj", "unit/dit", "verify/test_dit_noise.py"),
    row("cldit/dit/fit.py", "gradient = np.stack([-radiance, -one, radiance, one], axis=1)",
        "gradient = np.stack([radiance, -one, radiance, one], axis=1)",
        "unit/dit", "verify/test_dit_noise.py"),
    row("cldit/dit/solve.py", "g, _, s, _ = np.nan_to_num(lines.values.T)",
        "s, _, g, _ = np.nan_to_num(lines.values.T)", "unit/dit", "verify/test_dit_noise.py",
        "verify/test_dit_exact.py"),
    # drivers: what stays hot, and what is not what was asked for
    row("drivers/fluke418x.py", "        self._output(False)\n", "        pass\n",
        "drivers/test_lost_replies.py", "drivers/test_faults.py"),
    row("drivers/modbus_blackbody.py", "celsius = int(struct.unpack(\">h\", raw)[0]) / 10.0",
        "celsius = int(struct.unpack(\">H\", raw)[0]) / 10.0",
        "drivers/test_contract.py", "drivers/test_faults.py"),
    row("cldit/rig/link.py",
        "            else:\n                self._lose(error)\n            raise",
        "            raise", "unit/rig/test_link.py", "drivers/test_lost_replies.py"),
    # acquisition: shots that a kill loses, and fuel that nobody misses
    row("cldit/acquisition/journal.py", "os.ftruncate(self._file, self._end)  # of a line",
        "pass  # of a line", "unit/acquisition/test_journal.py",
        "system/test_acquisition_kill.py"),
    row("cldit/acquisition/sequence.py", 'journal.append("saved", **_saved(meta), adopted=True)',
        "pass", "system/test_acquisition_kill.py", "unit/acquisition/test_record.py"),
    row("cldit/acquisition/sequence.py", "self._rig.clock.catch_up(max(times).timestamp() + 1.0)",
        "pass", "system/test_acquisition_kill.py", "unit/acquisition"),
    row("cldit/acquisition/quality.py", "wanted = frames[0].frame_id + number",
        "wanted = frame.frame_id", "unit/acquisition/test_quality.py", "unit/acquisition"),
    # optics and sprays
    row("cldit/optics/kramers_kronig.py", "n_there + (2.0 / np.pi)", "n_there + (1.9 / np.pi)",
        "verify/test_kramers_kronig.py"),
    row("cldit/optics/vapour.py", "HEPTANE_AREA_KM_MOL = 503.0", "HEPTANE_AREA_KM_MOL = 510.0",
        "unit/optics/test_vapour.py", "verify/test_spectral_run.py"),
    row("cldit/optics/planck.py", "_NODES = 16384", "_NODES = 64", "unit/optics/test_planck.py"),
)  # fmt: skip


def copied(to: Path, tests: str | None) -> None:
    """The tree as it is, with the tests of a commit where one is named."""
    for name in ("cldit", "drivers", "kernels", "tests", "docs"):
        skip = shutil.ignore_patterns("__pycache__", "*.nbi", "*.nbc")
        shutil.copytree(ROOT / name, to / name, symlinks=True, ignore=skip)
    for file in ROOT.glob("*.*"):
        if file.is_file():
            shutil.copy2(file, to)
    if tests is not None:
        shutil.rmtree(to / "tests")
        archive = subprocess.run(
            ["git", "-C", str(ROOT), "archive", tests, "tests"], capture_output=True, check=True
        )
        subprocess.run(["tar", "-x", "-C", str(to)], input=archive.stdout, check=True)
    for name in ("drivers", "kernels"):
        (to / "cldit" / name).symlink_to(to / name)


def spoil(tree: Path, mutation: Mutation) -> str:
    """Makes the change; the text before it."""
    path = tree / mutation.file
    text = path.read_text()
    if text.count(mutation.old) != 1:
        sys.exit(f"{mutation.file}: {text.count(mutation.old)} times {mutation.old!r}, wanted once")
    path.write_text(text.replace(mutation.old, mutation.new))
    return text


def noticed(tree: Path, tests: tuple[str, ...], environment: dict[str, str]) -> str | None:
    """The first test that fails, and None where all pass."""
    for test in tests:
        if not (tree / test).exists():
            sys.exit(f"{test}: there is no such test")
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", test]
        ran = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True)
        if ran.returncode == 1:
            lines = [line for line in ran.stdout.splitlines() if line[:6] in ("FAILED", "ERROR ")]
            return lines[0] if lines else ran.stdout[-300:]
        if ran.returncode != 0:
            sys.exit(f"{test}: pytest ended with {ran.returncode}\n{ran.stdout[-2000:]}")
    return None


def main() -> None:
    """Prints a row for each mutation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tests", metavar="REF", help="tests of this commit")
    parser.add_argument("--only", type=int, nargs="+", help="numbers of rows")
    parser.add_argument("--whole", action="store_true", help="first the tests on whole code")
    chosen = parser.parse_args()
    numbers = chosen.only or range(len(MUTATIONS))
    caught = 0
    with tempfile.TemporaryDirectory(prefix="cldit-mutations-") as place:
        tree = Path(place).resolve() / "tree"
        tree.mkdir()
        copied(tree, chosen.tests)
        environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
        check = [sys.executable, "-c", CHECK]
        said = subprocess.check_output(check, cwd=place, env=environment, text=True).split()
        if len(said) != 3 or not all(Path(path).is_relative_to(tree) for path in said):
            sys.exit(f"the copy's code is not what runs: {said}")
        if chosen.whole:
            tests = dict.fromkeys(test for n in numbers for test in MUTATIONS[n].tests)
            failed = noticed(tree, tuple(tests), environment)
            if failed:
                sys.exit(f"fails on whole code: {failed}")
        for number in numbers:
            mutation = MUTATIONS[number]
            before = spoil(tree, mutation)
            found = noticed(tree, mutation.tests, environment)
            (tree / mutation.file).write_text(before)
            caught += found is not None
            print(f"{number:2d} {mutation.file}: {mutation.old.strip()[:60]}", flush=True)
            print(f"   {'missed' if found is None else 'caught: ' + found[:150]}", flush=True)
    print(f"{caught} of {len(numbers)} caught")


if __name__ == "__main__":
    main()
