"""The daemon from start to end: start everything in order, serve, reload, stop the arm first and then the rest."""

import asyncio
import contextlib
import os
import shutil
import signal
import time
from collections.abc import Awaitable, Coroutine
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from daemon.arm import Supervisor
from daemon.calibration.file import Calibration, same_geometry
from daemon.cell import build as cell
from daemon.cell import sections
from daemon.cell.hardware import Hardware
from daemon.cell.no_arm import CellError
from daemon.cell.pick_cell import pick_cell, place_table
from daemon.commands import every_command
from daemon.commands.cycle_observer import CycleObserver
from daemon.commands.placing import report_moved
from daemon.commands.signals import plc_readings, serve_the_line
from daemon.commands.simulated_parts import know_drawings
from daemon.commands.step_mode import report_waiting_move
from daemon.compute.worker import Worker
from daemon.config import TOOL, Config, Matrix4, load_config
from daemon.console.context import Change, CommandContext
from daemon.console.interpreter import Interpreter
from daemon.console.notices import NoticeLevel
from daemon.console.phrases import describe_interruption
from daemon.errors import FacetdError
from daemon.events.codes import CauseCode, FaultCause
from daemon.frontends.rights import FrontendError, Rights
from daemon.frontends.serial_terminal import SerialFrontend
from daemon.frontends.socket_server import SocketServer
from daemon.maintenance import journal
from daemon.maintenance.troubles import Troubles
from daemon.maintenance.watchdog import Watchdog
from daemon.pick.cycle import PickCycle
from daemon.signals.input_form import load_form
from daemon.signals.modbus import ModbusError, ModbusServer, PLCInputs, inherited_socket
from daemon.signals.packml import PackMLState
from daemon.signals.production_line import ProductionLine
from daemon.signals.settings import ModbusSettings
from daemon.store.files import InUseError, hold, plain
from daemon.store.library import load_facets, load_parts
from daemon.store.model import load as load_model
from daemon.store.model_store import ModelStore
from daemon.store.outside import FileError
from daemon.store.recovery_state import FILE, RecoveryFile, read_interrupted_state
from daemon.store.runlog import RunLog
from daemon.store.runs import enforce_quota, list_runs, new_folder
from daemon.store.yamlfile import ConfigError
from daemon.teaching.trainer import Trainer

if TYPE_CHECKING:
    from daemon.maintenance.metrics import MetricsServer

STOPPED, NO_DEVICE, BAD_CONFIGURATION = 0, 2, 78
AT_START = (
    *("cell", "backend", "cameras", "arm", "folders", "console", "files", "simulated", "recorded", "metrics"),
    *("signals", "modbus"),
)
"""Sections of the configuration that take effect only at a start."""
GUARDING = ("limits", "gripper")
"""Keys of `pick` that describe the geometry of gripper and cell."""
ENDING = (
    *(signal.SIGTERM, signal.SIGINT, signal.SIGQUIT, signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM, signal.SIGVTALRM),
    *(signal.SIGPROF, signal.SIGIO, signal.SIGPWR, signal.SIGXCPU),
)
"""Signals that end a process unless it takes them: the arm is stopped first. Not those of a fault of the program, nor
the watchdog's, which finds a loop that does not turn."""
AT_WORK = "the controller was still carrying out a command from before this start; facetd stopped it (ABORT)"
LOOK_S, SHARED_BY = 60.0, 4
"""Longest look, fusion or plan, s, beside the look's budget of processor time; of a processor that others share, the
worker gets one part in SHARED_BY. After that facetd ends the worker process."""
STUDY_S, STUDY_IDLE_S = 3600.0, 60.0
"""Longest training, and how long its worker process stays for the next one."""
RELOAD_S = 1.0
"""Shortest period between two reloads by SIGHUP."""
HALT_S = 8.4
"""Longest stop of the arm at the end, within systemd's TimeoutStopSec: the alarm where the arm is not seen at rest
(arm/stopping.py, ABORT_S), and more tries after it. The rest of the end takes at most 1.5 s."""


class Service:
    """The daemon, from configuration to exit status."""

    def __init__(self, config_path: Path, simulated: bool = False) -> None:
        self._config_path, self._simulated = config_path, simulated
        self._ending = asyncio.Event()
        self._why = "stopped"
        self.context: CommandContext | None = None
        self._interpreter: Interpreter | None = None
        self._socket: SocketServer | None = None
        self._terminal: SerialFrontend | None = None
        self._metrics: MetricsServer | None = None
        self._hardware: Hardware | None = None
        self._workers: tuple[Worker, ...] = ()
        self._run_log: RunLog | None = None
        self._lock: int | None = None
        self._opening: asyncio.Task[None] | None = None
        """Opening may stop an arm found in motion, so that the end waits for it."""
        self._started = self._ready = False
        self._reloading = asyncio.Lock()
        self._hung_up = 0
        """SIGHUPs since the running series of reloads began."""
        self._tasks: set[asyncio.Task[Any]] = set()

    async def run(self) -> int:
        """Start, serve until `end`, stop the arm, close everything; returns the exit status. An error is one line."""
        self._listen_to_signals()
        asyncio.get_running_loop().set_exception_handler(_report_unhandled)
        status = STOPPED
        try:
            started = await self._unless_ending(self._start())
            if started:
                await self._ending.wait()
        except FileError as error:
            status, self._why = BAD_CONFIGURATION, str(error)
        except (CellError, FrontendError, InUseError, ModbusError, OSError) as error:
            status, self._why = NO_DEVICE, plain(error)
        if status != STOPPED:
            journal.write("trouble", self._why, journal.ERROR)
            journal.notify(f"STATUS={self._why}")
        await self._end()
        return status

    def end(self, why: str) -> None:
        """Request the end of the daemon."""
        self._why = why
        self._ending.set()

    async def reload(self, who: str | None = None, change: Change | None = None) -> str:
        """Read configuration and calibration again; a bad one is refused and nothing changes. Raises ConfigError.

        who: the operator who requested it and gets the returned text; change: writes files first, under the same lock,
        and returns how to undo that after a refusal. Reloads run one at a time: while one waits for the arm's stop,
        another would overtake it, and files that one operator writes would mix with another's.
        """
        async with self._reloading:
            undo = None if change is None else await change()
            try:
                return await self._reload(who)
            except BaseException:
                if undo is not None:
                    undo()
                raise

    async def _reload(self, who: str | None) -> str:
        """Reload. Where the cell's geometry changes, the arm is disabled first: its operator enabled it, or confirmed a
        move, for the old geometry, and `enable` checks the new one."""
        assert self.context is not None
        context, old = self.context, self.context.config
        disabled, answered = "", None
        journal.notify("RELOADING=1", f"MONOTONIC_USEC={time.monotonic_ns() // 1000}")
        try:
            config = load_config(self._config_path, self._simulated)
            sections.check(config)
            _report_notes(config)
            calibration = sections.calibration_in_use(config)
            sections.check_hand_eye(config, calibration)
            if context.cycle.supervisor.busy:
                raise ConfigError(
                    f"{config.path}: not reloaded while a job is running; `reload` again when it has ended"
                )
            moved = _moved((old, context.calibration), (config, calibration))
            if moved:
                if context.cycle.supervisor.permission.granted:
                    disabled = f"The arm is disabled: {', '.join(moved)} changed."
                await context.cycle.supervisor.disable()
            context.cycle.supervisor.refuse_during_job("settings are changed")
            if (old.gripper, _tool(old)) != (config.gripper, _tool(config)):
                context.hardware.robot.use_tool(np.array(_tool(config)))
            context.cycle.refit(*pick_cell(config, calibration, context.hardware, context.log, context.worker))
            context.cycle.placing = place_table(config)
            context.config, context.calibration = config, calibration
            context.trainer.rig, context.trainer.settings = calibration.rig, config.values.vision
            context.trainer.memory = config.values.memory
            context.cycle.use(context.trainer.in_use)
            context.worker.within_s = _look_limit_s(config)
            context.worker.prepare(context.trainer.in_use)
            context.troubles.report("calibration", None)
            report_moved(context)
            answered = who
        except FacetdError as error:
            if disabled:
                disabled = f"The arm is disabled; nothing else has changed, as the reload was refused: {error}"
            journal.write("reload", f"refused, the configuration is unchanged: {error}", journal.ERROR)
            raise
        finally:
            if disabled:
                context.notices.tell(disabled, by=answered)
            journal.notify("READY=1")
        late = [name for name in AT_START if _at_start(config, name) != _at_start(old, name)]
        text = f"The configuration is reloaded. {disabled}".rstrip()
        if late:
            text += f" Takes effect after a restart: {', '.join(late)}."
        context.record_start(reloaded=True)
        journal.write("reload", text)
        return text

    # Starting

    async def _start(self) -> None:
        journal.starting("reading settings, calibration and model")
        config, calibration, trainer = read_files(self._config_path, self._simulated)
        _report_notes(config)
        try:
            self._lock = hold(config.state)
        except OSError as error:
            raise OSError(
                f"no folder for runs and models: {plain(error)}; see folders.state in {config.path}"
            ) from None
        troubles = Troubles(self._on_trouble)
        make_room(config)
        left = read_interrupted_state(config.state / FILE, bool(list_runs(config.runs)))
        folder, recovery = new_folder(config.runs, datetime.now(UTC)), RecoveryFile(config.state / FILE)
        if left is None:
            recovery.begin(folder.name)
        loop = asyncio.get_running_loop()
        run_log = self._run_log = RunLog(
            folder,
            fsync_every_s=config.values.log.sync_s,
            on_trouble=lambda text: loop.call_soon_threadsafe(troubles.report, "log", text and f"log: {text}"),
            recovery=recovery,
        )
        auto = None if left is None or left.auto is None else left.auto.json()
        if left is not None:
            run_log.record("left", run=left.run, cycle=left.cycle, state=left.state, hand_closed=left.hand_closed,
                           label=left.label, auto=auto, fault=left.fault)  # fmt: skip
        journal.starting("opening cameras and controller")
        self._hardware = cell.build(config, run_log.wire, record=run_log.record)
        self._opening = asyncio.create_task(self._hardware.open(), name="open the devices")
        await asyncio.shield(self._opening)
        journal.starting("preparing the cell")
        context = self._furnish(config, calibration, trainer, troubles, run_log)
        if left is not None:
            context.cycle.recover(left.state or "an unknown state", left.hand_closed, left.auto)
            troubles.report("restart", describe_interruption(left))
        context.record_start()
        self._started = True
        if self._hardware.robot.stopped_on_opening:
            await context.cycle.supervisor.fail("at work", AT_WORK, FaultCause(CauseCode.RESTARTED))
        if self._hardware.operator is not None:
            await know_drawings(context)
            self._hardware.operator.scatter()
        journal.starting("opening the operators' connections")
        await self._open_frontends(context)
        context.use_model("start", trainer.model_store.current)
        report_moved(context)
        watch = Watchdog(context)
        self.in_background(self._guarded(watch.run()), "watch")
        self.in_background(self._guarded(serve_the_line(context)), "signals")
        self.in_background(self._guarded(report_waiting_move(context)), "what waits for a yes")
        self._ready = True
        journal.notify("READY=1", f"STATUS={watch.status_line()}")
        gripper = "" if config.gripper is None else f", gripper {config.gripper}"
        text = f"ready: {config.kind} cell{gripper}, socket {config.socket}, run {run_log.folder}"
        journal.write("run_start", text)

    def _furnish(
        self, config: Config, calibration: Calibration, trainer: Trainer, troubles: Troubles, run_log: RunLog
    ) -> CommandContext:
        assert self._hardware is not None
        log = journal.JournalledLog(run_log, self._logged)
        worker, study = self._workers = (
            Worker("the look", _look_limit_s(config)),
            Worker("what is learnt", STUDY_S, STUDY_IDLE_S),
        )
        cycle = PickCycle(*pick_cell(config, calibration, self._hardware, log, worker), trainer.in_use)
        cycle.use_places(place_table(config))
        signals, robot = config.values.signals, self._hardware.robot
        form = load_form(config.state) if signals else None
        plc = PLCInputs(() if config.values.modbus is None else config.values.modbus.roles)
        cycle.production_line = ProductionLine(signals, robot, form, self._hardware.clock, log.record, plc)
        self.context = CommandContext(
            config, calibration, self._hardware, cycle, trainer, run_log, log, troubles, self.reload, worker, study
        )
        cycle.observer = CycleObserver(self.context, self.in_background)
        return self.context

    async def _open_frontends(self, context: CommandContext) -> None:
        values = context.config.values
        self._interpreter = Interpreter(context, every_command(context.hardware.kind))
        self._socket = SocketServer(context.config.socket, Rights(values.console), self._interpreter, self._interrupt)
        await self._socket.open()
        if values.console.tty is not None:
            self._terminal = SerialFrontend(
                values.console.tty,
                self._interpreter,
                self._interrupt,
                lambda text: context.troubles.report("console", text),
            )
            self.in_background(self._guarded(self._terminal.run()), "terminal")
        if values.metrics.port is not None:
            from daemon.maintenance.metrics import MetricsServer  # with it HTTP, for which few ask

            self._metrics = MetricsServer(context, values.metrics.port)
            self._metrics.open()
        if values.modbus is not None:
            self._serve_modbus(context, values.modbus)

    def _serve_modbus(self, context: CommandContext, settings: ModbusSettings) -> None:
        """Serve a PLC on the socket that systemd handed in; without one no PLC permits anything. Raises ModbusError
        without the extra."""
        listener = inherited_socket()
        if listener is None:
            text = "no socket was handed in: `systemctl enable --now facetd-modbus.socket`, then restart facetd"
            context.troubles.report("modbus", f"modbus: {text}")
            return
        server = ModbusServer(listener, settings, context.cycle.production_line.plc, lambda: plc_readings(context))
        self.in_background(self._guarded(server.serve()), "modbus")

    # While it runs

    def _listen_to_signals(self) -> None:
        loop = asyncio.get_running_loop()
        for number in ENDING:
            loop.add_signal_handler(number, self.end, f"signal {number.name}")
        loop.add_signal_handler(signal.SIGHUP, self._hang_up)

    def _hang_up(self) -> None:
        if self.context is None:
            return
        if not self._hung_up:
            self.in_background(self._reload_quietly(), "reload")
        self._hung_up += 1

    async def _reload_quietly(self) -> None:
        """Reload once for a burst of SIGHUPs: reading blocks the loop, and a burst would delay a stop by seconds."""
        try:
            done = 0
            while done < self._hung_up:
                done = self._hung_up
                with contextlib.suppress(FacetdError):
                    await self.reload()
                await asyncio.sleep(RELOAD_S)
        finally:
            self._hung_up = 0

    async def _interrupt(self, who: str, about_to_move: bool) -> str:
        """Handle a control-C at any frontend; returns the answer."""
        assert self.context is not None
        supervisor = self.context.cycle.supervisor
        if not about_to_move and await supervisor.at_rest():
            return "Nothing moves."
        alarm = await supervisor.stop(f"by control-C of {who}")
        with contextlib.suppress(Exception):  # the operator gets an answer all the same
            self.context.log.record("command", who=who, door="control-C", text="stop")
        return alarm or "Stopped. Nothing moves until `resume`."

    def _on_trouble(self, source: str, text: str | None) -> None:
        if text is None:
            journal.write("trouble_over", f"{source}: OK again", journal.NOTICE)
        else:
            journal.write("trouble", text, journal.WARNING)
            self._notice(f"TROUBLE {text}")

    def _logged(self, kind: str, text: str, who: str | None) -> None:
        """Show a record of the log at the frontends that want it."""
        if self.context is not None:
            level = NoticeLevel.ALL if kind in ("command", "model") else NoticeLevel.FAULTS
            by = who if level is NoticeLevel.ALL else None
            self.context.notices.tell(text, level, by, refusal=kind == "refusal")

    def _notice(self, text: str) -> None:
        """Show a notice at every frontend."""
        if self.context is not None:
            self.context.notices.tell(text)

    def in_background(self, work: Coroutine[Any, Any, Any], name: str) -> None:
        """Run a coroutine in the background, until the end at most."""
        task = asyncio.create_task(work, name=name)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _guarded(self, work: Coroutine[Any, Any, None]) -> None:
        """Run a part of the daemon that must not fail: if it does, the daemon stops the arm and ends."""
        try:
            await work
        except asyncio.CancelledError:
            raise
        except Exception as error:
            self.end(f"{type(error).__name__}: {error}")
            raise

    async def _unless_ending(self, work: Coroutine[Any, Any, None]) -> bool:
        """Do the work unless the end is requested meanwhile; returns whether it was done."""
        task, ending = asyncio.create_task(work), asyncio.create_task(self._ending.wait())
        await asyncio.wait([task, ending], return_when=asyncio.FIRST_COMPLETED)
        ending.cancel()
        if not task.done():
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
            return False
        task.result()
        return True

    # Ending

    async def _end(self) -> None:
        """Stop the arm, then close everything. A step that fails or hangs does not prevent the others."""
        if self.context is not None:
            await _within(HALT_S, _bring_to_rest(self.context.cycle.supervisor))
        elif self._opening is not None and not self._opening.done():
            await _within(HALT_S, self._opening)
        journal.notify("STOPPING=1", f"STATUS={self._why}")
        if self._started and self.context is not None and self.context.cycle.production_line.has_line:
            await _within(0.5, self.context.cycle.production_line.set_outputs(PackMLState.ABORTED))
        for task in self._tasks:
            task.cancel()
        await asyncio.wait(self._tasks, timeout=0.2) if self._tasks else None
        for worker in self._workers:
            worker.close()
        if self._socket is not None:
            await _within(0.3, self._socket.close())
        if self._metrics is not None:
            self._metrics.close()
        if self._hardware is not None:
            await _within(0.5, self._hardware.close())
        if self._run_log is not None:
            holding = (
                {} if self.context is None or not self._ready else {"holding": self.context.cycle.belief.holds_part}
            )
            self._run_log.close(self._why, **holding)
            if not self._started:  # restarts over a weekend without a device would leave thousands
                shutil.rmtree(self._run_log.folder, ignore_errors=True)
        if self._lock is not None:
            os.close(self._lock)
        if self._ready:
            journal.write("run_end", f"ended: {self._why}")
        journal.flush(0.3)


def read_files(config_path: Path, simulated: bool) -> tuple[Config, Calibration, Trainer]:
    """Read every file that a start needs; no device is opened. Raises FileError."""
    config = load_config(config_path, simulated)
    sections.check(config)
    config = replace(config, notes=(*config.notes, *sections.out_of_reach(config)))
    files = config.values.files
    calibration = sections.calibration_in_use(config)
    sections.check_hand_eye(config, calibration)
    config = replace(config, notes=(*config.notes, *sections.of_another_size(config, calibration)))
    library, parts = load_facets(config.file(files.facets)), load_parts(config.file(files.parts))
    first = None if files.model is None else load_model(config.file(files.model))
    values = config.values
    trainer = Trainer(
        ModelStore(config.state), calibration.rig, library, parts, values.vision, first, memory=values.memory
    )
    return config, calibration, trainer


def _look_limit_s(config: Config) -> float:
    return LOOK_S + SHARED_BY * config.values.vision.budget_s


def _tool(config: Config) -> Matrix4:
    return config.values.arm.flange_from_tool


def _at_start(config: Config, name: str) -> object:
    """What takes effect only at a start of a section: of the arm all but its tool."""
    arm = config.values.arm
    return replace(arm, flange_from_tool=TOOL) if name == "arm" else getattr(config.values, name)


def _moved(before: tuple[Config, Calibration], after: tuple[Config, Calibration]) -> list[str]:
    """The parts of the cell's geometry that differ between two configurations and calibrations."""
    (config, calibration), (new_config, new_calibration) = before, after
    mounted = (config.gripper, _tool(config)) == (new_config.gripper, _tool(new_config))
    found = [] if mounted else ["the mounted gripper"]
    if mounted and not same_geometry(calibration, new_calibration):
        found.append("calibration")
    pick, new_pick = config.values.pick, new_config.values.pick
    if config.places.file.fixtures != new_config.places.file.fixtures:
        found.append(f"fixtures of {new_config.places_file.name}")
    guarding = GUARDING if mounted else ("limits",)
    return found + [f"pick.{name}" for name in guarding if getattr(pick, name) != getattr(new_pick, name)]


def _report_notes(config: Config) -> None:
    for note in config.notes:
        journal.write("trouble", note, journal.NOTICE)


def make_room(config: Config) -> None:
    """Remove old runs beyond the quota before a start, which needs room on the disk."""
    limits = config.values.log
    most, least = limits.quota_mb * 1_000_000, limits.keep_free_mb * 1_000_000

    def report_stuck(run: Path, why: str) -> None:
        journal.write("trouble", journal.stuck(run, why), journal.WARNING)

    journal.write_removed(enforce_quota(config.runs, most, None, least, report_stuck))


async def _bring_to_rest(supervisor: Supervisor) -> None:
    """Stop the arm and wait until it rests, also after the alarm, as later tries may succeed."""
    await supervisor.close()
    await supervisor.wait_for_stop_end()


def _report_unhandled(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Report an exception in a callback, which no task awaits."""
    if "exception" in context and not {"task", "future"} & context.keys():
        error = context["exception"]
        journal.write("trouble", f"{context['message']}: {type(error).__name__}: {error}", journal.ERROR)


async def _within(seconds: float, work: Awaitable[Any]) -> None:
    """One step of the end, with a time limit; an exception is reported."""
    try:
        async with asyncio.timeout(seconds):
            await work
    except TimeoutError:
        journal.write(
            "trouble", f"{getattr(work, '__qualname__', 'a step')} took longer than {seconds:g} s", journal.WARNING
        )
    except Exception as error:
        journal.write("trouble", f"while ending: {type(error).__name__}: {error}", journal.ERROR)
