"""Which arm a first contact has met, and what is kept of it: arm.yaml, and a page for people.

In: what is known after the first contact (drivers/val2/acquaintance.py). Which arm makes readings is
calibration/arm_from_readings.py's; here it is held beside the published ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.arm_from_readings import LENGTHS, ArmFound, NoArmError, find_arm, refined
from drivers.puma560 import PUMA560
from drivers.pumas import PUBLISHED, Likeness, PublishedArm, likeness
from drivers.val2.acquaintance import Acquaintance, ProbeFinding
from drivers.val2.dialect import Dialect
from drivers.val2.location import matrix_from_location

FITTED = "least squares over WHERE's places and joints"
LOOSE_MM = 0.1
TOO_LOOSE_MM = 0.3
"""Standard deviations, told larger than they are (a place is taken to be off by two of its last digits)."""
MISFIT_MORE = 2.4
"""A reading: steps are whole degrees, so that what the last digits of the joints leave out is the same in all readings,
and adds up in each; zeros that are free swallow it."""
STRAIGHT_DEG, ALONE = 10.0, 0.1
"""Joints 4 and 6 turn about one axis where theirs are no farther apart; a joint turns alone where no other turns by a
greater share."""
LEAST_TOLD = 0.001
"""mm or degrees: no controller prints its places so finely that less could be told."""


@dataclass(frozen=True, eq=False)
class Arm:
    """The arm that the readings show, after a published one's lengths where they are those, and how these were
    found. source: `published` or `typed` where the readings settle all but the lengths."""

    found: ArmFound
    alike: Likeness | None
    others: tuple[str, ...]
    how: str
    source: str = ""


def arm_of(known: Acquaintance, typed_mm: tuple[float, float, float, float] | None = None) -> Arm:
    """Which arm makes the readings, and whose it is. typed_mm: its a2, a3, d3, d4, as its drawing has them, where none
    is published. Raises NoArmError."""
    arms = PUBLISHED if typed_mm is None else (PublishedArm("arm of the lengths typed", typed_mm, "its operator"),)
    places = np.array([matrix_from_location(where.location) for where in known.readings])
    printed = np.array([where.joints_deg for where in known.readings])
    mm, degrees = known.findings["digits"].value
    digits = (10.0**-mm, 10.0**-degrees)
    found, alike, sigma = _found(places, printed, digits, arms)
    if alike is not None and alike.unit_mm != 1.0:
        known.found("unit_mm", alike.unit_mm, f"WHERE's lengths are a {alike.arm.name}'s in this unit", "likely")
        places[:, :3, 3] *= alike.unit_mm
        digits = (alike.unit_mm * digits[0], digits[1])
        found, alike, sigma = _found(places, printed, digits, arms)
    if alike is None and typed_mm is not None:
        raise NoArmError(
            f"WHERE shows {_lengths(found)}: not the lengths typed, {', '.join(f'{one:g}' for one in typed_mm)} mm"
        )
    if max(sigma) < LOOSE_MM or alike is None:
        return Arm(found, alike, (), FITTED)
    settled = sorted(_like_published(found, arms, places, printed, digits, sigma), key=lambda each: each[0])
    best = settled[0]
    fits = best[0] <= found.misfit + MISFIT_MORE * len(printed)
    if not fits and typed_mm is not None:
        raise NoArmError(f"the lengths typed do not fit WHERE's places, which show {_lengths(found)}")
    if not fits:
        return Arm(found, None, (), f"{FITTED}; no published lengths fit them")
    others = tuple({each[1].name for each in settled[1:] if each[0] < best[0] + 9.0} - {best[1].name})
    return Arm(
        best[2],
        replace(alike, arm=best[1]),
        others,
        f"the readings lie so near together that they leave {max(sigma):.1f} mm open; the lengths are those "
        + (f"published for the {best[1].name} ({best[1].source})" if typed_mm is None else "typed")
        + ", which fit",
        "published" if typed_mm is None else "typed",
    )


def _found(
    places: Array, printed: Array, digits: tuple[float, float], arms: Sequence[PublishedArm]
) -> tuple[ArmFound, Likeness | None, tuple[float, float, float, float]]:
    """The arm, which of arms it is like, and how well its lengths are known."""
    try:
        found = find_arm(places, printed, digits)
    except NoArmError as error:
        raise NoArmError(f"{error}{_straight(places, printed)}") from None
    sigma = found.sigma["a2"], found.sigma["a3"], found.sigma["d3"], found.sigma["d4"]
    return found, likeness(found.lengths_mm, sigma, arms), sigma


def _straight(places: Array, printed: Array) -> str:
    """What to do if the wrist was straight: joints 4 and 6, each turned by itself, turned the tool about one axis."""
    turned = np.diff(printed, axis=0)
    axes = {}
    for k, step in enumerate(turned):
        joint = int(np.abs(step).argmax())
        if joint in (3, 5) and np.abs(np.delete(step, joint)).max() < ALONE * np.abs(step[joint]):
            axis = frames.difference(places[k + 1], places[k])[3:]
            axes[joint] = axis / np.linalg.norm(axis)
    if len(axes) < 2 or abs(float(axes[3] @ axes[5])) < np.cos(np.radians(STRAIGHT_DEG)):
        return ""
    return (
        f". The wrist was straight (joint 5 read {printed[0, 4]:.1f} degrees): joints 4 and 6 turned about one axis. "
        "Bend joint 5 by 30 degrees or more with the pendant, and say it again"
    )


def _lengths(found: ArmFound) -> str:
    return ", ".join(
        f"{name} {value:.1f} mm {_sure(found, name)}" for name, value in zip(LENGTHS, found.lengths_mm, strict=True)
    )


def _like_published(
    found: ArmFound,
    arms: Sequence[PublishedArm],
    places: Array,
    printed: Array,
    digits: tuple[float, float],
    sigma: Sequence[float],
) -> Iterator[tuple[float, Any, ArmFound]]:
    """For each published arm near enough: its misfit, itself, and the readings' arm with its lengths."""
    for arm in arms:
        if likeness(found.lengths_mm, tuple(sigma), (arm,)) is None:  # type: ignore[arg-type]
            continue
        a2, a3, d3, d4 = arm.lengths_mm
        for elbow_mm in {a3, -a3}:
            lengths = a2, elbow_mm, float(np.copysign(d3, found.d3_mm)), d4
            made = refined(found, places, printed, lengths, digits)
            yield made.misfit, arm, made


# What is kept: arm.yaml and a page


def _zeros_deg(found: ArmFound, known: Acquaintance) -> list[float]:
    """Joints' zeros, each by so many whole turns that the arm, where it was read, is nearest to the middle of a PUMA's
    ranges: which turn it is, no place can tell."""
    printed = np.array([where.joints_deg for where in known.readings]).mean(axis=0)
    ours = Dialect(
        joint_signs=found.convention.signs,  # type: ignore[arg-type]
        joint_3_against_horizon=found.convention.against_horizon,
    ).our_angles_deg(tuple(printed))
    middle = np.degrees(PUMA560.limits_rad).mean(axis=1)
    turns = np.round((middle - np.array(ours) - np.array(found.zeros_deg)) / 360.0)
    return [round(float(zero), 3) for zero in np.array(found.zeros_deg) + 360.0 * turns]


def arm_file(known: Acquaintance, arm: Arm | None) -> dict[str, Any]:
    """arm.yaml: the dialect, and the geometry where readings showed one; each value with how it was found, how sure."""
    dialect = {name: _entry(known.findings[name]) for name in known.dialect()}
    made: dict[str, Any] = {"version": 1, "dialect": dialect}
    if arm is not None:
        found = arm.found
        dialect |= {
            "joint_signs": _value(list(found.convention.signs), FITTED, "certain"),
            "joint_zeros_deg": _value(_zeros_deg(found, known), FITTED, _sure(found, "zero_2")),
            "joint_3_against_horizon": _value(found.convention.against_horizon, FITTED, "certain"),
        }
        base = np.eye(4)
        base[:3, 3] = found.base_mm
        made["geometry"] = {
            **{
                f"{name}_mm": _value(round(value, 3), arm.how, _length_sure(arm, name))
                for name, value in zip(LENGTHS, found.lengths_mm, strict=True)
            },
            "world_from_base": _value(
                _rows(base), "where axes 1 and 2 cross; BASE's turn is in joint 1's zero", _sure(found, "base_x")
            ),
            "controller_flange": _value(
                _rows(found.wrist_from_tool), "WHERE's place from the wrist centre; TOOL must have been nothing",
                _sure(found, "tool_z"),
            ),
        }  # fmt: skip
    return made


def _sure(found: ArmFound, name: str) -> str:
    return "open" if name in found.undetermined else f"+-{max(2 * found.sigma[name], LEAST_TOLD):.2g}"


def _length_sure(arm: Arm, name: str) -> str:
    return arm.source or _sure(arm.found, name)


def _entry(finding: ProbeFinding) -> dict[str, Any]:
    return _value(finding.value, finding.found, finding.sure)


def _value(value: Any, found: str, sure: str) -> dict[str, Any]:
    return {"value": value, "found": found, "sure": sure}


def _rows(matrix: Array) -> list[list[float]]:
    return [[round(float(value), 9) for value in row] for row in matrix]


def page(known: Acquaintance, arm: Arm | None) -> str:
    """What was seen, for a person."""
    lines = ["What the controller showed", ""]
    lines += [f"  {f.name:<20} {f.value!r:<24} {f.sure}: {f.found}" for f in known.findings.values()]
    if arm is not None:
        lines += ["", "Which arm it is", "", *_about(arm)]
    lines += ["", "What nobody can find out from here", "",
              "  the joints' limits (type them from the plate, counted as WHERE does: arm.yaml, geometry.limits_deg)",
              "  whether the arm was calibrated rightly: it counts from where CAL left it",
              "  where joint 6 ends and the tool begins: TOOL's turn about the flange is in joint 6's zero",
              "  how high the shoulder stands, and what is in reach"]  # fmt: skip
    return "\n".join(lines) + "\n"


def _about(arm: Arm) -> Iterator[str]:
    found, alike = arm.found, arm.alike
    if alike is None:
        yield "  none that is published here: its own lengths are used"
        if max(found.sigma[name] for name in LENGTHS) > TOO_LOOSE_MM:
            yield "  Small steps leave them too loose: a WHERE elsewhere will not fit, and is taken for spoilt."
            yield "  Say it again with --pendant, or with --lengths A2,A3,D3,D4, in mm, from the maker's drawing."
    else:
        side = {None: "the shoulder's side is a matter of where its front is", True: "shoulder offset to the left",
                False: "shoulder offset to the right"}[alike.mirrored]  # fmt: skip
        yield f"  {alike.arm.name}, {side}"
    if arm.others:
        yield f"  it could as well be: {', '.join(arm.others)}; say it again with --pendant: six places would tell"
    for name, value in zip(LENGTHS, found.lengths_mm, strict=True):
        yield f"  {name} {value:9.2f} mm  {_length_sure(arm, name)}"
    signs = " ".join("+" if sign > 0 else "-" for sign in found.convention.signs)
    zeros = " ".join(f"{zero:.6g}" for zero in np.round(found.zeros_deg, 2) + 0.0)
    yield f"  joints 1 to 6: signs {signs}, zeros {zeros} degrees"
    if found.convention.against_horizon:
        yield "  joint 3 is counted against the horizon"
    yield f"  misfit {found.place_mm:.3f} mm, {found.turn_deg:.4f} degrees; {arm.how}"
    if found.undetermined:
        yield f"  left open by the readings: {', '.join(found.undetermined)}"
