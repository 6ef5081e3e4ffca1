"""Watching while nothing else does: are the devices alive, the disk within its quota, the clock sane.

The systemd watchdog is fed only while the main loop turns and every device's check came to an end lately, be it with
an error that is told: a hanging driver starves it, a pulled cable does not (restarting would not plug it in again).
"""

from __future__ import annotations

import asyncio
import shutil
import time
from functools import partial
from pathlib import Path

from daemon.cell.build import EXPECTED_ERRORS
from daemon.events.codes import CauseCode, FaultCause, cause_of
from daemon.maintenance import journal
from daemon.maintenance.troubles import WatchedDaemon
from daemon.store.files import plain
from daemon.store.outside import FileError
from daemon.store.runs import enforce_quota, run_bytes

TICK_S = 0.5
REOPEN_S = 5.0
QUOTA_S = 60.0
CLOCK_JUMP_S = ASLEEP_S = 2.0
CHECK_LIMIT_S = 20.0
STOOD_STILL_S = 10.0
SOURCES = {"cameras": CauseCode.CAMERA_LOST, "controller": CauseCode.CONTROLLER_SILENT}
"""What the loss of a device is a sign of where its error does not say."""
"""Longer than anything of the daemon's own keeps it from its next tick, also on a busy computer."""


def asleep_s() -> float:
    """How long this computer has been suspended since it was started: what the clock of motion leaves out."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) - time.clock_gettime(time.CLOCK_MONOTONIC)


class Watchdog:
    """Runs beside everything else. Never moves the arm, except to stop it."""

    def __init__(self, context: WatchedDaemon) -> None:
        self._context = context
        self._offset_s = time.time() - time.monotonic()
        self._asleep_s = asleep_s()
        self._ticked_s = time.monotonic()
        self._fed_s = 0.0
        self._quota_s = time.monotonic() + 5.0
        self._checks: dict[str, asyncio.Task[None]] = {}
        self._begun_s = {"cameras": time.monotonic(), "controller": time.monotonic()}  # opened, and so asked, just now
        self._ended_s = {"cameras": time.monotonic(), "controller": time.monotonic()}

    async def run(self) -> None:
        """Tick until cancelled."""
        try:
            while True:
                self._tick()
                await asyncio.sleep(TICK_S)
        finally:
            for task in self._checks.values():
                task.cancel()

    def status_line(self) -> str:
        """One line for `systemctl status`."""
        state = self._context.cycle.status()
        troubles = "; ".join(self._context.troubles.standing.values())
        job = f"{state['doing'] or 'idle'} ({state['state']})"
        doing = journal.fault_line(str(state["fault"])) if state["fault"] else job
        return f"{doing}; {state['picked']} of {state['tried']} picked" + (f"; {troubles}" if troubles else "")

    def _tick(self) -> None:
        now = time.monotonic()
        still_s, self._ticked_s = now - self._ticked_s, now
        self._start("sleep", partial(self._check_sleep, still_s), now, 0.0)
        health = self._context.config.values.health
        state = self._context.cycle.status()
        busy = state["doing"] is not None
        if self._may_ask("cameras", busy, health.camera_silence_s):
            self._start("cameras", self._check_cameras, now, health.camera_silence_s / 2)
        if self._may_ask("controller", busy, health.arm_check_s):
            self._start("controller", self._check_controller, now, health.arm_check_s)
        if now >= self._quota_s:
            self._quota_s = now + QUOTA_S
            self._start("quota", self._keep_quota, now, 0.0)
        if state["fault"] is None:
            self._context.troubles.tell("restart", None)
        self._check_clock()
        self._check_folder()
        self._roll(busy)
        self._check_memory_of_motion(busy)
        self._feed(now, busy)

    def _may_ask(self, device: str, busy: bool, quiet_s: float) -> bool:
        """Whether a device is to be asked: always when idle; while the cycle works only when it has not for so long
        (it waits for an operator's yes, for the end of a pause, for parts)."""
        hardware = self._context.hardware
        heard_s = (hardware.eyes if device == "cameras" else hardware.robot).heard_s
        return not busy or (heard_s is not None and hardware.clock() - heard_s > quiet_s)

    def _start(self, name: str, check: object, now: float, every_s: float) -> None:
        running = self._checks.get(name)
        if (running is not None and not running.done()) or now < self._begun_s.get(name, -1e9) + every_s:
            return
        self._begun_s[name] = now
        self._checks[name] = asyncio.create_task(check(), name=f"check {name}")  # type: ignore[operator]

    async def _check_cameras(self) -> None:
        context = self._context
        eyes, limit_s = context.hardware.eyes, context.config.values.health.camera_silence_s
        try:
            await eyes.grab(context.hardware.clock() - limit_s, limit_s / 2)
            context.troubles.tell("cameras", None)
        except EXPECTED_ERRORS as error:
            await self._lost("cameras", error)
        self._ended_s["cameras"] = time.monotonic()

    async def _check_controller(self) -> None:
        context, robot = self._context, self._context.hardware.robot
        try:
            if robot.aside or (context.cycle.supervisor.stopping and robot.connected):
                self._ended_s["controller"] = time.monotonic()
                return
            if "controller" in context.troubles.standing:
                await robot.close()
                context.cycle.supervisor.line_opened_anew()
                await robot.open()
            if robot.question is not None:
                what = (
                    "`stop` answers N and ends the program that asks"
                    if robot.asks_whether_to_move
                    else "answer it: `robot power-up`"
                )
                context.troubles.tell("controller", f"the controller asks `{robot.question}`: {what}")
            else:
                await robot.check()
                context.troubles.tell("controller", None)
        except EXPECTED_ERRORS as error:
            self._begun_s["controller"] = time.monotonic() + REOPEN_S - context.config.values.health.arm_check_s
            await self._lost("controller", error)
        self._ended_s["controller"] = time.monotonic()

    async def _lost(self, what: str, error: Exception) -> None:
        """Tell of a lost device once; an arm that may move is stopped and stays so until somebody says resume."""
        context = self._context
        new = what not in context.troubles.standing
        context.troubles.tell(what, f"{what}: {error}")
        if new:
            cause = cause_of(error)
            known = cause.code is not CauseCode.INTERNAL
            await self._stop_what_may_move(what, str(error), cause if known else FaultCause(SOURCES[what]))

    async def _stop_what_may_move(self, source: str, text: str, cause: FaultCause) -> None:
        supervisor = self._context.cycle.supervisor
        if supervisor.permit.granted and supervisor.fault is None:
            await supervisor.fail(source, text, cause)

    async def _keep_quota(self) -> None:
        context, limits = self._context, self._context.config.values.log
        runs, current = context.config.runs, context.run_log.folder
        most, least = limits.quota_mb * 1_000_000, limits.keep_free_mb * 1_000_000
        stuck: list[str] = []

        def tell_stuck(run: Path, why: str) -> None:
            stuck.append(journal.stuck(run, why))

        try:
            removed = await asyncio.to_thread(enforce_quota, runs, most, current, least, tell_stuck)
            journal.tell_removed(removed)
            context.troubles.tell("runs", stuck[0] if stuck else None)
            if not runs.is_dir():
                return
            free = shutil.disk_usage(runs).free
        except OSError as error:
            context.troubles.tell("disk", f"disk: old runs cannot be removed: {plain(error)}")
            return
        low = (
            f"disk: {free / 1e6:.0f} MB free in {runs}; free some space, or looks will not be recorded"
            if free < limits.keep_free_mb * 1e6
            else None
        )
        context.troubles.tell("disk", low)
        size = await asyncio.to_thread(run_bytes, current)
        if size > limits.roll_mb * 1_000_000:
            context.roll_due = True

    def _roll(self, busy: bool) -> None:
        """In the first idle moment after the run's folder was seen to be large: who looks and teaches all day leaves no
        idle one to him who asks once a minute. Between the picks of an auto it is done there."""
        context = self._context
        if busy or not context.roll_due:
            return
        try:
            context.roll_if_due()
        except (FileError, OSError) as error:
            context.troubles.tell("disk", f"disk: cannot start a new run folder: {plain(error)}")

    def _check_folder(self) -> None:
        """Where somebody removed the run that is being written, the log goes on in a new one, and it is told."""
        context = self._context
        if not context.run_log.removed:
            return
        gone = context.run_log.folder
        context.roll_due = True
        try:
            context.roll_if_due()
        except (FileError, OSError) as error:
            context.troubles.tell("log", f"log: {gone} was removed, and no new run folder can be made: {plain(error)}")
            return
        context.troubles.tell("log", None)
        text = f"log: {gone} was removed while in use; the log continues in {context.run_log.folder}"
        journal.tell("trouble", text, journal.WARNING)

    def _check_clock(self) -> None:
        offset_s = time.time() - time.monotonic()
        jump_s, self._offset_s = offset_s - self._offset_s, offset_s
        if abs(jump_s) > CLOCK_JUMP_S:
            journal.tell("trouble", f"the clock was set by {jump_s:+.1f} s", journal.NOTICE)
            self._context.run_log.record("clock", jump_s=round(jump_s, 3))

    async def _check_sleep(self, still_s: float) -> None:
        """A computer that slept goes on in the middle of what it did, hours later and with no clock that tells; so does
        a daemon that was held still (control-Z, a guest that was paused, a disk that swaps) for still_s, heard nobody
        meanwhile and has what was begun before to go on with. Nobody beside the arm expects that."""
        now_s = asleep_s()
        slept_s, self._asleep_s = now_s - self._asleep_s, now_s
        if slept_s > ASLEEP_S:
            text = f"the computer was suspended for {slept_s:.0f} s"
        elif still_s > STOOD_STILL_S:
            text = f"facetd was not running for {still_s:.0f} s"
        else:
            return
        journal.tell("trouble", text, journal.WARNING)
        await self._stop_what_may_move("asleep", text, FaultCause(CauseCode.COMPUTER_SLEPT))

    def _check_memory_of_motion(self, busy: bool) -> None:
        """While the cycle works, it is the cycle that talks to the devices: what it hears counts as their life. So does
        a line that is taken (CAL is silent for minutes): whoever has it knows how long to wait."""
        if self._context.hardware.robot.aside:
            self._ended_s["controller"] = time.monotonic()
        if not busy:
            return
        hardware, now = self._context.hardware, self._context.hardware.clock()
        for name, heard_s in (("cameras", hardware.eyes.heard_s), ("controller", hardware.robot.heard_s)):
            if heard_s is not None and now - heard_s < CHECK_LIMIT_S:
                self._ended_s[name] = time.monotonic()

    def _feed(self, now: float, busy: bool) -> None:
        every_s = journal.watchdog_s()
        journal_due = now - self._fed_s >= min(every_s or 10.0, 10.0) / 2
        if not journal_due:
            return
        self._fed_s = now
        limit_s = CHECK_LIMIT_S + max(
            self._context.config.values.health.arm_check_s, self._context.config.values.health.camera_silence_s
        )
        silent = [name for name, ended_s in self._ended_s.items() if now - ended_s > limit_s]
        if silent:
            journal.notify(f"STATUS=no sign of life from {', '.join(silent)}")
            return
        journal.notify("WATCHDOG=1", f"STATUS={self.status_line()}")
