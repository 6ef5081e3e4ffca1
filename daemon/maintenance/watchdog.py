"""Watch devices, disk quota and clock while the daemon runs, and feed systemd's watchdog.

systemd's watchdog is fed while the main loop runs and every device check has ended lately, with or without an error: a
driver that hangs lets systemd restart the daemon, a pulled cable does not, as a restart would not help.
"""

import asyncio
import shutil
import time
from functools import partial
from pathlib import Path

from daemon.cell.hardware import EXPECTED_ERRORS
from daemon.events.codes import CauseCode, FaultCause, cause_of
from daemon.events.outcomes import tally
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
HALTED_S = 10.0
"""A longer gap between two ticks means that the daemon did not run; its own work never takes as long."""
NO_NEW_FOLDER = "disk: cannot start a new run folder"
SOURCES = {"cameras": CauseCode.CAMERA_LOST, "controller": CauseCode.CONTROLLER_SILENT}
"""The cause of a lost device where its error names none."""


def suspended_s() -> float:
    """Seconds that this computer was suspended since its start, which the monotonic clock leaves out."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) - time.clock_gettime(time.CLOCK_MONOTONIC)


class Watchdog:
    """Runs in the background. Never moves the arm, except to stop it."""

    def __init__(self, context: WatchedDaemon) -> None:
        self._context = context
        self._offset_s = time.time() - time.monotonic()
        self._asleep_s = suspended_s()
        self._ticked_s = time.monotonic()
        self._fed_s = 0.0
        self._quota_s = time.monotonic() + 5.0
        self._checks: dict[str, asyncio.Task[None]] = {}
        self._begun_s = dict.fromkeys(SOURCES, time.monotonic())  # opened, and so heard, just now
        self._ended_s = dict(self._begun_s)

    async def run(self) -> None:
        try:
            while True:
                self._tick()
                await asyncio.sleep(TICK_S)
        finally:
            for task in self._checks.values():
                task.cancel()

    def status_line(self) -> str:
        """One line for `systemctl status`."""
        cycle, troubles = self._context.cycle, "; ".join(self._context.troubles.active.values())
        fault, counted = cycle.supervisor.permission.fault, tally(cycle.tally)
        job = f"{cycle.supervisor.doing or 'idle'} ({cycle.state})"
        doing = job if fault is None else journal.fault_line(fault.text, fault.cause.code)
        return f"{doing}; {counted.picked} of {counted.tried} picked" + (f"; {troubles}" if troubles else "")

    def _tick(self) -> None:
        now = time.monotonic()
        halted_s, self._ticked_s = now - self._ticked_s, now
        self._start("sleep", partial(self._check_sleep, halted_s), now, 0.0)
        health = self._context.config.values.health
        supervisor = self._context.cycle.supervisor
        busy = supervisor.busy
        if self._may_check("cameras", busy, health.camera_silence_s):
            self._start("cameras", self._check_cameras, now, health.camera_silence_s / 2)
        if self._heard_unasked or self._line_lost_in_a_stop:
            self._start("controller", self._check_controller, now, 0.0)
        elif self._may_check("controller", busy, health.arm_check_s):
            self._start("controller", self._check_controller, now, health.arm_check_s)
        if now >= self._quota_s:
            self._quota_s = now + QUOTA_S
            self._start("quota", self._keep_quota, now, 0.0)
        if supervisor.permission.fault is None:
            self._context.troubles.report("restart", None)
        self._check_clock()
        self._roll(busy)
        self._count_signs_of_life(busy)
        self._feed(now, busy)

    def _may_check(self, device: str, busy: bool, silence_s: float) -> bool:
        """Whether to check a device: always when idle, during a pick only after a silence."""
        hardware = self._context.hardware
        heard_s = (hardware.cameras if device == "cameras" else hardware.robot).heard_s
        return not busy or (heard_s is not None and hardware.clock() - heard_s > silence_s)

    @property
    def _heard_unasked(self) -> bool:
        """Whether unread data is on the controller's line at rest: it is reported now, not at the next check. A line
        with a trouble is reopened in its turn."""
        controller = self._context.hardware.robot.controller
        return controller is not None and controller.heard_unasked and "controller" not in self._context.troubles.active

    @property
    def _line_lost_in_a_stop(self) -> bool:
        """Whether a stop is under way whose line is lost: nothing can stop the arm until the line is open again."""
        return self._context.cycle.supervisor.permission.stopping and not self._context.hardware.robot.connected

    def _start(self, name: str, check: object, now: float, every_s: float) -> None:
        running = self._checks.get(name)
        if (running is not None and not running.done()) or now < self._begun_s.get(name, -1e9) + every_s:
            return
        self._begun_s[name] = now
        self._checks[name] = asyncio.create_task(check(), name=f"check {name}")  # type: ignore[operator]

    async def _check_cameras(self) -> None:
        context = self._context
        cameras, limit_s = context.hardware.cameras, context.config.values.health.camera_silence_s
        try:
            await cameras.grab(context.hardware.clock() - limit_s, limit_s / 2)
            context.troubles.report("cameras", None)
        except EXPECTED_ERRORS as error:
            await self._lost("cameras", error)
        self._ended_s["cameras"] = time.monotonic()

    async def _check_controller(self) -> None:
        context, robot = self._context, self._context.hardware.robot
        try:
            if robot.aside or (context.cycle.supervisor.permission.stopping and robot.connected):
                self._ended_s["controller"] = time.monotonic()
                return
            if "controller" in context.troubles.active:
                await robot.close()
                context.cycle.supervisor.line_opened_anew()
                await robot.open()
            controller = robot.controller
            if controller is not None and controller.question is not None:
                what = "answer it: `robot power-up`"
                if controller.asks_whether_to_move:
                    what = "`stop` answers N and ends the program that asks"
                context.troubles.report("controller", f"the controller asks `{controller.question}`: {what}")
            else:
                context.troubles.report("zero", await robot.check())
                context.troubles.report("controller", None)
        except EXPECTED_ERRORS as error:
            self._begun_s["controller"] = time.monotonic() + REOPEN_S - context.config.values.health.arm_check_s
            await self._lost("controller", error)
        self._ended_s["controller"] = time.monotonic()

    async def _lost(self, what: str, error: Exception) -> None:
        """Report a lost device once; stop an arm that may move, until `resume`."""
        context = self._context
        new = what not in context.troubles.active
        cause = cause_of(error)
        cause = FaultCause(SOURCES[what]) if cause.code is CauseCode.INTERNAL else cause
        context.troubles.report(what, f"{what}: {error}", cause)
        if new:
            await self._stop_enabled_arm(what, str(error), cause)

    async def _stop_enabled_arm(self, source: str, text: str, cause: FaultCause) -> None:
        supervisor = self._context.cycle.supervisor
        if supervisor.permission.granted and supervisor.permission.fault is None:
            await supervisor.fail(source, text, cause)

    async def _keep_quota(self) -> None:
        context, limits = self._context, self._context.config.values.log
        runs, current = context.config.runs, context.run_log.folder
        most, least = limits.quota_mb * 1_000_000, limits.keep_free_mb * 1_000_000
        stuck: dict[Path, str] = {}
        try:
            removed = await asyncio.to_thread(enforce_quota, runs, most, current, least, stuck.__setitem__)
            journal.write_removed(removed)
            context.troubles.report("runs", next((journal.stuck(*one) for one in stuck.items()), None))
            if not runs.is_dir():
                return
            free = shutil.disk_usage(runs).free
        except OSError as error:
            context.troubles.report("disk", f"disk: old runs cannot be removed: {plain(error)}")
            return
        low = f"disk: {free / 1e6:.0f} MB free in {runs}; free some space, or looks will not be recorded"
        context.troubles.report("disk", low if free < limits.keep_free_mb * 1e6 else None)
        size = await asyncio.to_thread(run_bytes, current)
        if size > limits.roll_mb * 1_000_000:
            context.roll_due = True

    def _roll(self, busy: bool) -> None:
        """Continue in a new run folder where somebody removed the current one, or it is large and the cell idle.
        Between the picks of an auto the cycle does the latter."""
        context, folder, removed = self._context, self._context.run_log.folder, self._context.run_log.removed
        if not removed and (busy or not context.roll_due):
            return
        context.roll_due = True
        try:
            context.roll_if_due()
        except (FileError, OSError) as error:
            what = f"log: {folder} was removed, and no new folder can be made" if removed else NO_NEW_FOLDER
            context.troubles.report("log" if removed else "disk", f"{what}: {plain(error)}")
            return
        if removed:
            context.troubles.report("log", None)
            text = f"log: {folder} was removed while in use; the log continues in {context.run_log.folder}"
            journal.write("trouble", text, journal.WARNING)

    def _check_clock(self) -> None:
        offset_s = time.time() - time.monotonic()
        jump_s, self._offset_s = offset_s - self._offset_s, offset_s
        if abs(jump_s) > CLOCK_JUMP_S:
            journal.write("trouble", f"the clock was set by {jump_s:+.1f} s", journal.NOTICE)
            self._context.run_log.record("clock", jump_s=round(jump_s, 3))

    async def _check_sleep(self, halted_s: float) -> None:
        """Stop an enabled arm after a suspend, or after a halt of the daemon (control-Z, a paused virtual machine, a
        disk that swaps) for halted_s: otherwise it would continue an old motion, which nobody near the arm expects."""
        now_s = suspended_s()
        slept_s, self._asleep_s = now_s - self._asleep_s, now_s
        if slept_s > ASLEEP_S:
            text = f"the computer was suspended for {slept_s:.0f} s"
        elif halted_s > HALTED_S:
            text = f"facetd was not running for {halted_s:.0f} s"
        else:
            return
        journal.write("trouble", text, journal.WARNING)
        await self._stop_enabled_arm("asleep", text, FaultCause(CauseCode.COMPUTER_SLEPT))

    def _count_signs_of_life(self, busy: bool) -> None:
        """Count what a pick hears from the devices as signs of life. A line in exclusive use counts too (CAL is silent
        for minutes): its user sets its own time limit."""
        if self._context.hardware.robot.aside:
            self._ended_s["controller"] = time.monotonic()
        if not busy:
            return
        hardware, now = self._context.hardware, self._context.hardware.clock()
        for name, heard_s in (("cameras", hardware.cameras.heard_s), ("controller", hardware.robot.heard_s)):
            if heard_s is not None and now - heard_s < CHECK_LIMIT_S:
                self._ended_s[name] = time.monotonic()

    def _feed(self, now: float, busy: bool) -> None:
        every_s = journal.watchdog_s()
        if now - self._fed_s < min(every_s or 10.0, 10.0) / 2:
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
