"""The pick's states as a diagram, made from its table of transitions (daemon/pick/transitions.py)."""

from __future__ import annotations

from daemon.pick.transitions import TABLE, PickState


def diagram() -> str:
    """A mermaid state diagram: the rows of every state; what leaves any state is a note."""
    lines = ["```mermaid", "stateDiagram-v2", "    [*] --> idle"]
    merged: dict[tuple[PickState, PickState], list[str]] = {}
    for row in TABLE:
        if PickState.ANY not in (row.state, row.then) and PickState.BACK not in (row.state, row.then):
            merged.setdefault((row.state, row.then), []).append(row.event)
    lines += [f"    {state} --> {then}: {', '.join(events)}" for (state, then), events in merged.items()]
    everywhere = [f"{row.event} leads to {row.then}" for row in TABLE if row.state is PickState.ANY]
    lines += ["    note right of fault", f"        from every state: {'; '.join(everywhere)}", "    end note", "```"]
    return "\n".join(lines) + "\n"


def table() -> str:
    """The table of transitions for people."""
    rows = [f"| `{row.state}` | `{row.event}` | `{row.then}` | {row.meaning} |" for row in TABLE]
    return "\n".join(["| in the state | the event | leads to | meaning |", "| --- | --- | --- | --- |", *rows]) + "\n"
