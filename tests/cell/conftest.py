"""One taught model for all end-to-end tests."""

import pytest

from tests.fakes.simulated_cell import taught_once


@pytest.fixture(scope="session")
def model(tmp_path_factory):
    return taught_once(tmp_path_factory)
