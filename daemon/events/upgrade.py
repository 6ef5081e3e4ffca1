"""Records of earlier releases -> records as today's release writes them: one step, taken where a line is read."""

from __future__ import annotations

import re
from typing import Any

from daemon.events.outcomes import Outcome

VERSION = 2
"""Of the lines that are written: `v`. Version 1 had prose where version 2 has codes."""
BY_A_PERSON = re.compile(r"stopped\b(?! by itself)|by control-C")


def upgraded(record: dict[str, Any]) -> dict[str, Any]:
    """A record as version 2 has it. One of a newer version, and one without a version, is left as it is."""
    return _of_version_1(record) if record.get("v") == 1 else record


def _of_version_1(record: dict[str, Any]) -> dict[str, Any]:
    ended_by_fault = record.get("kind") == "cycle_end" and record.get("outcome") == "fault"
    if ended_by_fault and BY_A_PERSON.match(str(record.get("why"))):
        return {**record, "outcome": str(Outcome.ABORTED)}
    return record
