"""One taught model for all end-to-end tests."""

import asyncio

import pytest

from tests.worlds import simulated_cell


@pytest.fixture(scope="session")
def model():
    async def teach():
        async with simulated_cell.rig(seed=100) as here:
            return await simulated_cell.taught(here)

    return asyncio.run(teach())
