"""The budget of a picture's errors: sums, unknown causes, and what stands in run.json."""

from __future__ import annotations

import json

import pytest
from pydantic import TypeAdapter

from cldit.accuracy.errors import Cause, Errors
from cldit.accuracy.remarks import too_large
from cldit.accuracy.resolution import too_fine, too_many


@pytest.mark.parametrize(("error_K", "remarks"), [(0.1, 0), (0.1049, 0), (0.1051, 1)])
def test_an_error_exceeds_its_tolerance_as_it_is_printed(error_K: float, remarks: int) -> None:
    assert len(too_large(Errors.of([Cause("cells", error_K, "x")]), 0.1, {})) == remarks


def test_squares_add_up() -> None:
    errors = Errors.of([Cause("cells", 3.0, "coarser"), Cause("ordinates", 4.0, "halves")])
    assert errors.total_K == pytest.approx(5.0)
    assert errors.text == "5 K"
    assert not errors.unknown
    largest = errors.largest()
    assert largest is not None and largest.name == "ordinates"


def test_what_nobody_knows_is_no_zero() -> None:
    errors = Errors.of([Cause("cells", 0.5, "coarser"), Cause("gas grid", None, "imported")])
    assert errors.total_K == 0.5
    assert errors.unknown == ("gas grid",)
    assert errors.text == "at least 0.5 K"
    assert Errors.of([Cause("gas grid", None, "imported")]).text == "unknown"


def test_nothing_is_wrong_where_nothing_is() -> None:
    """No cause is neither an unknown one nor one of 0 K."""
    errors = Errors.of([])
    assert errors.text == "none: nothing is in the way"
    assert errors.total_K is None and not errors.unknown and not errors.exceed(0.0)
    assert too_large(errors, 0.1, {}) == ()


@pytest.mark.parametrize("error_K", [-1.0, float("nan")])
def test_no_error_is_negative_or_nan(error_K: float) -> None:
    with pytest.raises(ValueError, match=r"cells: error_K .*; allowed: 0 or more, or None"):
        Cause("cells", error_K, "coarser")


def test_json_gives_back_the_same() -> None:
    errors = Errors.of(
        [Cause("cells", 0.5, "coarser", "domain.leaf_edge_m"), Cause("gas grid", None, "imported")],
        [Cause("optical data", 3.0, "another n and k")],
    )
    assert errors.total_K == 0.5  # the model's spread is beside it
    data = json.loads(json.dumps(errors.to_dict(), allow_nan=False))
    assert data["at_least"] is True
    assert TypeAdapter(Errors).validate_python(data) == errors
    old = {"causes": [{"name": "cells", "error_K": 0.5, "how": "coarser", "fixed": ""}]}
    assert TypeAdapter(Errors).validate_python(old) == Errors.of([Cause("cells", 0.5, "coarser")])


def test_more_than_asked_says_what_and_how() -> None:
    """The largest cause, the key that holds it, and what is allowed; as it is printed."""
    errors = Errors.of([Cause("cells", 1.4, "x", "domain.leaf_edge_m"), Cause("trace", 0.2, "x")])
    (text,) = too_large(errors, 1.0, {})
    assert text.startswith("stated error 1.4 K RMS, more than transport.accuracy_K: 1 asks for")
    said = (
        "cells contribute 1.4 K, set by domain.leaf_edge_m; allowed: a smaller domain.leaf_edge_m"
    )
    assert text.endswith(f"{said}, or none, so that the run chooses")
    assert too_large(errors, 1.4, {}) == ()
    assert too_large(Errors.of([Cause("cells", None, "x")]), 1.0, {}) == ()


@pytest.mark.parametrize(
    ("why", "allowed"),
    [
        (too_many(1e-4), "0.1 mm cells exceed memory; allowed: a machine with more"),
        (too_fine(1.4e-4), "the cone allows no lattice finer than 0.14 mm; allowed: a larger"),
    ],
)
def test_limits_say_what_helps_there(why: str, allowed: str) -> None:
    """A key that the limit overrules is no advice."""
    errors = Errors.of([Cause("cells", 0.64, "x")])
    (text,) = too_large(errors, 0.5, {"cells": why})
    assert f"cells contribute 0.64 K; {allowed}" in text
    assert text.count("allowed:") == 1 and "leaf_edge_m" not in text
    (other,) = too_large(Errors.of([Cause("trace", 0.64, "x")]), 0.5, {"cells": why})
    assert why not in other


@pytest.mark.parametrize(
    ("name", "key", "allowed"),
    [
        ("trace", "", "more transport.directions or a larger transport.max_samples"),
        ("trace", "transport.directions", "more transport.directions, or none"),
        ("cells", "domain.rule", "domain.rule: need, or a smaller domain.leaf_edge_m"),
        ("cells", "", "a smaller domain.leaf_edge_m"),
        ("wavelengths", "optics.spectral_error_K", "a smaller optics.spectral_error_K, or none"),
        ("wavelengths", "optics.wavelengths", "more optics.wavelengths, or none"),
        ("size classes", "", "more spray.size_classes"),
        ("gas grid", "spray.spacing_m", "a smaller spray.spacing_m, or none"),
    ],
)
def test_advice_names_the_key_that_helps(name: str, key: str, allowed: str) -> None:
    """To leave a key out is advice only where the scene sets it, and the run would choose."""
    (text,) = too_large(Errors.of([Cause(name, 2.0, "x", key)]), 1.0, {})
    assert f"; allowed: {allowed}" in text
    assert text.endswith("so that the run chooses") == (key not in ("", "domain.rule"))
