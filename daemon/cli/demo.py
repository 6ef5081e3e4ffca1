"""Command `facetctl demo`: teach, train, clear a table and fill a kit in the simulated cell, by console commands.

It starts a daemon of its own, sends it commands, and follows its run log. The true error of each grasp comes from the
simulated cell; the daemon records it and never uses it.
"""

import argparse
import contextlib
import json
import random
import re
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from daemon.cli import demo_kit
from daemon.cli.starting import StartError, daemon_in, wait_until_ready
from daemon.errors import FacetdError
from daemon.events.outcomes import BROUGHT
from daemon.events.records import Record
from daemon.frontends.client import DaemonLink, DaemonUnreachableError
from daemon.quantities import decimal, whole
from daemon.store import folders, place_file
from daemon.store.recovery_state import FILE, RecoveryFile
from daemon.store.runs import follow, list_runs
from daemon.vision.model import facet_name

TRIANGLE = "isosceles_triangle"
VIEWS = (
    ("cube", 0, ("square", "square", "square")),
    ("pyramid", 0, (TRIANGLE, TRIANGLE, TRIANGLE, TRIANGLE)),
    ("pyramid", 1, (TRIANGLE, TRIANGLE, "square")),
    ("triangular_prism", 0, ("equilateral_triangle", "rectangle", "rectangle")),
    ("pentagonal_prism", 0, ("pentagon", "rectangle", "rectangle")),
    ("pentagonal_prism", 1, ("rectangle", "rectangle", "rectangle")),
)
"""The six characteristic views (D'Souza, chapter 5), and the facets that a person sees in each, to confirm `teach`."""
TEACHING_TRIES = 6
"""Most looks at a view before it is given up."""
PARTS = tuple(dict.fromkeys(label for label, _, _ in VIEWS))
MACHINED = {"machined_bracket": "machined_bracket.obj", "knob": "knob.obj"}
"""Parts that `--machined` adds, and their drawings in etc/: bores, a slot, a fillet, an end that is round."""
ROUNDS = 3
"""Most passes over the table."""
say = partial(print, flush=True)
VERDICT = "verdict.jsonl"
TRUTH = "simcell.yaml"
FASTEST = 20.0
"""Most speed of the cell, as a multiple of real time."""
STEPS, STEPS_S = 3_000_000, 0.17
"""Steps of a loop, and the time they may take at that speed: twice what they took where it was tried (AMD EPYC, Python
3.11: 0.085 s of processor time, within 0.002 s)."""
WAIT_S = 60.0
"""Longest wait for an echo or an answer of the controller, s. It is in the daemon's own process and always answers; on
an emulated computer that others used as well, an answer took longer than 5 s."""


class DemoError(FacetdError):
    """The demo cannot continue: why."""


def register(subparsers: Any) -> None:
    """Add `demo` to facetctl."""
    parser = subparsers.add_parser("demo", help="simulated cell: teach, train, pick each part, fill a kit, report")
    parser.add_argument("--seed", type=whole, help="repeat an earlier demo (each prints its seed)")
    parser.add_argument(
        "--time-scale", type=decimal, help="speed of the cell as a multiple of real time (20; less on a slow computer)"
    )
    parser.add_argument("--table", choices=("plain", "patterned"), default="plain", help="what the parts lie on")
    parser.add_argument("--parts", choices=("plain", "printed"), default="plain", help="what the parts look like")
    parser.add_argument("--machined", action="store_true", help="also a bracket and a knob, taught from drawings")
    parser.add_argument("--fixed", action="store_true", help="cameras over the table (eye-to-hand), not on the gripper")
    parser.add_argument("--runs", type=Path, help="where the run is written (as the daemon does)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the demo; 0 where every pick and every set-down succeeded. Raises FileError, DemoError, OSError."""
    from daemon.review.page import write_page

    args.time_scale = _time_scale() if args.time_scale is None else args.time_scale
    seed = args.seed if args.seed is not None else random.SystemRandom().randrange(1_000_000)
    runs = (args.runs or folders.runs_folder(simulated=True)).resolve()
    began = time.monotonic()
    with (
        tempfile.TemporaryDirectory(prefix="facetd-demo-") as folder,
        _daemon(Path(folder), _configuration(args, seed, runs, folder)) as (process, link),
    ):
        written = Path(link.do("status", "demo", say)["data"]["run"])
        if runs == folders.runs_folder(simulated=True).resolve() and list_runs(runs) == [written]:
            _begin(folders.state_folder(simulated=True), written.name)  # for later daemons, which find this run
        looks = {name: getattr(args, name) for name in ("table", "parts")}
        look = "".join(f" --{name} {kind}" for name, kind in looks.items() if kind != "plain")
        look += "".join(f" --{name}" for name in ("machined", "fixed") if getattr(args, name))
        parts = (*PARTS, *MACHINED) if args.machined else PARTS
        look += f" --time-scale {args.time_scale:g}" if args.time_scale != FASTEST else ""
        again = f"seed {seed} (repeat it with --seed {seed}{look})"
        say(f"facetctl demo: {again}, cell time x{args.time_scale:g}, run {written}")
        _teach(link, MACHINED if args.machined else {})
        brought = ("picked", "released") if args.fixed else ("picked",)  # fixed cameras do not always see it leave
        records = follow(written, lambda: process.poll() is None)
        rows = _clear(link, parts, records, brought)
        kit = None if args.fixed or _faulted(rows) else _fill_kit(link, Path(folder), records)
        found = _forbidden_motions(Path(folder) / VERDICT)
    picked = _table(rows, len(parts), brought)
    if kit is not None:
        say("\n".join(kit.lines))
    say(f"{time.monotonic() - began:.0f} s in all; report: {write_page(written, written / 'report.html')}")
    say("\n".join(found) or "the cell's motion monitor found no forbidden motion")
    kitted = args.fixed or (kit is not None and kit.right == len(demo_kit.NESTS))
    return 0 if picked == len(parts) and kitted and not found else 1


def _begin(state: Path, run: str) -> None:
    """Write an empty recovery state: a daemon that finds runs and none would report it as lost. Raises OSError."""
    with contextlib.closing(RecoveryFile(state / FILE)) as file:
        file.begin(run)


def _forbidden_motions(verdict: Path) -> list[str]:
    """The forbidden motions that the simulated cell's motion monitor found, one line each."""
    lines = [json.loads(line) for line in verdict.read_text(encoding="utf-8").splitlines()]
    return [f"MOTION MONITOR {line['rule']}: {line['text']} (`{line['by']}`)" for line in lines if "rule" in line]


def _time_scale(clock: Callable[[], float] = time.perf_counter) -> float:
    """How fast the cell may go here: at FASTEST a slow computer, or one that is shared, looks as if it were asleep."""
    began_s, total = clock(), 0
    for number in range(STEPS):
        total += number & 3
    return round(min(FASTEST, max(1.0, FASTEST * STEPS_S / (clock() - began_s))), 1)


def _configuration(args: argparse.Namespace, seed: int, runs: Path, folder: str) -> dict[str, Any]:
    """facetd.yaml of the demo's daemon. Idle cameras are not checked: a seed would not repeat a run."""
    from daemon.config import load_config

    config = load_config(folders.ETC / ("fixed" if args.fixed else "") / "facetd.yaml", simulated=True)
    own = config.document.data if args.fixed else {}
    files = {name: str(config.file(getattr(config.values.files, name))) for name in ("calibration", "facets", "parts")}
    truth, limits = config.file(config.values.simulated.truth), config.values.pick.limits
    if not args.fixed:
        demo_kit.write_truth(truth, Path(folder) / TRUTH)
        (Path(folder) / place_file.FILE).write_text(demo_kit.places_yaml({}), encoding="utf-8")
        truth = Path(folder) / TRUTH
    room = {"room_low_mm": limits.room_low_mm, "room_high_mm": limits.room_high_mm}
    return {
        "version": 1,
        "cell": "simulated",
        "files": files,
        "folders": {"state": folder, "runtime": folder, "runs": str(runs)},
        "health": {"camera_silence_s": 3600},
        "cameras": own.get("cameras", {}),
        "arm": {"dialect": {"typing_s": WAIT_S, "answer_s": WAIT_S}},
        "pick": own.get("pick", {})
        | {"stops": {"least_looks": 3} | own.get("pick", {}).get("stops", {}), "limits": room},
        "simulated": {
            "truth": str(truth),
            "time_scale": args.time_scale,
            "seed": seed,
            "verdict": VERDICT,
            "table": args.table,
            "parts": args.parts,
        },
    }


@contextlib.contextmanager
def _daemon(folder: Path, configuration: dict[str, Any]) -> Iterator[tuple[subprocess.Popen[bytes], DaemonLink]]:
    """Start a daemon with all its files in a folder, and connect to it. Raises DemoError with its last message."""
    (folder / "facetd.yaml").write_text(json.dumps(configuration))
    _begin(folder, "demo")
    with daemon_in(folder, 10.0) as (process, reports):
        try:
            wait_until_ready(process, reports, say)
            with DaemonLink(folder / folders.SOCKET_NAME) as link:
                yield process, link
        except (DaemonUnreachableError, DemoError, StartError) as error:
            with contextlib.suppress(subprocess.TimeoutExpired):
                if process.wait(2.5) == 0:  # control-C at a terminal ends the daemon too
                    raise KeyboardInterrupt from None
            if isinstance(error, DemoError):
                raise
            lines = (folder / "stderr").read_text(errors="replace").strip().splitlines()
            last = lines[-1].removeprefix("facetd: ") if lines else ""
            if isinstance(error, StartError):
                raise DemoError(f"{error}{f'; its last message: {last}' if last else ''}") from None
            raise DemoError(last or "the daemon has ended") from None


def _do(link: DaemonLink, text: str) -> dict[str, Any]:
    """Send a command that must succeed; returns its data. Raises DemoError."""
    done = link.do(text, "demo", lambda _: None)
    if done["status"]:
        raise DemoError(f"{text}: {done['text']}")
    return dict(done["data"])


def _teach(link: DaemonLink, drawn: dict[str, str]) -> None:
    """Teach the six views and the drawings, train, and take the model into use."""
    say("teaching")
    for text in ("enable", "go survey"):
        _do(link, text)
    for label, view, facets in VIEWS:
        if not any(_teach_view(link, label, view, facets) for _ in range(TEACHING_TRIES)):
            raise DemoError(
                f"the {label} was not seen whole in {TEACHING_TRIES} looks; check light, focus, calibration"
            )
    _teach_drawings(link, drawn)
    _train(link)


def _teach_drawings(link: DaemonLink, drawn: dict[str, str]) -> None:
    """Teach parts, by label, from their drawings in etc/."""
    for label, drawing in drawn.items():
        done = link.do(f"teach {label} --mesh {folders.ETC / drawing}", "demo", lambda _: None, lambda _: "y")
        if done["status"]:
            raise DemoError(f"teach {label}: {done['text']}")
        say(f"  {label}, from {drawing}")


def _train(link: DaemonLink) -> None:
    trained = _do(link, "train")
    if not trained.get("accepted"):
        _do(link, "accept")
    say(f"trained on {trained['views']} views in {trained['seconds']:.1f} s, {trained['right']} of them named right")


def _teach_view(link: DaemonLink, label: str, view: int, facets: tuple[str, ...]) -> bool:
    """Teach one view and confirm it where the facets are right; returns whether it was stored."""
    lines: list[str] = []

    def answer(_: str) -> str:
        return "y" if _facets_in(lines[-1]) == sorted(map(facet_name, facets)) else "n"

    done = link.do(f"teach {label}", "demo", lines.append, answer)
    seen = _facets_in(lines[-1]) if lines else []
    stored = bool(done["status"] == 0)
    why = f"not all of it was seen ({', '.join(seen)})" if seen else done["text"]
    say(f"  {label}, view {view + 1}: {', '.join(seen) if stored else f'{why}; again'}")
    return stored


def _facets_in(text: str) -> list[str]:
    """The names of the facets in a line of `teach`, equal ones together: `side 1 2: square 50 50 50 50 mm`."""
    lines = re.findall(r"side ([\d? ]+): ([a-z][a-z -]*) \d[\d ]* mm", text)
    return sorted(kind for sides, kind in lines for _ in sides.split())


def _clear(link: DaemonLink, parts: Sequence[str], records: Iterator[Record], brought: Sequence[str]) -> list[Record]:
    """Pick until all parts are in the bin, at most ROUNDS times; returns the end of each pick with its true error."""
    if parts != PARTS:
        _do(link, f"scatter {' '.join(parts)}")
    say(f"the table: {', '.join(parts)}, in random poses")
    ends: list[dict[str, Any]] = []
    truths: dict[int, Record] = {}
    for _ in range(ROUNDS):
        left = len(parts) - sum(end["outcome"] in brought for end in ends)
        if not left or _faulted(ends):
            break
        _do(link, f"auto on {left}")
        ended, true = _follow_auto(records)
        ends, truths = ends + ended, truths | true
    tried = [end for end in ends if end["outcome"] in (*brought, "missed", "fault") and end["predicted"]]
    unknown = {"error_mm": None, "error_deg": None, "held": False}
    return [{**end, **truths.get(end["cycle"], unknown)} for end in tried]


def _faulted(rows: Sequence[dict[str, Any]]) -> bool:
    return bool(rows) and (rows[-1]["outcome"] == "fault" or rows[-1].get("stopped") is not None)


def _fill_kit(link: DaemonLink, folder: Path, records: Iterator[Record]) -> demo_kit.KitResult:
    """Bring the parts, taught from drawings as well (their hidden sides), to the nests of a plate."""
    say("\nthe kit: the same parts from their drawings, with the sides that were never shown")
    nests = demo_kit.NESTS
    _teach_drawings(link, {nest.part: nest.drawing for nest in nests})
    _train(link)
    edges_mm = {nest.part: _do(link, f"place show {nest.part}")["edges_mm"] for nest in nests}
    (folder / place_file.FILE).write_text(demo_kit.places_yaml(edges_mm), encoding="utf-8")
    for text in ("reload", "enable"):  # another fixture disables the arm
        _do(link, text)
    _do(link, f"scatter steady {' '.join(nest.part for nest in nests)}")
    say("a plate with four nests, the parts beside it in random poses")
    seen: list[Record] = []
    for _ in range(ROUNDS):
        left = len(nests) - demo_kit.kit_result(seen).right
        if not left:
            break
        _do(link, f"auto on {left}")
        if _faulted(_follow_auto(_stored_in(records, seen))[0]):
            break
    return demo_kit.kit_result(seen)


def _stored_in(records: Iterator[Record], seen: list[Record]) -> Iterator[Record]:
    """The records as they come; each is kept in a list."""
    for record in records:
        seen.append(record)
        yield record


def _follow_auto(records: Iterator[Record]) -> tuple[list[dict[str, Any]], dict[int, Record]]:
    """Print the picks of an auto until it ends; returns the ends, and the true errors by cycle."""
    ends, truths = list[dict[str, Any]](), dict[int, Record]()
    began_s = 0.0
    for record in records:
        match record["kind"]:
            case "cycle_start":
                began_s = record["mono_s"]
            case "decision" if record["text"] not in BROUGHT:  # these come once more, with their time
                say(f"  {record['text']}: {record['why']}")
            case "estimate":
                error = f"{record['predicted_mm']:.2f} mm, {record['predicted_deg']:.2f} degrees"
                say(f"  look {record['stop']}: {record['label']}, predicted error at the grasp {error}")
            case "refusal" | "fault" as kind:
                say(f"  {kind}: {record['text']}")
            case "truth":
                truths[record["cycle"]] = record
            case "cycle_end":
                ends.append({**record, "seconds": record["mono_s"] - began_s})
                say(f"  {record['outcome']}: {record['why']} ({ends[-1]['seconds']:.1f} s)")
                if record["outcome"] in ("fault", "aborted") or record.get("stopped"):
                    break
            case "auto" if not record["on"]:
                break
    return ends, truths


def _table(rows: list[dict[str, Any]], parts: int, brought: Sequence[str]) -> int:
    """Print a table of the picks of so many parts; returns how many succeeded, as the simulated cell confirms."""
    say(f"\n{'part':18}{'outcome':9}{'looks':>6}{'predicted':>20}{'true error at grasp':>23}{'time':>8}")
    for row in rows:
        predicted = demo_kit.error_text(row["predicted"]["mm"], row["predicted"]["deg"])
        error = demo_kit.error_text(row["error_mm"], row["error_deg"])
        outcome = row["outcome"] if row["held"] or row["outcome"] not in brought else "WRONG"
        say(f"{row['label'] or 'none':18}{outcome:9}{row['stops']:6}{predicted:>20}{error:>23}{row['seconds']:6.1f} s")
    done = [row["outcome"] for row in rows if row["outcome"] in brought and row["held"]]
    picked = done.count("picked")
    rest = f", {len(done) - picked} released and not confirmed by a look" if len(done) > picked else ""
    say(f"{picked} of {parts} parts picked{rest}")
    return len(done)
