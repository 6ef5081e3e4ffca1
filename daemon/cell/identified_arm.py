"""Identify the arm from the findings of a first contact: compare it with published arms, write arm.yaml and a page.

In: the findings (drivers/val2/contact_findings.py). calibration/arm_from_readings.py fits the arm to the readings.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.arm_from_readings import LENGTHS, ArmEstimate, NoArmError, find_arm, refine_arm
from drivers.puma560 import PUMA560
from drivers.pumas import PUBLISHED, Likeness, PublishedArm, likeness
from drivers.val2.contact_findings import ContactFindings
from drivers.val2.dialect import SLOWEST_BAUD, Dialect
from drivers.val2.location import matrix_from_location

FITTED = "least squares over WHERE's places and joints"
UNCERTAIN_MM = 0.1
TOO_UNCERTAIN_MM = 0.3
"""Limits of the standard deviations, which are overestimated (a position counts as off by two of its last digits)."""
MISFIT_MORE = 2.4
"""Permitted increase of the misfit per reading: the steps are whole degrees, so that rounding of the joints is the same
in all readings and adds up, while free zeros absorb it."""
STRAIGHT_DEG, ALONE = 10.0, 0.1
"""Joints 4 and 6 turn about one axis where theirs are within this angle; a joint turns alone where no other turns by a
larger share."""
LEAST_SIGMA = 0.001
"""Least standard deviation reported, mm or degrees: no controller prints more finely."""


@dataclass(frozen=True, eq=False)
class Arm:
    """The identified arm, with a published arm's lengths where they fit. how: how the lengths were found; source:
    `published` or `typed` where the readings do not determine them."""

    found: ArmEstimate
    alike: Likeness | None
    others: tuple[str, ...]
    how: str
    source: str = ""


def arm_of(known: ContactFindings, typed_mm: tuple[float, float, float, float] | None = None) -> Arm:
    """Identify the arm from the readings and compare it with published ones. typed_mm: a2, a3, d3, d4 from its drawing
    where none is published. Raises NoArmError."""
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
    if max(sigma) < UNCERTAIN_MM or alike is None:
        return Arm(found, alike, (), FITTED)
    fits_by_arm = sorted(_fits_of_published(found, arms, places, printed, digits, sigma), key=lambda each: each[0])
    best = fits_by_arm[0]
    fits = best[0] <= found.misfit + MISFIT_MORE * len(printed)
    if not fits and typed_mm is not None:
        raise NoArmError(f"the lengths typed do not fit WHERE's places, which show {_lengths(found)}")
    if not fits:
        return Arm(found, None, (), f"{FITTED}; no published lengths fit them")
    others = tuple({each[1].name for each in fits_by_arm[1:] if each[0] < best[0] + 9.0} - {best[1].name})
    return Arm(
        best[2],
        replace(alike, arm=best[1]),
        others,
        f"the readings are so near together that the lengths are uncertain by {max(sigma):.1f} mm; they are those "
        + (f"published for the {best[1].name} ({best[1].source})" if typed_mm is None else "typed")
        + ", which fit",
        "published" if typed_mm is None else "typed",
    )


def _found(
    places: Array, printed: Array, digits: tuple[float, float], arms: Sequence[PublishedArm]
) -> tuple[ArmEstimate, Likeness | None, tuple[float, float, float, float]]:
    """The arm, the published one it is like, and the standard deviations of its lengths."""
    try:
        found = find_arm(places, printed, digits)
    except NoArmError as error:
        raise NoArmError(f"{error}{_straight(places, printed)}") from None
    sigma = found.sigma["a2"], found.sigma["a3"], found.sigma["d3"], found.sigma["d4"]
    return found, likeness(found.lengths_mm, sigma, arms), sigma


def _straight(places: Array, printed: Array) -> str:
    """Advice where the wrist was straight: joints 4 and 6, each turned alone, turned the tool about one axis."""
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
        "Bend joint 5 by 30 degrees or more with the pendant, and repeat the command"
    )


def _lengths(found: ArmEstimate) -> str:
    return ", ".join(
        f"{name} {value:.1f} mm {_sure(found, name)}" for name, value in zip(LENGTHS, found.lengths_mm, strict=True)
    )


def _fits_of_published(
    found: ArmEstimate,
    arms: Sequence[PublishedArm],
    places: Array,
    printed: Array,
    digits: tuple[float, float],
    sigma: Sequence[float],
) -> Iterator[tuple[float, Any, ArmEstimate]]:
    """For each published arm with similar lengths: its misfit, itself, and the fitted arm with its lengths."""
    for arm in arms:
        if likeness(found.lengths_mm, tuple(sigma), (arm,)) is None:  # type: ignore[arg-type]
            continue
        a2, a3, d3, d4 = arm.lengths_mm
        for elbow_mm in {a3, -a3}:
            lengths = a2, elbow_mm, float(np.copysign(d3, found.d3_mm)), d4
            made = refine_arm(found, places, printed, lengths, digits)
            yield made.misfit, arm, made


# Output: arm.yaml and a page


def _zeros_deg(found: ArmEstimate, known: ContactFindings) -> list[float]:
    """Zeros of the joints. Poses do not determine whole turns: these put the readings nearest to the middle of a PUMA's
    ranges."""
    printed = np.array([where.joints_deg for where in known.readings]).mean(axis=0)
    ours = Dialect(
        joint_signs=found.convention.signs,  # type: ignore[arg-type]
        joint_3_against_horizon=found.convention.against_horizon,
    ).our_angles_deg(tuple(printed))
    middle = np.degrees(PUMA560.limits_rad).mean(axis=1)
    turns = np.round((middle - np.array(ours) - np.array(found.zeros_deg)) / 360.0)
    return [round(float(zero), 3) for zero in np.array(found.zeros_deg) + 360.0 * turns]


def arm_file(known: ContactFindings, arm: Arm | None) -> dict[str, Any]:
    """The content of arm.yaml: dialect, and geometry where it was identified; each value with its source and
    certainty."""
    findings = {name: known.findings[name] for name in known.dialect()}
    dialect = {name: _value(finding.value, finding.found, finding.sure) for name, finding in findings.items()}
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


def _sure(found: ArmEstimate, name: str) -> str:
    return "open" if name in found.undetermined else f"+-{max(2 * found.sigma[name], LEAST_SIGMA):.2g}"


def _length_sure(arm: Arm, name: str) -> str:
    return arm.source or _sure(arm.found, name)


def _value(value: Any, found: str, sure: str) -> dict[str, Any]:
    return {"value": value, "found": found, "sure": sure}


def _rows(matrix: Array) -> list[list[float]]:
    return [[round(float(value), 9) for value in row] for row in matrix]


def page(known: ContactFindings, arm: Arm | None) -> str:
    """The findings as a page for people."""
    lines = ["Findings about the controller", ""]
    lines += [f"  {f.name:<20} {f.value!r:<24} {f.sure}: {f.found}" for f in known.findings.values()]
    if known.findings["baud"].value < SLOWEST_BAUD:
        lines += [
            "",
            f"  facetd refuses a line below {SLOWEST_BAUD} baud: it would confirm a stop too late.",
            "  Set the line of the controller's terminal, and arm.dialect.baud in facetd.yaml, to that or more.",
        ]
    if arm is not None:
        lines += ["", "The arm", "", *_about(arm)]
    lines += ["", "What the line cannot show", "",
              "  the joints' limits (type them from the plate, counted as WHERE does: arm.yaml, geometry.limits_deg)",
              "  whether the arm was calibrated correctly: its zeros are those that CAL found",
              "  the zero of joint 6 without TOOL: it contains TOOL's rotation about the flange",
              "  the height of the shoulder, and obstacles in reach"]  # fmt: skip
    return "\n".join(lines) + "\n"


def _about(arm: Arm) -> Iterator[str]:
    found, alike = arm.found, arm.alike
    if alike is None:
        yield "  not a published one: facetd uses the identified lengths"
        if max(found.sigma[name] for name in LENGTHS) > TOO_UNCERTAIN_MM:
            yield "  Small steps leave them too uncertain: readings elsewhere will not fit, and count as garbled."
            yield "  Repeat the command with --pendant, or with --lengths A2,A3,D3,D4, in mm, from the maker's drawing."
    else:
        side = {None: "the side of the shoulder depends on where its front is", True: "shoulder offset to the left",
                False: "shoulder offset to the right"}[alike.mirrored]  # fmt: skip
        yield f"  {alike.arm.name}, {side}"
    if arm.others:
        yield f"  it could also be: {', '.join(arm.others)}; repeat the command with --pendant: six poses decide"
    for name, value in zip(LENGTHS, found.lengths_mm, strict=True):
        yield f"  {name} {value:9.2f} mm  {_length_sure(arm, name)}"
    signs = " ".join("+" if sign > 0 else "-" for sign in found.convention.signs)
    zeros = " ".join(f"{zero:.6g}" for zero in np.round(found.zeros_deg, 2) + 0.0)
    yield f"  joints 1 to 6: signs {signs}, zeros {zeros} degrees"
    if found.convention.against_horizon:
        yield "  joint 3 is counted against the horizon"
    yield f"  misfit {found.place_mm:.3f} mm, {found.turn_deg:.4f} degrees; {arm.how}"
    if found.undetermined:
        yield f"  not determined by the readings: {', '.join(found.undetermined)}"
