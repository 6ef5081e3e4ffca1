"""Check a record against the schema of records."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from daemon.events.codes import CauseCode, DecisionCode
from daemon.events.outcomes import Outcome
from daemon.events.records import SCHEMA

FIELDS: Mapping[str, frozenset[str]] = {
    kind: frozenset(field.encode_name for field in msgspec.structs.fields(shape)) for kind, shape in SCHEMA.items()
}
"""The names of a kind's fields in a line of the log."""
CODES = {
    "fault": frozenset(CauseCode),
    "decision": frozenset({*DecisionCode, *CauseCode}),
    "cycle_end": frozenset({*DecisionCode, *CauseCode, None}),
}


def checked(kind: str, fields: Mapping[str, Any]) -> None:
    """Check that kind, fields, code and outcome are in the schema; no reader uses others. Raises AssertionError."""
    assert kind in FIELDS, f"a record of a kind that the schema does not have: {kind}"
    unknown = set(fields) - FIELDS[kind]
    assert not unknown, f"{kind}: fields that the schema does not have: {sorted(unknown)}"
    if kind in CODES:
        assert fields.get("code") in CODES[kind], f"{kind}: no code of the catalogue: {fields.get('code')!r}"
    if kind == "cycle_end":
        assert fields["outcome"] in set(Outcome)
