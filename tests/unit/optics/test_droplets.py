"""The droplet table: error against single Mie solutions, speed, cache, limits, bad input."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import miepython
import numpy as np
import pytest

from cldit.errors import DropletError
from cldit.optics import droplets, mie
from cldit.optics.band import BandOptics, Droplets, emitters
from cldit.optics.droplets import DropletTable, droplet_table, table_error
from cldit.spray.result import Parcels, Spray
from tests.unit.optics.table_errors import check_table

PAPER = {"wavelength_um": 3.4, "n": 1.338, "k": 0.0341}


@pytest.fixture(scope="module")
def paper(tables: Path) -> DropletTable:
    return droplet_table(**PAPER, cache=tables)


def _exact(table: DropletTable, d: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x = np.pi * d / (table.wavelength_um * 1e-6)
    q_ext, q_sca, _, g = miepython.efficiencies_mx(complex(table.n, -table.k), x)
    return q_ext, q_sca, g


def _diameters(count: int) -> np.ndarray:
    """Off the table's knots, log-uniform over its range."""
    return np.exp(np.random.default_rng(7).uniform(np.log(5e-8), np.log(5e-4), count))


@pytest.mark.parametrize(
    ("n", "k", "within"),
    [
        (1.338, 0.0341, 2e-5),
        (1.36, 0.002, 1e-3),
        (1.338, 10.0, 1e-4),
    ],
)
def test_error_between_the_knots(n: float, k: float, within: float) -> None:
    table = droplet_table(wavelength_um=3.4, n=n, k=k, cache=None)
    d = _diameters(400)
    area = np.pi / 4 * d**2
    q_ext, q_sca, g = _exact(table, d)
    c_abs, c_sca = table.cross_sections(d)
    assert c_sca / area == pytest.approx(q_sca, rel=within)
    assert c_abs / area == pytest.approx(q_ext - q_sca, rel=within)
    assert table.efficiencies(d)[2] == pytest.approx(g, abs=within)


def test_droplets_emit_what_they_absorb(paper: DropletTable) -> None:
    """Kirchhoff's law, by miepython's absorption: times the radiance of each droplet's own
    temperature."""
    d, kelvin = _diameters(5), np.linspace(300.0, 400.0, 5)
    count = np.arange(1.0, 6.0)
    parcels = Parcels(np.zeros((5, 3)), d, count, kelvin, np.full(5, 600.0))
    liquid = Droplets(np.zeros(1), (paper,))
    band = BandOptics(radiance=np.square, vapour_m2_mol=np.zeros_like, droplets=liquid)
    points, _ = emitters(Spray(parcels=parcels), band)
    assert points is not None
    q_ext, q_sca, _ = _exact(paper, d)
    area = np.pi / 4 * d**2 * count
    assert points.absorption_m2 == pytest.approx(area * (q_ext - q_sca), rel=2e-5)
    assert points.emission_m2 == pytest.approx(area * (q_ext - q_sca) * kelvin**2, rel=2e-5)
    assert points.scattering_m2 == pytest.approx(area * q_sca, rel=2e-5)


@pytest.fixture(scope="module")
def clear(tables: Path) -> DropletTable:
    """Without absorption, where resonances are finer than any table."""
    return droplet_table(wavelength_um=3.4, n=1.338, k=0.0, cache=tables)


def test_without_absorption_entries_are_means(clear: DropletTable) -> None:
    """Over +-1 % of the diameter, to 0.1 %; at single diameters resonances differ by more.

    A distribution, here flat from 4 to 14 um, keeps its mean to 0.1 %.
    """
    error = table_error(clear, samples=320)
    assert max(error) < 1e-3
    assert error[1] == 0.0
    d = np.linspace(4e-6, 14e-6, 3000)
    found = clear.cross_sections(d)[1]
    exact = _exact(clear, d)[1] * d**2 * np.pi / 4
    assert found.sum() == pytest.approx(exact.sum(), rel=1e-3)
    assert np.max(np.abs(found / exact - 1.0)) > 1e-3


def test_few_sizes_are_solved_exactly_where_resonances_are_fine(clear: DropletTable) -> None:
    """A monodisperse spray, or one of a few classes, has no distribution that means stand for:
    each size is Mie's solution, in any order and however often it occurs."""
    some = _diameters(40)
    d = np.concatenate([some, some[::-1], [1e-9, 2e-8]])
    c_abs, c_sca = clear.cross_sections(d)
    q_sca = np.concatenate([_exact(clear, some)[1], _exact(clear, some[::-1])[1]])
    assert c_sca[:-2] / (np.pi / 4 * d[:-2] ** 2) == pytest.approx(q_sca, rel=1e-9)
    assert np.all(c_abs == 0.0) and np.all(c_sca[-2:] > 0.0)
    assert clear.cross_sections(9e-6)[1].shape == ()
    assert clear.cross_sections(np.full((2, 3), 9e-6))[1].shape == (2, 3)
    assert clear.cross_sections(np.empty(0))[1].shape == (0,)


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "k",
    [
        *(pytest.param(k, marks=SLOW) for k in (0.0, 2e-3, 1e-5, 1e-4, 1e-3, 0.0341, 10.0)),
        pytest.param(1e-6, marks=pytest.mark.long),  # a minute: resonances of a millionth
    ],
)
def test_what_the_bench_prints(k: float, tables: Path) -> None:
    """Below 0.1 % over the whole range of sizes, distributions of 10 % among them."""
    assert check_table(wavelength_um=3.4, n=1.338, k=k, cache=tables).largest < 1e-3


def test_the_error_that_is_printed_is_an_error(paper: DropletTable) -> None:
    """A table of another liquid is found out."""
    assert max(table_error(paper)) < 2e-5
    assert table_error(replace(paper, k=0.035))[1] > 1e-3


@pytest.mark.parametrize("d", [0.0, -1e-6, 6e-4, float("nan"), float("inf")])
def test_outside_is_refused(paper: DropletTable, d: float) -> None:
    with pytest.raises(DropletError, match=r"outside 0\.\.0.0005 m"):
        paper.cross_sections(np.array([1e-6, d]))


@pytest.mark.parametrize(
    ("wavelength_um", "n", "k"),
    [(0.0, 1.3, 0.0), (3.4, 0.0, 0.0), (3.4, 1.3, -0.1), (float("nan"), 1.3, 0.1)],
)
def test_impossible_optics_are_refused(wavelength_um: float, n: float, k: float) -> None:
    with pytest.raises(DropletError, match="allowed: "):
        droplet_table(wavelength_um=wavelength_um, n=n, k=k, cache=None)


@pytest.mark.parametrize(
    ("n", "k"), [(10.0, 10.0), (1.0, 1e-3), *(pytest.param(n, 0.0, marks=SLOW) for n in (0.1, 1.0))]
)
def test_extreme_liquids(n: float, k: float) -> None:
    table = droplet_table(wavelength_um=3.4, n=n, k=k, cache=None)
    c_abs, c_sca = table.cross_sections(np.geomspace(1e-9, 5e-4, 50))
    assert np.all(np.isfinite(c_abs + c_sca)) and min(c_abs.min(), c_sca.min()) >= 0


def _same(one: DropletTable, two: DropletTable) -> bool:
    names = ("scattering", "absorption", "asymmetry", "log_x_start", "log_x_step")
    return all(np.array_equal(getattr(one, name), getattr(two, name)) for name in names)


def test_cache_gives_back_what_was_built(
    paper: DropletTable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "not yet" / "there"
    assert _same(droplet_table(**PAPER, cache=folder), paper)
    (file,) = folder.iterdir()
    # From here on only the file can give the table of the paper.
    monkeypatch.setattr(mie, "efficiencies", lambda **_: pytest.fail("built anew"))
    assert _same(droplet_table(**PAPER, cache=folder), paper)
    monkeypatch.undo()
    other = droplet_table(**{**PAPER, "k": 0.0342}, cache=folder)
    assert not _same(other, paper) and len(list(folder.iterdir())) == 2
    for damage in (b"", b"PK\x03\x04 nonsense", file.read_bytes()[:5000]):
        file.write_bytes(damage)
        assert _same(droplet_table(**PAPER, cache=folder), paper)
        assert len(file.read_bytes()) > 1e5
    assert replace(paper, n=1.0).n == 1.0


def test_many_sizes_are_those_of_each_alone(paper: DropletTable) -> None:
    """Sizes are looked up in parts; where a part ends does not matter."""
    d = np.exp(np.random.default_rng(1).uniform(np.log(1e-8), np.log(4e-4), 120_000))
    many = paper.efficiencies(d)
    for part in (slice(65_500, 65_600), slice(119_000, None)):
        for whole, few in zip(many, paper.efficiencies(d[part]), strict=True):
            np.testing.assert_array_equal(whole[part], few)


def test_droplets_of_millimetres() -> None:
    """Tables reach to 5 mm where a spray does; entries are Mie's solution, to their 0.1 %."""
    table = droplet_table(**PAPER, cache=None, largest_m=1e-3)
    diameter_m = np.array([7e-4, 1.234e-3, 4.9e-3])
    found = table.efficiencies(diameter_m)
    x = np.pi * diameter_m / (PAPER["wavelength_um"] * 1e-6)
    exact = mie.efficiencies(n=PAPER["n"], k=PAPER["k"], x=x)
    for got, expected in zip(
        found, (exact.extinction, exact.scattering, exact.asymmetry), strict=True
    ):
        np.testing.assert_allclose(got, expected, rtol=1e-3)
    with pytest.raises(DropletError, match=r"0\.006 m is outside .* allowed: up to 0\.005 m"):
        table.efficiencies(6e-3)


def test_tables_end_where_mie_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 0.5 um a size parameter of 1e4 is a droplet of 1.6 mm, whatever its entries are."""
    even = np.linspace(1.0, 2.0, 50_000)

    def solved(*, x: np.ndarray, **_: float) -> mie.Efficiencies:
        assert x.max() < mie.SIZE_PARAMETERS[1]
        return mie.Efficiencies(*(even[: len(x)] for _ in range(4)))

    monkeypatch.setattr(mie, "efficiencies", solved)
    monkeypatch.setattr(droplets, "check_by_miepython", lambda **_: None)
    table = droplet_table(wavelength_um=0.5, n=1.4, k=0.05, cache=None, largest_m=1e-3)
    assert 1.5e-3 < table.largest_m < 1e4 * 0.5e-6 / np.pi


def test_cache_that_cannot_be_written_costs_only_time(paper: DropletTable, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    assert _same(droplet_table(**PAPER, cache=blocked), paper)
