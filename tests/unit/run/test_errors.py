"""The budget of a picture's errors: sums, unknown causes, and what stands in run.json."""

from __future__ import annotations

import json

import pytest

from cldit.run.errors import Cause, Errors


def test_squares_add_up() -> None:
    errors = Errors.of([Cause("cells", 3.0, "coarser"), None, Cause("ordinates", 4.0, "halves")])
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
    assert Errors.of([]).total_K is None


@pytest.mark.parametrize("error_K", [-1.0, float("nan")])
def test_no_error_is_negative_or_nan(error_K: float) -> None:
    with pytest.raises(ValueError, match=r"cells: error_K .*; allowed is 0 or more, or None"):
        Cause("cells", error_K, "coarser")


def test_json_gives_back_the_same() -> None:
    errors = Errors.of(
        [Cause("cells", 0.5, "coarser", "domain.leaf_edge_m"), Cause("gas grid", None, "imported")],
        [Cause("optical data", 3.0, "another n and k")],
    )
    assert errors.total_K == 0.5  # the model's spread is beside it
    data = json.loads(json.dumps(errors.to_dict(), allow_nan=False))
    assert data["at_least"] is True
    assert Errors.from_dict(data) == errors


def test_errors_of_runs_before_the_model_had_a_spread() -> None:
    data = {"causes": [{"name": "cells", "error_K": 0.5, "how": "coarser", "fixed": ""}]}
    assert Errors.from_dict(data) == Errors.of([Cause("cells", 0.5, "coarser")])


def test_more_than_asked_says_what_and_how() -> None:
    """The largest cause, the key that holds it, and what is allowed; as it is printed."""
    errors = Errors.of([Cause("cells", 1.4, "x", "domain.leaf_edge_m"), Cause("trace", 0.2, "x")])
    (text,) = errors.remarks(1.0)
    assert text.startswith("stated error 1.4 K RMS, more than transport.accuracy_K: 1 asks for")
    assert "cells make 1.4 K, held by domain.leaf_edge_m; allowed is a smaller" in text
    assert (
        "memory holds" in errors.remarks(1.0, "cells of 1 mm are the finest that memory holds")[0]
    )
    assert errors.remarks(1.4) == ()
    assert Errors.of([Cause("cells", None, "x")]).remarks(1.0) == ()
