"""What the tests of teaching share: a trainer with nothing taught yet."""

from __future__ import annotations

from pathlib import Path

import pytest

from daemon.store.library import load_facets, load_parts
from daemon.store.model_store import ModelStore
from daemon.teaching.trainer import Trainer
from tests.fakes import rendered


@pytest.fixture
def trainer(tmp_path: Path) -> Trainer:
    return Trainer(ModelStore(tmp_path), rendered.rig(rendered.HERE, "B"), load_facets(), load_parts())
