"""Command `facetctl commission`: every check from an identified arm to the first pick, in order.

commission_steps.py has the checks. A small file records each proof with the calibration and the model in use, so that
commissioning can continue another day.
"""

import argparse
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import msgspec

from daemon.cli.commission_steps import (
    STEPS,
    CommissioningDialogue,
    CommissioningPlan,
    CommissioningSession,
    CommissioningStep,
    NotProvenError,
)
from daemon.errors import DONE, NOT_DONE, NOT_UNDERSTOOD
from daemon.frontends.client import DaemonLink
from daemon.frontends.keyboard import InputLines
from daemon.quantities import decimal
from daemon.store.files import write_atomically
from daemon.store.json_file import read_json
from daemon.store.outside import FileError

FILE = "commission.json"
_tell = partial(print, flush=True)


class StepProof(msgspec.Struct, frozen=True):
    """Proof of a step: when, what it showed, with which calibration and model."""

    at: str
    shown: str
    calibration: int
    model: int | None


class CommissioningFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    version: int
    steps: dict[str, StepProof]


def commission(
    talk: CommissioningSession, proofs: dict[str, StepProof], keep: Callable[[Mapping[str, StepProof]], None]
) -> bool:
    """Do every step without a valid proof, in order, up to the first failure; returns whether all are proven."""
    for number, step in enumerate(STEPS, 1):
        calibration, model = talk.facts()
        proof = proofs.get(step.name)
        talk.person.tell(f"{number:2} of {len(STEPS)}  {step.name}: {step.proves}")
        if proof is not None and _is_valid(step, proof, calibration, model):
            talk.person.tell(f"  done {proof.at}: {proof.shown}")
            continue
        try:
            shown = step.do(talk)
        except NotProvenError as error:
            talk.person.tell(
                f"  NOT PROVEN: {error}\n  To do: {step.mend}.\n  Then continue here: `facetctl commission`."
            )
            return False
        talk.person.tell(f"  proven: {shown}")
        calibration, model = talk.facts()
        proofs[step.name] = StepProof(datetime.now(UTC).isoformat(timespec="minutes"), shown, calibration, model)
        keep(proofs)
    return True


def _is_valid(step: CommissioningStep, proof: StepProof, calibration: int, model: int | None) -> bool:
    now = {"calibration": calibration, "model": model}
    return step.with_what is not None and all(getattr(proof, what) == now[what] for what in step.with_what)


def run(link: DaemonLink, words: list[str]) -> int:
    """Run `facetctl commission` at a terminal, with the running daemon."""
    options = _parser().parse_args(words)
    path = options.keep / FILE
    try:
        proofs = read_proofs(path)
        names = [step.name for step in STEPS]
        if options.step is not None:
            proofs = {name: proof for name, proof in proofs.items() if name in names[: names.index(options.step)]}
        options.keep.mkdir(parents=True, exist_ok=True)
        order = CommissioningPlan(options.board, options.square_mm, options.board_mm, options.part, options.charuco)
        with InputLines(lambda text: _tell(link.stop_separately(text, "commission", _tell)["text"]), _tell) as typed:
            person = CommissioningDialogue(_tell, lambda question: typed.answer(f"  {question}"))
            all_proven = commission(CommissioningSession(link, person, order), proofs, partial(write_proofs, path))
    except (FileError, OSError) as error:
        print(f"facetctl: {error}", flush=True)
        return NOT_UNDERSTOOD
    if all_proven:
        print(f"The cell picks. {path} records each proof. Continue with docs/operate/README.md.", flush=True)
    return DONE if all_proven else NOT_DONE


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="facetctl commission", description=__doc__.splitlines()[0])
    parser.add_argument("step", nargs="?", choices=[step.name for step in STEPS], help="repeat from this step on")
    parser.add_argument("--board", default="9x6", help="the calibration board's inner corners (9x6)")
    parser.add_argument("--square-mm", type=decimal, default=16.0, help="its squares, measured (16)")
    parser.add_argument("--board-mm", type=decimal, default=4.0, help="how thick it is (4)")
    parser.add_argument("--charuco", action="store_true", help="it is a ChArUco board")
    parser.add_argument("--part", default="cube", help="the first part, by its label (cube)")
    parser.add_argument("--keep", type=Path, default=Path(), metavar="DIR", help=f"where {FILE} is (default: here)")
    return parser


def read_proofs(path: Path) -> dict[str, StepProof]:
    """The proofs of earlier sessions. Raises FileError."""
    found = read_json(path, CommissioningFile, "move it away to start again")
    return {} if found is None else found.steps


def write_proofs(path: Path, proofs: Mapping[str, StepProof]) -> None:
    """Write the proofs of this and earlier sessions."""
    write_atomically(path, msgspec.json.format(msgspec.json.encode(CommissioningFile(1, dict(proofs)))))
