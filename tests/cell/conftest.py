"""One taught model for all end-to-end tests."""

import asyncio

import pytest

from daemon.store.model import load, save
from tests.fakes import simulated_cell
from tests.fakes.once import made_once


@pytest.fixture(scope="session")
def model(tmp_path_factory):
    async def teach():
        async with simulated_cell.rig(seed=100) as here:
            return await simulated_cell.taught(here)

    folder = made_once(tmp_path_factory, "taught", lambda folder: save(asyncio.run(teach()), folder / "model.npz"))
    return load(folder / "model.npz")
