"""Labelled data sets: coordinates, units, errors as ancillary variables, and files of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from cldit.dit.maps import Maps, Reason
from cldit.radiance.weights import Weights
from cldit.run.labelled import labelled
from cldit.scene import Scene, load_scene
from tests.extras import needs

pytestmark = needs("xarray", extra="studies")
SHAPE = (3, 4)
PIXEL_M = (0.04, 0.03)


def scene() -> Scene:
    return load_scene("gdi-cone").with_(
        **{
            "camera.pixels": [4, 3],
            "camera.field_m": [0.16, 0.09],
            "camera.target_m": [0.01, 0, -0.05],
        }
    )


def maps() -> Maps:
    values = [np.full(SHAPE, number, np.float32) for number in range(6)]
    emissivity, temperature, error, error_K, chi2, chance = values
    reason = np.zeros(SHAPE, np.uint8)
    return Maps(emissivity, temperature, error, error_K, reason, chi2, chance, chance)


def weights() -> Weights:
    return Weights(*(np.full(SHAPE, number, np.float32) for number in range(4)))


def test_pixels_lie_where_the_camera_saw_them() -> None:
    data = labelled(scene(), maps(), pixel_m=PIXEL_M)
    assert data.x.values == pytest.approx([-50.0, -10.0, 30.0, 70.0])
    assert data.z.values == pytest.approx([-20.0, -50.0, -80.0])  # row 0 is at the top
    assert (data.x.units, data.z.units) == ("mm", "mm")


def test_maps_name_their_errors_and_codes() -> None:
    data = labelled(scene(), maps(), pixel_m=PIXEL_M)
    for name in data.apparent_temperature_K.ancillary_variables.split():
        assert name in data
    assert data.apparent_temperature_K.units == "K"
    assert data.apparent_temperature_K.standard_name == "brightness_temperature"
    assert data.optical_depth.units == "1"
    every = {"total": np.ones(SHAPE, np.float32), "size classes": np.ones(SHAPE, np.float32)}
    more = labelled(scene(), maps(), pixel_m=PIXEL_M, error_maps=every)
    assert set(more.apparent_temperature_K.ancillary_variables.split()) == {
        "apparent_temperature_standard_error_K",
        "reason",
        "simulation_error_K",
        "simulation_error_size_classes_K",
    }
    assert "simulation" not in more.emissivity.ancillary_variables
    both = labelled(scene(), maps(), pixel_m=PIXEL_M, emissivity_error_maps=every)
    assert both.emissivity_simulation_error.units == "1"
    assert set(both.emissivity.ancillary_variables.split()) == {
        "emissivity_standard_error",
        "reason",
        "emissivity_simulation_error",
        "emissivity_simulation_error_size_classes",
    }
    assert data.reason.flag_meanings.split()[Reason.SATURATED] == "saturated"
    assert "weight_background" not in data


Engine = Literal["h5netcdf", "zarr"]


def plain(attributes: dict[Any, Any]) -> dict[Any, Any]:
    return {key: np.asarray(value).tolist() for key, value in attributes.items()}


@pytest.mark.parametrize("engine", ["h5netcdf", "zarr"])
def test_files_of_it_read_back(tmp_path: Path, engine: Engine) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip(engine, reason="the extra studies is not installed")
    data = labelled(
        scene(),
        maps(),
        pixel_m=PIXEL_M,
        weights=weights(),
        error_maps={"total": np.full(SHAPE, 2.0, np.float32), "cells": np.ones(SHAPE, np.float32)},
        attrs={"errors": json.dumps({"total_K": 1})},
    )
    path = tmp_path / f"run.{engine}"
    if engine == "zarr":
        data.to_zarr(path, zarr_format=2, consolidated=True)
    else:
        data.to_netcdf(path, engine=engine)
    back = xarray.open_dataset(path, engine=engine, mask_and_scale=False)
    assert back.equals(data)
    for name in data.variables:
        kept = {key: back[name].attrs[key] for key in data[name].attrs}  # a file adds _FillValue
        assert plain(kept) == plain(data[name].attrs)
    assert json.loads(back.attrs["errors"]) == {"total_K": 1}
    assert float(back.simulation_error_K.max()) == 2.0
    assert back.weight_liquid.values == pytest.approx(weights().liquid)
