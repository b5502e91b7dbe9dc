"""Sources, state and sums of the gas against NumPy, and what padded cells may do."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.gpu.buffers import download, upload
from cldit.spray.flow.gas import GasFlow

from .gas_twin import (
    TEMPERATURE_K,
    PRESSURE_Pa,
    assert_close,
    drawn,
    get,
    launch,
    mixture,
    pressure_of,
    put,
    sums_of,
    temperature_of,
)


def test_sources(gas_flow: GasFlow) -> None:
    """Rise of the pressure by the whole sources, and a fourth of them added to the cells."""
    flow, real, gas = gas_flow, gas_flow.fields.real, mixture()
    density, share = drawn(flow, low=2.0, high=5.0), drawn(flow, low=0.0, high=0.4)
    kelvin, velocity = drawn(flow, low=400.0, high=650.0), drawn(flow, 3)
    amounts, amiss = drawn(flow, 5), 1e-2 * drawn(flow)
    amounts[0] = np.where(amounts[0] > 0.5, amounts[0], 0.0)
    amounts[1] = -1e5 * amounts[0]
    enthalpy = density * gas.enthalpy_J_kg(share, kelvin)
    for name, planes in (
        ("density", density), ("fuel", share * density), ("enthalpy", enthalpy),
        ("temperature", kelvin), ("velocity", velocity), ("amounts", amounts), ("amiss", amiss),
    ):  # fmt: skip
        put(flow, name, planes)
    launch(flow, "sources", "source_pressure")
    heavy, vapour = density + amounts[0], share * density + amounts[0]
    warm = temperature_of(gas, vapour / heavy, (enthalpy + amounts[1]) / heavy)
    own = pressure_of(gas, heavy, vapour, warm)
    rise = np.where(amounts[0] > 0, own / PRESSURE_Pa - 1 - amiss, 0.0)
    # Enthalpies are sums of terms that cancel about the reference temperature.
    assert_close(flow.read("rise"), rise, real, roundings=300)
    assert not flow.read("rise")[amounts[0] == 0].any()
    put(flow, "rise", rise)
    launch(flow, "sources", "receive", part=0.25)
    after = density + 0.25 * amounts[0]
    moving = (velocity * density + 0.25 * amounts[2:]) / after
    for name, wanted in (
        ("density", after),
        ("fuel", share * density + 0.25 * amounts[0]),
        ("enthalpy", enthalpy + 0.25 * amounts[1]),
        ("velocity", moving),
        ("amiss", amiss + 0.25 * rise),
        ("mass", after * flow.grid.volume_m3),
    ):
        assert_close(flow.read(name), wanted, real, roundings=8)


def test_the_state_after_a_step(gas_flow: GasFlow) -> None:
    """Momentum moves with the mass that was carried; temperatures follow from enthalpies."""
    flow, real, gas = gas_flow, gas_flow.fields.real, mixture()
    volume = flow.grid.volume_m3
    after, carried = (
        drawn(flow, low=2.0, high=5.0) * volume,
        drawn(flow, low=2.0, high=5.0) * volume,
    )
    share, kelvin = drawn(flow, low=0.0, high=0.4), drawn(flow, low=400.0, high=650.0)
    velocity, force = drawn(flow, 3), drawn(flow, 3) * volume
    enthalpy, guess = gas.enthalpy_J_kg(share, kelvin), kelvin + 50.0 * drawn(flow)
    for name, planes in (
        ("after", after), ("carried", carried), ("values", np.stack([share, enthalpy])),
        ("force", force), ("velocity", velocity), ("temperature", guess),
    ):  # fmt: skip
        put(flow, name, planes)
    launch(flow, "state", "finish")
    density = after / volume
    own = volume * pressure_of(gas, density, share * density, kelvin)
    assert_close(flow.read("velocity"), (velocity * carried + force) / after, real)
    # Three steps of Newton's method from 50 K away leave less than 1e-6 K; single precision of the
    # enthalpy, 1e5 J/kg of cp 1e3, rounds by 1e-5 K, summed over the terms.
    eps = float(np.finfo(real).eps)
    assert (
        np.abs(flow.read("temperature") - kelvin).max() < 1e-6 + 3000 * eps * 1.0 + 16 * eps * 650
    )
    assert_close(flow.read("own"), own, real, roundings=64 if real is np.float32 else 1e7)
    for name, wanted in (
        ("density", density), ("fuel", share * density), ("enthalpy", enthalpy * density)
    ):  # fmt: skip
        assert_close(flow.read(name), wanted, real, roundings=8)
    for name, planes in (
        ("density", density), ("fuel", share * density), ("enthalpy", enthalpy * density)
    ):  # fmt: skip
        put(flow, name, planes)
    launch(flow, "state", "per_mass")
    assert_close(get(flow, "values", 2)[0], share, real, roundings=8)
    assert_close(get(flow, "values", 2)[1], enthalpy, real, roundings=8)
    assert_close(flow.read("mass"), after, real, roundings=8)


def test_a_jet_of_gas_has_the_kinetic_energy_of_its_share(gas_flow: GasFlow) -> None:
    """Enthalpies at rest are higher by (Y u)^2 / 2; the tolerance is that of the test above."""
    flow, real, gas, speed = gas_flow, gas_flow.fields.real, mixture(), 600.0
    after = drawn(flow, low=2.0, high=5.0) * flow.grid.volume_m3
    share, kelvin = drawn(flow, low=0.0, high=0.4), drawn(flow, low=400.0, high=650.0)
    rest = gas.enthalpy_J_kg(share, kelvin) + 0.5 * (share * speed) ** 2
    for name, planes in (
        ("after", after), ("carried", after), ("values", np.stack([share, rest])),
        ("force", np.zeros((3, *after.shape))), ("temperature", kelvin + 20.0),
    ):  # fmt: skip
        put(flow, name, planes)
    launch(flow, "state", "finish", jet_speed=speed)
    eps = float(np.finfo(real).eps)
    assert np.abs(flow.read("temperature") - kelvin).max() < 1e-6 + (3000 + 16 * 650) * eps


def test_sums_and_compression(gas_flow: GasFlow) -> None:
    """The sum of a plane without padded cells; enthalpy rises by V dp."""
    flow, real, step_s = gas_flow, gas_flow.fields.real, 1e-5
    volume, eps = flow.grid.volume_m3, float(np.finfo(gas_flow.fields.real).eps)
    own = PRESSURE_Pa * (1.01 + 0.01 * drawn(flow)) * volume
    enthalpy, density = 1e5 * drawn(flow), drawn(flow, low=1.0, high=5.0)
    kept, share = drawn(flow), drawn(flow, 2, low=0.2, high=1.0)
    for name, planes in (
        ("own", own), ("enthalpy", enthalpy), ("density", density), ("kept", kept), ("share", share)
    ):  # fmt: skip
        put(flow, name, planes, junk=1e9)
    flow._add_up(flow.arguments["own"], 0, 1.0 / float(volume.sum()))()
    mean = float(own.sum() / volume.sum())
    assert sums_of(flow)[0] == pytest.approx(mean, rel=50 * eps)
    assert sums_of(flow)[1] == pytest.approx(PRESSURE_Pa, rel=eps)
    known = np.array([mean, PRESSURE_Pa, 0.0, 0.0])
    flow.arguments["common"] = upload(flow.device, "common", known.astype(real))
    launch(flow, "state", "compress", step=step_s)
    error = own / volume / mean - 1
    rise = float(real(mean)) - PRESSURE_Pa
    assert_close(flow.read("enthalpy"), enthalpy + rise, real, roundings=8)
    # Near 1 the quotient rounds by eps.
    assert np.abs(flow.read("amiss") - error).max() < 8 * eps
    wanted = share.min(axis=0) * (kept + density * error / step_s)
    assert np.abs(flow.read("kept") - wanted).max() < 8 * eps * (1.0 + 5.0 / step_s)


def test_sums_of_parcels_become_fields(gas_flow: GasFlow) -> None:
    """Units per volume of all copies; padded cells have none."""
    flow, f = gas_flow, gas_flow.fields
    random = np.random.default_rng(1)
    sums = random.integers(-(2**40), 2**40, 2 * f.cells)
    units = np.array([2.0**-30, 2.0**-35])
    launch(
        flow, "receipt", "as_fields", kinds=2,
        sums=upload(flow.device, "sums", sums), fields=flow.arguments["values"],
        units=f.table("units", units), copies=flow.grid.copies,
    )  # fmt: skip
    shape = (*flow.grid.shape[:2], f.stride)
    guard = (f.cells - int(np.prod(shape))) // 2
    rows = sums.reshape(2, f.cells)[:, guard:-guard].reshape(2, *shape)
    own = rows[..., : flow.grid.shape[2]] * units[:, None, None, None]
    wanted = own / (flow.grid.copies * flow.grid.volume_m3)
    assert_close(get(flow, "values", 2), wanted, f.real, roundings=8)


def test_padded_cells_change_nothing_and_stay_finite(gas_flow: GasFlow) -> None:
    """A step with other numbers in them has the same bits; after twenty steps they are finite,
    since a real cell reads them times zero."""
    flow = gas_flow
    results = []
    for junk in (1.0, 5.0):
        velocity, amounts = 20.0 * drawn(flow, 3), 0.02 * drawn(flow, 5, low=0.0)
        amounts[1] *= -3e5
        for name, planes in (
            ("density", np.full(flow.grid.shape, flow.far_density_kg_m3)),
            ("velocity", velocity), ("fuel", 0 * velocity[0]), ("enthalpy", 0 * velocity[0]),
            ("temperature", np.full(flow.grid.shape, TEMPERATURE_K)), ("amounts", amounts),
            ("amiss", 0 * velocity[0]), ("kept", 0 * velocity[0]), ("flux", 0 * velocity),
        ):  # fmt: skip
            # A flux of a padded cell is that through the outer wall; kernels write 0.
            put(flow, name, planes, junk=0.0 if name == "flux" else junk)
        sums = np.array([PRESSURE_Pa, PRESSURE_Pa, 0.0, 0.0], flow.fields.real)
        flow.sums = flow.arguments["common"] = flow.arguments["sums"] = upload(
            flow.device, "s", sums
        )
        for name in ("density", "velocity", "fuel", "enthalpy", "temperature"):
            setattr(flow, name, flow.arguments[name])
        flow._source_pressure = flow._bind("sources", "source_pressure")
        flow._steps = flow._launches()
        flow.step(2e-6)
        results.append(np.concatenate([flow.read("velocity"), flow.read("density")[None]]))
        flow.step(4e-5, steps=20)
        plane_bytes = flow.fields.cells * np.dtype(flow.fields.real).itemsize
        for name, buffer in flow.arguments.items():
            if getattr(buffer, "size", 0) >= plane_bytes:
                planes = buffer.size // plane_bytes
                whole = np.empty(planes * flow.fields.cells, flow.fields.real)
                assert np.isfinite(download(flow.device, buffer, whole)).all(), name
    assert np.abs(results[0][:3]).max() > 1.0
    np.testing.assert_array_equal(results[0], results[1])
