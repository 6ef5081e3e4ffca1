"""Parts taught from the rendered scenes made for it."""

from __future__ import annotations

from pathlib import Path

import pytest

from daemon.teaching.trainer import Trainer
from tests.fakes import rendered


def scenes(kind: str) -> list[Path]:
    found = sorted(rendered.ALL.glob(f"{kind}-B-*"))
    if not found:
        here = rendered.ALL
        pytest.skip(f"the scenes that parts are taught from are not here ({here}); FACETD_SHARED says where they are")
    return found


def taught(trainer: Trainer, *only: str) -> list[str]:
    """Store the view of every part, or of those alone; returns their labels."""
    labels = []
    for scene in scenes("train"):
        label = rendered.truth(scene)["objects"][0]["label"]
        if not only or label in only:
            trainer.store(label, *rendered.pair(scene), {})
            labels.append(label)
    return labels
