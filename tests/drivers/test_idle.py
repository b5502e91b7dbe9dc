"""A session closed while idle continues: `cldit.testing.idle`, for every installed driver."""

from __future__ import annotations

import pytest

from cldit.testing.idle import check_idle
from tests.beds import in_tiers, make_of


@pytest.mark.parametrize(("driver", "variant"), in_tiers())
def test_an_idle_session_is_opened_again(driver: str, variant: str) -> None:
    assert check_idle(make_of(driver, variant, {})) >= 3
