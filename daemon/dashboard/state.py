"""State of the dashboard, updated by records, status and notices as they come. Pure."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

from daemon.cell.recorded_arm import RecordedArm
from daemon.events.records import Json, Record
from daemon.review.cli import record_line
from daemon.review.digest import LookStep
from daemon.review.pagedata import stop_json
from daemon.review.space import is_arrival, joints_over, moments_of, space_of, way_of

SHOWN = (
    *("state", "doing", "target", "stop", "fault", "pending", "enabled", "paused", "auto"),
    *("picked", "tried", "failed", "aborted", "cell", "model", "troubles", "each_place", "up_s"),
)
"""Fields of the daemon's status on the page."""
STARTED = ("name", "cell", "version", "utc_offset_s", "limits", "config", "arm")
"""Fields of the run's first record that are kept."""
LOOKS = 4
"""Looks whose images stay available."""
DRAWN = ("move", "moved", "look", "hand", "refusal", "fault")
"""Records that change what is in space."""
RECENT = 1000
"""Most of them that are kept."""


@dataclass
class DashboardState:
    """All that the page shows. daemon: its status, None without an answer; version: counts the changes."""

    daemon: Json | None = None
    run: str | None = None
    start: Json = field(default_factory=dict)
    look: Json | None = None
    pictures: dict[int, Mapping[str, str]] = field(default_factory=dict)
    """Files of the last looks, by record and camera: a viewer may still load those of the look before."""
    recent: deque[Record] = field(default_factory=lambda: deque(maxlen=RECENT))
    """The DRAWN records since the last cycle began, after the last arrival before it."""
    approach: list[Json] = field(default_factory=list)
    picks: deque[Json] = field(default_factory=lambda: deque(maxlen=20))
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=40))
    version: int = 0
    _began_s: float = 0.0

    def answered(self, status: Json | None) -> None:
        """Take over the daemon's status; None: no daemon answers."""
        daemon = None if status is None else {key: status.get(key) for key in SHOWN}
        steady = {**(daemon or {}), "up_s": None} == {**(self.daemon or {}), "up_s": None}
        if not steady or (daemon is None) != (self.daemon is None):
            self.version += 1
        self.daemon = daemon

    def noticed(self, text: str) -> None:
        """Add a notice of the daemon."""
        self.lines.append(text)
        self.version += 1

    def began(self, run: str) -> None:
        """Start with another run."""
        self.run, self.look, self.pictures = run, None, {}
        self.approach.clear()
        self.recent.clear()
        self.version += 1

    def recorded(self, record: Record) -> None:
        """Take over a record of the run. Raises nothing, whatever the record."""
        kind = record.get("kind")
        try:
            self._fold(str(kind), record)
            line = record_line(record, self.start.get("utc_offset_s") or 0)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
            return  # a record of another version
        if line is not None:
            self.lines.append(line)
        self.version += 1

    def _fold(self, kind: str, record: Record) -> None:
        if kind in DRAWN:
            self.recent.append(record)
        if kind == "run_start":
            self.start = {name: record.get(name) for name in STARTED}
        elif kind == "cycle_start":
            arrivals = [arrival for arrival in self.recent if is_arrival(arrival)]
            self.recent.clear()
            self.recent.extend(arrivals[-1:])
            self.approach.clear()
            self._began_s = float(record["mono_s"])
        elif kind == "look":
            self.look = stop_json(LookStep(record.get("stop"), str(record.get("purpose")), record, None, ()))
            recent = list(self.pictures.items())[1 - LOOKS :]
            self.pictures = dict([*recent, (int(record["seq"]), dict(record.get("images") or {}))])
        elif kind == "estimate":
            error = {"mm": record.get("predicted_mm"), "deg": record.get("predicted_deg")}
            self.approach.append({"look": record.get("stop"), **error, "label": record.get("label")})
        elif kind == "cycle_end":
            seconds = round(float(record["mono_s"]) - self._began_s, 1) if self._began_s else None
            same = {name: record.get(name) for name in ("t", "label", "outcome", "why", "stopped")}
            self.picks.append({"n": record.get("cycle"), **same, "s": seconds})

    def json(self) -> Json:
        return {
            "daemon": self.daemon,
            "run": self.run,
            "start": self.start,
            "look": self.look,
            "cameras": [] if self.look is None else sorted(self.pictures.get(self.look["seq"], {})),
            "approach": self.approach,
            "picks": list(self.picks),
            "lines": list(self.lines),
        }

    def space(self, arm: RecordedArm | None) -> Json:
        """Where arm and parts are now, mm in the world, and the way since the cycle began. moment None: no record."""
        moments = moments_of(self.recent, 0.0)
        arrivals = [record for record in self.recent if is_arrival(record)]
        drawn = space_of(arm, joints_over(arrivals, moments[-1:]), way_of(arrivals, self.recent, arm))
        return {"moment": moments[-1] if moments else None, **drawn}
