"""Records in words, for `tail`, the dashboard and the page of a run. Pure."""

from typing import Any

from daemon.events.records import Record


def record_words(record: Record) -> str | None:
    """A record in words; None for one of no interest to people."""
    match record["kind"]:
        case "look":
            scene = record.get("scene")
            if scene is None:  # an image of a calibration board: no part was sought
                return f"{record.get('purpose')}: pictures only"
            parts = ", ".join(map(_seen, scene.get("parts") or [])) or "nothing"
            return f"{record.get('purpose')}: {parts}"
        case "estimate":
            mm, deg = (record.get(name) or float("nan") for name in ("predicted_mm", "predicted_deg"))
            return f"{record.get('label')} to {mm:.2f} mm {deg:.2f} degrees"
        case "move":
            speed = f" at {record.get('speed_pct') or 0:.0f} %" + ("" if record.get("sent", True) else ", not sent")
            return f"{record.get('purpose')}: {record.get('how')} move{_place(record.get('target'))}{speed}"
        case "held_back":
            return f"{record.get('what')} withdrawn before it was sent"
        case "decision" | "cycle_end":
            return f"{record.get('text') or record.get('outcome')}: {record.get('why')}"
        case "cycle_start":
            return f"{record.get('cycle')}"
        case "hand":
            return "closes" if record.get("closed") else "opens"
        case "fault" | "refusal":
            return f"{record.get('code') or record.get('rule')}: {record.get('text')}"
        case "command":
            return f"{record.get('who')} at {record.get('door')}: {record.get('text')}"
        case "left":
            gripper = ", a part perhaps in the gripper" if record.get("hand_closed") else ""
            return f"run {record.get('run')} was cut off in state {record.get('state')}{gripper}"
        case "holding":
            return {True: "a part in the gripper", False: "the gripper is empty", None: "unknown"}[record.get("held")]
        case "auto" if record.get("on"):
            return f"{record.get('count') or 'all'} parts to pick"
        case "gap":
            return str(record.get("text") or record.get("why"))
        case "clock":
            return f"the machine's clock jumped by {record.get('jump_s')} s"
        case "note":
            return f"{record.get('text')} ({record.get('who')})"
        case "operator":
            return f"from now on {record.get('who')}"
        case "model":
            version = record.get("version")
            return "no model in use" if version is None else f"model version {version} in use ({record.get('action')})"
        case "eyes":
            return f"cameras in use: {record.get('alone') or 'both'}: {record.get('why')}"
        case "gained":
            look, about, before, after = (record.get(k) for k in ("look", "about", "before", "after"))
            return f"look {look} at {about}. Before: {before}. Now: {after}"
        case "uncounted":
            return str(record.get("text"))
        case "run_end":
            return str(ended_in_words(record))
        case _:
            return None


def _place(world_from_tool: Any) -> str:
    """The target of a move as text."""
    match world_from_tool:
        case [[*_, x], [*_, y], [*_, z], *_]:
            return f" to x {x:.0f} y {y:.0f} z {z:.0f} mm"
    return ""


def _seen(part: dict[str, Any]) -> str:
    """A part's name and its confidence, which an unnamed part does not have."""
    return "unknown" if part["label"] == "unknown" else f"{part['label']} {100 * part['confidence']:.0f} %"


def ended_in_words(end: Record | None) -> str | None:
    """Describe how a run ended, from its `run_end`; None where it has none."""
    why = (end or {}).get("why")
    return "switched off" if why == "signal SIGTERM" else why
