"""Independent motion monitor: checks every motion of the simulated arm, by any cause, against a cell's safety rules.

It reads the machine's history and a few facts that the test reports (for example when the arm was enabled). It uses
neither the bytes of the line nor anything that the daemon believes. For each motion it reports the worst violation of
each rule. Times are the controller's seconds, lengths mm.
"""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil, isfinite

import numpy as np

from drivers.arrays import Array
from drivers.puma560 import ArmGeometry, elbow_mm, forward
from drivers.rigid import inverse
from drivers.simcell.arm import Motion
from drivers.simcell.history import (
    CONTROL_C,
    DropRecord,
    GraspRecord,
    GripperRecord,
    History,
    HistoryRecord,
    MotionRecord,
    ReleaseRecord,
    StopRecord,
)
from drivers.simcell.truth import Box, Rod, Safety, TableTruth

SAMPLE_MM = 5.0
"""The most that a sphere of the body moves between two samples, unless every obstacle is twice as far away."""
SAMPLE_S, SHORTEST_S = 0.05, 1e-4
SPHERE_SPACING_MM = 10.0
HALF_TURN_OF_2 = np.array([0.0, np.pi, 0.0, 0.0, 0.0, 0.0])
REST_TOLERANCE_S = 0.05
"""How long before it is at rest a braking arm may show two readings that agree."""
TYPING_S = 0.1
"""The time to type the whole line of a move that was released just before moves were held."""
POSITION_AGE_S = 0.5
"""The longest time between reading the arm's position and typing a move: the daemon cannot know what others do in
between."""
PRESS_MM = 1.0
"""How far a part in the gripper may be pressed onto the table: fingers and pads yield by more."""
PART = "the part: "
"""Before a rule: of the part in the gripper, not of the arm's body."""
TOLERANCE_MM = 0.5
"""The tolerance of lengths, for the arm's repeatability."""


@dataclass(frozen=True)
class Violation:
    """A broken rule: its name, the time, the typed line that caused it, and the details."""

    rule: str
    at_s: float
    by: str
    text: str

    def __str__(self) -> str:
        return f"{self.rule} at {self.at_s:.3f} s, `{self.by}`: {self.text}"


class Timeline:
    """A value that changes over time: each value with the time from which it applies. A call sets the next value."""

    def __init__(self, first: float) -> None:
        self._times, self._values = [float("-inf")], [first]

    def __call__(self, at_s: float, value: float = True) -> None:
        """Set the value from at_s on. Calls may come late, but in the order of their times."""
        self._times.append(max(at_s, self._times[-1]))
        self._values.append(value)

    def at(self, moment_s: float) -> float:
        return self._values[bisect_right(self._times, moment_s) - 1]

    def true_before(self, moment_s: float) -> float:
        """When a true value was last set, up to a moment; -inf: never."""
        here = bisect_right(self._times, moment_s)
        return next((self._times[k] for k in range(here - 1, -1, -1) if self._values[k]), float("-inf"))

    def set_within(self, start_s: float, end_s: float, value: float) -> float | None:
        """When a value was first set after start_s, up to end_s; None: not in that time."""
        within = range(bisect_right(self._times, start_s), bisect_right(self._times, end_s))
        return next((self._times[k] for k in within if self._values[k] == value), None)


class ArmSpheres:
    """The arm as spheres in the world: each rod is a row of spheres at most SPHERE_SPACING_MM apart."""

    def __init__(self, rods: Sequence[Rod], arm: ArmGeometry, joint_offsets_rad: Array) -> None:
        """arm, joint_offsets_rad (6,): the true ones."""
        self._arm, self._offsets, self._tool_from_flange = arm, joint_offsets_rad, inverse(arm.flange_from_tool)
        self.names = [rod.name for rod in rods for _ in _cut(rod)]
        self.radii_mm = np.array([rod.radius_mm for rod in rods for _ in _cut(rod)])
        self._frames = np.array([rod.frame for rod in rods for _ in _cut(rod)], str)[:, None]
        self._centres = np.array([sphere for rod in rods for sphere in _cut(rod)]).reshape(-1, 3)

    def carried(self, motion: Motion, times_s: Array, points_mm: Array) -> Array:
        """(N, P, 3) world mm: the positions of points (P, 3) fixed in the tool's frame."""
        tools = np.array([forward(motion.joints_at(moment_s) + self._offsets, self._arm) for moment_s in times_s])
        return np.asarray(points_mm @ tools[:, :3, :3].transpose(0, 2, 1) + tools[:, None, :3, 3])

    def at(self, motion: Motion, times_s: Array) -> tuple[Array, Array]:
        """((N, K, 3) centres, (N, 3) tool centre points), mm in the world."""
        joints = [motion.joints_at(moment_s) + self._offsets for moment_s in times_s]
        tools = np.array([forward(q, self._arm) for q in joints])
        wrists = (tools @ self._tool_from_flange)[:, :3, 3]
        elbows = np.array([elbow_mm(q, self._arm) for q in joints])
        ups = _directions(elbows - wrists)
        on_forearm = wrists[:, None] + self._centres[:, 2:] * ups[:, None]
        on_tool = self._centres @ tools[:, :3, :3].transpose(0, 2, 1) + tools[:, None, :3, 3]
        shoulders = (elbows + [elbow_mm(q + HALF_TURN_OF_2, self._arm) for q in joints]) / 2
        outward, aside = _directions(elbows - shoulders), _directions(shoulders - self._arm.world_from_base[:3, 3])
        on_upper_arm = elbows[:, None] + self._centres @ np.stack([outward, np.cross(aside, outward), aside], axis=1)
        on_arm = np.where(self._frames == "upper_arm", on_upper_arm, on_forearm)
        return np.where(self._frames == "tool", on_tool, on_arm), tools[:, :3, 3]


def _directions(vectors: Array) -> Array:
    """(N, 3): the vectors scaled to length one."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])


def _cut(rod: Rod) -> list[Array]:
    start, end = np.array(rod.from_mm), np.array(rod.to_mm)
    count = ceil(float(np.linalg.norm(end - start)) / SPHERE_SPACING_MM) + 1
    return [start + share * (end - start) for share in np.linspace(0.0, 1.0, max(count, 2))]


class MotionMonitor:
    """The motion monitor: tests report facts as they happen; `violations` checks what happened since its last call."""

    def __init__(self, history: History, body: ArmSpheres, safety: Safety, table: TableTruth) -> None:
        """history: grows; a motion in it may still be cut short. Motion is forbidden until `may_move` allows it."""
        self._history, self._body, self._safety, self._table = history, body, safety, table
        self.motion_permitted = Timeline(False)
        """Whether the arm is enabled and no fault is active."""
        self.stop_test = Timeline(False)
        """Whether the stop is being tested: then a stop that only the line has is that test."""
        self.drop_permitted = Timeline(False)
        """Whether an operator permits dropping the held part anywhere."""
        self.motion_held = Timeline(False)
        """Whether motions are held."""
        self.confirm_each = Timeline(False)
        """Whether each motion of arm and gripper needs its own confirmation."""
        self.line_works = Timeline(True)
        """Whether a typed stop reaches the controller."""
        self._speed_limit = Timeline(safety.fastest_percent)
        self._confirmations: list[float] = []
        self._commands: list[tuple[float, str]] = []
        self._stops: list[tuple[float, str]] = []
        self._rest_reports: list[tuple[float, str]] = []
        self._typed_by_person: dict[str, float] = {}
        self._others_moved_s = float("-inf")
        """When somebody else last started a motion."""
        self._left_mm: dict[str, float] = {}
        """How deep the arm, by rule, still violates a limit after a line that a person typed."""
        self._carried: GraspRecord | None = None
        self._read = 0
        self._violations: list[Violation] = []

    def change_body(self, at_s: float, body: ArmSpheres) -> None:
        """The arm has another body (gripper) from this moment on; it is at rest."""
        self.violations(at_s)
        self._body = body

    def stop_received(self, at_s: float, by: str = "a stop") -> None:
        """The controller was given a stop by other means than a line that the history records."""
        self._stops.append((at_s, by))

    def rest_reported(self, at_s: float, text: str) -> None:
        """A message reported that the arm is at rest."""
        self._rest_reports.append((at_s, text))

    def limit_speed(self, at_s: float, percent: float) -> None:
        """The highest permitted monitor speed from this moment on."""
        self._speed_limit(at_s, min(percent, self._safety.fastest_percent))

    def confirmed(self, at_s: float) -> None:
        """An operator typed what may confirm a motion."""
        self._confirmations.append(at_s)

    def typed_by_person(self, at_s: float, line: str) -> None:
        """A person typed this line to the controller: its path and speed are not checked, but its permission and its
        stops are. The next motion may start where it ended."""
        self._typed_by_person.setdefault(line, at_s)

    @property
    def carried_label(self) -> str | None:
        """The label of the part in the gripper after the last checked event."""
        return None if self._carried is None else self._carried.label

    def violations(self, until_s: float) -> tuple[Violation, ...]:
        """All violations up to a moment, oldest first; the path of a motion is checked once it is over."""
        first, events = self._history.since(self._read)
        if first > self._read:
            self._violations.append(
                Violation("not checked", until_s, "", "the history lost events: call violations more often")
            )
            self._read = first
        for event in events:
            if isinstance(event, MotionRecord) and event.motion.ends_s > until_s:
                if event.by_others:
                    break
                return (*self._violations, *self._check_permission(event), *self._check_motion(event, over=False))
            self._read += 1
            self._violations += self._check(event)
        return tuple(self._violations)

    def _check(self, event: HistoryRecord) -> Iterator[Violation]:
        if isinstance(event, GraspRecord | ReleaseRecord):  # by any cause
            self._carried = event if isinstance(event, GraspRecord) else None
            return
        if event.by_others:  # not checked itself, but it affects what is checked next
            if isinstance(event, MotionRecord):
                self._left_mm = self._depths_at_rest(event)
                self._others_moved_s = event.began_s
            return
        if isinstance(event, StopRecord):
            # On a faulty line another character may turn into control-C, but not into a whole command.
            noise = event.by == CONTROL_C and not self.line_works.at(event.began_s)
            if not (self.stop_test.at(event.began_s) or noise):
                self.stop_received(event.began_s, event.by)
        elif isinstance(event, DropRecord):
            yield from self._check_drop(event)
        else:
            yield from self._check_permission(event)
            yield from self._check_hold(event)
        if isinstance(event, MotionRecord):
            yield from self._check_stopping(event)
            yield from self._check_rest_reports(event)
            yield from self._check_motion(event, over=True)

    def _check_motion(self, move: MotionRecord, over: bool) -> Iterator[Violation]:
        """Check speed and length of a motion as commanded and, once it is over, its path."""
        others_moved = self._others_moved_s > move.received_s - POSITION_AGE_S
        if move.began_s < self._typed_by_person.get(move.by, float("inf")) and not others_moved:
            yield from self._check_command(move)
            yield from (*self._check_path(move), *self._check_carried_part(move)) if over else ()
        elif over:
            self._left_mm = self._depths_at_rest(move)

    def _check_permission(self, event: MotionRecord | GripperRecord) -> Iterator[Violation]:
        """Check for a motion that began while motion was forbidden, or after a stop and before the next enable."""
        what = "the arm moved" if isinstance(event, MotionRecord) else "the gripper worked"
        permitted_s = self.motion_permitted.true_before(event.began_s)
        withdrawn_s = (
            self.motion_permitted.set_within(permitted_s, event.began_s, False)
            if isfinite(permitted_s)
            else permitted_s
        )
        if not (self.motion_permitted.at(event.began_s) or self._unstoppable(event, withdrawn_s)):
            yield Violation("not permitted", event.began_s, event.by, f"{what} while motion was not permitted")
        self._stops = [stop for stop in self._stops if stop[0] >= permitted_s]
        before = [stop for stop in self._stops if stop[0] < event.began_s and not self._unstoppable(event, stop[0])]
        if before:
            at_s, by = max(before)
            text = f"{what} {event.began_s - at_s:.3f} s after the stop `{by}`"
            yield Violation("motion after stop", event.began_s, event.by, text)

    def _check_hold(self, event: MotionRecord | GripperRecord) -> Iterator[Violation]:
        """Check for a motion that was typed while moves were held, or without its confirmation. On a faulty line the
        time when it was released is unknown, so it is not checked."""
        received_s = event.received_s
        held_s, confirm_s = (
            times.true_before(received_s) + TYPING_S for times in (self.motion_held, self.confirm_each)
        )
        if (
            self.motion_held.at(received_s)
            and received_s > held_s
            and self.line_works.at(received_s)
            and self.line_works.at(held_s - TYPING_S)
        ):
            text = f"typed {received_s - held_s + TYPING_S:.1f} s after moves were held"
            yield Violation("motion while held", event.began_s, event.by, text)
        if self.confirm_each.at(received_s) and received_s > confirm_s and (received_s, event.by) not in self._commands:
            self._commands = [act for act in self._commands if act[0] > confirm_s] + [(received_s, event.by)]
            confirmed = sum(confirm_s - TYPING_S < confirmed_s <= received_s for confirmed_s in self._confirmations)
            if len(self._commands) > confirmed:
                text = f"motion {len(self._commands)}, but only {confirmed} were confirmed"
                yield Violation("not confirmed", event.began_s, event.by, text)

    def _check_stopping(self, move: MotionRecord) -> Iterator[Violation]:
        """Check for a motion that continued too long after a stop, or after the permission was withdrawn."""
        ends_s = move.motion.ends_s
        reasons = [(at_s, f"the stop `{by}`") for at_s, by in self._stops if move.began_s < at_s < ends_s]
        reasons += [
            (e.began_s, f"the stop `{e.by}`") for e in self._history.since(self._read)[1] if isinstance(e, StopRecord)
        ]
        withdrawn_s = self.motion_permitted.set_within(move.began_s, ends_s, False)
        reasons += [] if withdrawn_s is None else [(withdrawn_s, "the permission was withdrawn")]
        at_s, why = min(((self._stop_arrives_s(at_s), why) for at_s, why in reasons), default=(ends_s, ""))
        if ends_s - at_s > self._safety.rest_within_s:
            yield Violation("stopped too late", ends_s, move.by, f"still moving {ends_s - at_s:.3f} s after {why}")

    def _check_rest_reports(self, move: MotionRecord) -> Iterator[Violation]:
        """Check for a report of rest during the motion. Its last moments are left out: there it cannot be seen."""
        ends_s = move.motion.ends_s
        for at_s, text in self._rest_reports:
            if move.began_s < at_s < ends_s - REST_TOLERANCE_S:
                yield Violation(
                    "rest reported early", at_s, move.by, f"`{text}` {ends_s - at_s:.3f} s before the end of its motion"
                )
        self._rest_reports = [report for report in self._rest_reports if report[0] > ends_s]

    def _unstoppable(self, event: MotionRecord | GripperRecord, forbidden_s: float | None) -> bool:
        """Whether the controller had the whole line before motion was forbidden, and no stop could reach it before the
        motion began."""
        return (
            forbidden_s is not None
            and event.received_s < forbidden_s
            and event.began_s < self._stop_arrives_s(forbidden_s)
        )

    def _stop_arrives_s(self, at_s: float) -> float:
        """When a stop at that moment could first reach the controller."""
        if self.line_works.at(at_s):
            return at_s
        again_s = self.line_works.set_within(at_s, float("inf"), True)
        return float("inf") if again_s is None else again_s

    def _check_command(self, move: MotionRecord) -> Iterator[Violation]:
        """Check the commanded speed and step against their limits."""
        allowed = self._speed_limit.at(move.began_s)
        if move.speed_percent > allowed + 1e-9:
            text = f"monitor speed {move.speed_percent:g} %; limit {allowed:g} %"
            yield Violation("too fast", move.began_s, move.by, text)
        whole = move.motion.uncut()
        start, end = self._body.at(whole, np.array([whole.started_s, whole.ends_s]))[1]
        step = float(np.linalg.norm(end - start))
        if step > self._safety.longest_step_mm + TOLERANCE_MM:
            text = f"a step of {step:.1f} mm; limit {self._safety.longest_step_mm:g} mm"
            yield Violation("step too long", move.began_s, move.by, text)

    def _check_path(self, move: MotionRecord) -> Iterator[Violation]:
        """Check the whole path for collisions of the body and for the speed of the tool."""
        times, spheres, tools = self._sampled_path(move.motion)
        speeds = np.linalg.norm(np.diff(tools, axis=0), axis=1) / np.diff(times)
        k = int(np.argmax(speeds))
        if speeds[k] > self._safety.fastest_mm_s:
            text = f"the tool at {speeds[k]:.0f} mm/s; limit {self._safety.fastest_mm_s:g} mm/s"
            yield Violation("too fast", times[k], move.by, text)
        for rule, deep in self._depths(spheres).items():
            too_deep = self._additional_depth(rule, deep)
            if too_deep.max(initial=0.0) > TOLERANCE_MM:
                moment, sphere = np.unravel_index(int(np.argmax(too_deep)), deep.shape)
                text = f"{self._body.names[sphere]} {deep[moment, sphere]:.1f} mm {rule}"
                yield Violation(rule, times[moment], move.by, text)

    def _check_carried_part(self, move: MotionRecord) -> Iterator[Violation]:
        """Check the part in the gripper, as long as it is held, against the table, and its corners against the keep-out
        boxes, on the path and at its end."""
        if self._carried is None:
            return
        motion = move.motion
        later = self._history.since(self._read)[1]
        lost_s = next((event.began_s for event in later if isinstance(event, ReleaseRecord)), float("inf"))
        ends_s = max(motion.started_s, min(motion.ends_s, lost_s))
        times = np.linspace(motion.started_s, ends_s, max(2, ceil((ends_s - motion.started_s) / SAMPLE_S) + 1))
        for rule, deep in self._carried_depths(motion, times).items():
            too_deep = self._additional_depth(PART + rule, deep)
            if too_deep.max() > PRESS_MM:
                moment, corner = np.unravel_index(int(np.argmax(too_deep)), deep.shape)
                where = "into the table" if rule == "pressed" else rule
                text = f"the {self._carried.label} in the gripper {deep[moment, corner]:.1f} mm {where}"
                yield Violation(rule, times[moment], move.by, text)

    def _additional_depth(self, rule: str, deep: Array) -> Array:
        """(N, K) mm: how much deeper the arm is on a path than where somebody else left it; once all of it is clear,
        the whole depth counts. A path that ends clear removes that allowance."""
        clear = np.logical_or.accumulate(deep.max(axis=1, initial=-np.inf) <= 0.0)
        deeper: Array = deep - np.where(clear, 0.0, self._left_mm.get(rule, 0.0))[:, None]
        if clear[-1]:
            self._left_mm.pop(rule, None)
        return deeper

    def _depths_at_rest(self, move: MotionRecord) -> dict[str, float]:
        """By rule, mm: how deep the body violates a limit at the end of a motion; only violated rules."""
        at_rest = np.array([move.motion.ends_s])
        of_part = {PART + rule: deep for rule, deep in self._carried_depths(move.motion, at_rest).items()}
        depths = {**self._depths(self._body.at(move.motion, at_rest)[0]), **of_part}
        deepest = {rule: float(deep.max(initial=-np.inf)) for rule, deep in depths.items()}
        return {rule: deep for rule, deep in deepest.items() if deep > 0.0}

    def _depths(self, spheres: Array) -> dict[str, Array]:
        """(N, K, 3) -> by rule, (N, K) mm: how deep each sphere violates a limit; negative: its distance from it."""
        room, radii = self._safety.room, self._body.radii_mm
        low, high = spheres - radii[:, None], spheres + radii[:, None]
        depths = {"below the table": self._table.height_mm - low[..., 2]}
        depths["outside the room"] = np.max(np.maximum(room.low_mm - low, high - room.high_mm), axis=2)
        for number, box in enumerate(self._safety.keep_out):
            depths[f"in keep-out box {number + 1}"] = radii - _distance(spheres, box)
        return depths

    def _carried_depths(self, motion: Motion, times: Array) -> dict[str, Array]:
        """By rule, (N, K) mm: like `_depths`, for the corners of the part in the gripper; empty without a part."""
        if self._carried is None:
            return {}
        corners = self._body.carried(motion, times, self._carried.corners_mm)
        depths = {"pressed": self._table.height_mm - corners[..., 2]}
        for number, box in enumerate(self._safety.keep_out, start=1):
            depths[f"in keep-out box {number}"] = -_distance(corners, box)
        return depths

    def _sampled_path(self, motion: Motion) -> tuple[Array, Array, Array]:
        """The sampled path: times (N,), spheres (N, K, 3), tool (N, 3); N >= 2, as dense as SAMPLE_MM requires."""
        count = max(2, ceil((motion.ends_s - motion.started_s) / SAMPLE_S) + 1)
        times = np.linspace(motion.started_s, max(motion.ends_s, motion.started_s + SHORTEST_S), count)
        spheres, tools = self._body.at(motion, times)
        while True:
            moved = np.linalg.norm(np.diff(spheres, axis=0), axis=2).max(axis=1, initial=0.0)
            away = -np.max([deep.max(axis=1, initial=-np.inf) for deep in self._depths(spheres).values()], axis=0)
            wide = (moved > SAMPLE_MM) & (np.minimum(away[:-1], away[1:]) < 2 * moved) & (np.diff(times) > SHORTEST_S)
            if not wide.any():
                return times, spheres, tools
            between = (times[:-1] + times[1:])[wide] / 2
            where = np.flatnonzero(wide) + 1
            more_spheres, more_tools = self._body.at(motion, between)
            times = np.insert(times, where, between)
            spheres, tools = (
                np.insert(spheres, where, more_spheres, axis=0),
                np.insert(tools, where, more_tools, axis=0),
            )

    def _check_drop(self, drop: DropRecord) -> Iterator[Violation]:
        permitted = drop.over_bin or self.drop_permitted.at(drop.began_s)
        if not permitted and drop.fell_mm > self._safety.drop_mm:
            yield Violation(
                "dropped", drop.began_s, drop.by, f"{drop.label} dropped {drop.fell_mm:.1f} mm above the table"
            )


def _distance(points: Array, box: Box) -> Array:
    """(..., 3) mm -> (...) mm: the signed distance from the box; negative inside (to the nearest side)."""
    outside = np.maximum(np.array(box.low_mm) - points, points - np.array(box.high_mm))
    distance = np.linalg.norm(np.maximum(outside, 0.0), axis=-1)
    return np.asarray(distance + np.minimum(outside.max(axis=-1), 0.0))
