"""Identify an arm's kinematics from readings of pose and joints: joint conventions, lengths, base, tool. Pure.

A controller's kinematics link its poses and its joint angles, however it counts these. A dozen readings far enough
apart determine one PUMA-like geometry (three joints, the second and third parallel, and a spherical wrist), or none.
Nothing is assumed about signs, zeros or lengths.

The angle of our kinematics (the standard Denavit-Hartenberg table in drivers/puma560.py) is sign times the reported
one, plus zero; where joint 3 is counted against the horizon, the angle of joint 2 is subtracted from it. Several
parameter sets describe the same geometry (such as a forearm that points backward and is counted the other way round);
`_canonical` chooses one.

    parameters                             method
    signs of 1 and 2, joint 3's convention a grid, with the remaining rotations solved in closed form (signs of 3 to 6
    zeros of 2 + 3, 4 and 5                are a choice of description), then least squares on orientations alone
    lengths, zero of 2, base, tool         linear, given the orientations
    all of them, with covariance           Levenberg-Marquardt on positions and orientations together
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.arm_hypotheses import NAMES, Convention, about_y, about_z, arm_angles, flange_turns, tool_places
from daemon.calibration.least_squares import Problem, minimise
from daemon.errors import FacetdError

MIN_READINGS = 7
DIGITS = (0.01, 0.001)
"""The last decimal of WHERE, mm and degrees."""
ROUNDING = 0.5 / np.sqrt(12.0)
"""Least misfit that counts for a standard deviation, in units of the rounding error: that of rounding the place alone
(a decimal over the square root of 12; the unit is two decimals)."""
GRID_RAD = np.radians(np.arange(0.0, 360.0, 45.0))
STARTS, PASSES = (6, 60), 20
"""Grid members refined for each convention until one fits, then more where none did; passes of each refinement."""
PRIOR_MM, PRIOR_RAD = 1000.0, np.pi
"""Standard deviation of the prior; a parameter with more than a hundredth of it is undetermined."""
FITS = 5.0
"""Largest misfit of a fit, in units of the rounding error."""
RANGE_MIDDLE_RAD, RANGE_HALF_RAD = np.radians([0.0, 90.0, -90.0]), np.radians([160.0, 110.0, 135.0])
"""Ranges of joints 1 to 3 of a PUMA, in our angles: the 560's data sheet; other types differ by some degrees."""
SIGNIFICANT_MM = 1.0
"""A length between axes that is significantly more than this is not zero."""
CONVENTIONS = tuple(
    Convention((one, two, 1.0, 1.0, 1.0, 1.0), against)
    for one, two, against in product((1.0, -1.0), (1.0, -1.0), (False, True))
)
"""The conventions that describe different geometries."""
LENGTHS = ("a2", "a3", "d3", "d4")
ANGLES = 5
ANGLE_LIKE = np.array(["zero" in name or "turn" in name for name in NAMES])
TURN_ONLY = np.array([0, 2, 3, 4, 9, 10, 11])
"""The parameters that determine the orientations."""
NOTHING_FIXED: Mapping[int, float] = {}
WITHIN_SIGMAS = 4.0
"""A found parameter within so many standard deviations of a nominal value is taken as that value."""


class NoArmError(FacetdError):
    """The readings are too few, or fit no PUMA-like arm."""


@dataclass(frozen=True, eq=False)
class ArmEstimate:
    """The arm identified from readings.

    zeros_deg (6,), within +-180. a2_mm, a3_mm, d3_mm, d4_mm: as in the Denavit-Hartenberg table; a3 is not negative
    where it is significant, and then d3 is positive where the shoulder's offset is to the right of an arm that reaches
    forward. base_mm (3,): intersection of axes 1 and 2 in the world; wrist_from_tool (4, 4). sigma: standard deviation
    of each of NAMES (mm, degrees). undetermined: names of the parameters that the readings do not determine. place_mm,
    turn_deg: rms misfit; misfit: sum of squares in units of the rounding error.
    """

    convention: Convention
    zeros_deg: tuple[float, ...]
    a2_mm: float
    a3_mm: float
    d3_mm: float
    d4_mm: float
    base_mm: tuple[float, ...]
    wrist_from_tool: Array
    sigma: dict[str, float]
    undetermined: tuple[str, ...]
    place_mm: float
    turn_deg: float
    misfit: float

    @property
    def lengths_mm(self) -> tuple[float, float, float, float]:
        return self.a2_mm, self.a3_mm, self.d3_mm, self.d4_mm


@dataclass(frozen=True, eq=False)
class _Readings:
    """turns (N, 3, 3), places (N, 3) mm, printed (N, 6) rad; place_mm, turn_rad: rounding errors, those of the joints
    at a metre's distance included."""

    turns: Array
    places: Array
    printed: Array
    place_mm: float
    turn_rad: float

    def __len__(self) -> int:
        return len(self.turns)


def _read(world_from_tool: Array, printed_deg: Array, digits: tuple[float, float]) -> _Readings:
    mm, degrees = digits
    return _Readings(
        world_from_tool[:, :3, :3],
        world_from_tool[:, :3, 3],
        np.radians(printed_deg),
        max(2.0 * mm, 20.0 * degrees),
        0.02 * degrees,
    )


@dataclass(frozen=True, eq=False)
class _Model:
    """A convention, its (18,) parameters in the order of NAMES, rad and mm, and their cost."""

    convention: Convention
    parameters: Array
    cost: float
    residuals: Array
    jacobian: Array


def find_arm(world_from_tool: Array, printed_deg: Array, digits: tuple[float, float] = DIGITS) -> ArmEstimate:
    """Identify the arm from (N, 4, 4) poses, mm, and (N, 6) joint angles as reported, degrees; digits: last decimal of
    each. Joint 1 turns about the world's z: VAL's BASE has no other rotation, and joint 1's zero contains it. Raises
    NoArmError.
    """
    if len(world_from_tool) < MIN_READINGS:
        raise NoArmError(f"{len(world_from_tool)} readings: at least {MIN_READINGS} are needed, better a dozen")
    readings = _read(world_from_tool, printed_deg, digits)
    best: list[_Model] = []
    for start_count in STARTS:
        if not best:
            fits = (_fit_convention(convention, start_count, readings) for convention in CONVENTIONS)
            best = sorted((model for model in fits if model is not None), key=lambda model: model.cost)
    if not best:
        raise NoArmError("no arm with a PUMA's wrist fits these readings: their orientations fit no such joints")
    estimate = _canonical(best[0], readings)
    data = estimate.residuals[: 12 * len(readings)]
    if float(np.sqrt(np.mean(data**2))) > FITS:
        raise NoArmError(
            f"no PUMA-like arm fits these readings: the nearest misses their positions by "
            f"{_rms(data[9 * len(readings) :]) * readings.place_mm:.2f} mm"
        )
    return _arm_found(estimate, readings)


def refine_arm(
    estimate: ArmEstimate,
    world_from_tool: Array,
    printed_deg: Array,
    lengths_mm: Sequence[float],
    digits: tuple[float, float] = DIGITS,
) -> ArmEstimate:
    """Fit the same arm again with published lengths (a2, a3, d3, d4): zeros that are compatible with quarter turns, and
    a base and a flange that are compatible with the factory's, are set to these; the rest is fitted to the readings."""
    x = _parameters(estimate)
    fixed = {NAMES.index(name): value for name, value in zip(LENGTHS, lengths_mm, strict=True)}
    for k in range(ANGLES):
        quarter = np.radians(90.0 * round(float(np.degrees(x[k])) / 90.0))
        if abs(x[k] - quarter) <= np.radians(WITHIN_SIGMAS * estimate.sigma[NAMES[k]] + 1e-3):
            fixed[k] = float(quarter)
    fixed |= _nominal_parameters(x, estimate)
    x[list(fixed)] = list(fixed.values())
    readings = _read(world_from_tool, printed_deg, digits)
    return _arm_found(_fit_from(estimate.convention, x, readings, fixed), readings)


def _nominal_parameters(x: Array, estimate: ArmEstimate) -> dict[int, float]:
    """Parameters of tool and base that are compatible with none: base where axes 1 and 2 cross, flange square on axis
    6."""
    fixed: dict[int, float] = {}
    for together in ((12, 13), (15, 16, 17)):
        if all(abs(x[k]) <= WITHIN_SIGMAS * estimate.sigma[NAMES[k]] for k in together):
            fixed |= dict.fromkeys(together, 0.0)
    tool = frames.rotation_from_vector(x[9:12])
    quarter = np.pi / 2 * round(float(np.arctan2(tool[1, 0], tool[0, 0])) / (np.pi / 2))
    off_deg = np.degrees(np.linalg.norm(frames.vector_from_rotation(about_z(-quarter) @ tool)))
    if off_deg <= WITHIN_SIGMAS * max(estimate.sigma[name] for name in NAMES[9:12]) + 1e-3:
        fixed |= {9: 0.0, 10: 0.0, 11: quarter}
    return fixed


def _parameters(estimate: ArmEstimate) -> Array:
    """(18,) in the order of NAMES; the tool's rotation contains joint 6's zero."""
    zeros, tool = np.radians(estimate.zeros_deg), estimate.wrist_from_tool
    return np.concatenate([
        [zeros[0], zeros[1], zeros[1] + zeros[2], zeros[3], zeros[4]], estimate.lengths_mm,
        frames.vector_from_rotation(about_z(zeros[5]) @ tool[:3, :3]), about_z(zeros[5]) @ tool[:3, 3],
        estimate.base_mm,
    ])  # fmt: skip


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2) * 3))


def poses(estimate: ArmEstimate, printed_deg: Array) -> Array:
    """Tool poses (N, 4, 4) mm of the arm at (N, 6) reported angles, degrees."""
    turns, places = tool_places(_parameters(estimate)[None], estimate.convention, np.radians(printed_deg))
    made = np.tile(np.eye(4), (len(printed_deg), 1, 1))
    made[:, :3, :3], made[:, :3, 3] = turns[0], places[0]
    return made


# Start values


def _starts(convention: Convention, start_count: int, readings: _Readings) -> Iterator[Array]:
    """The best starts (8,) for the fit of orientations: the five zeros, then the tool's rotation."""
    grid = np.array(list(product(GRID_RAD, repeat=3)))
    zeros = np.column_stack([np.zeros((len(grid), 2)), grid])
    flange = flange_turns(arm_angles(zeros, convention, readings.printed))
    first, tools, misfit = _both_ends(flange, readings.turns)
    for k in np.argsort(misfit)[:start_count]:
        yield np.concatenate([[first[k]], zeros[k, 1:], frames.vector_from_rotation(tools[k])])


def _both_ends(flange: Array, turns: Array) -> tuple[Array, Array, Array]:
    """Return joint 1's zero (M,), the tool's rotation (M, 3, 3), and the misfit (M,) of (M, N, 3, 3) flange hypotheses.

    From turns[i] = Rz(z1) flange[i] tool follows turns[i] turns[j]^T = Rz(z1) flange[i] flange[j]^T Rz(-z1): the
    horizontal parts of the rotation axes give z1, and then the tool follows.
    """
    seen = _axes(turns @ np.roll(turns, 1, axis=0).swapaxes(-1, -2))
    made = _axes(flange @ np.roll(flange, 1, axis=1).swapaxes(-1, -2))
    across = (made[..., 0] * seen[:, 1] - made[..., 1] * seen[:, 0]).sum(-1)
    along = (made[..., 0] * seen[:, 0] + made[..., 1] * seen[:, 1]).sum(-1)
    first = np.arctan2(across, along)
    turned = about_z(first)[:, None] @ flange
    tools = frames.nearest_rotation(np.einsum("mnji,njk->mik", turned, turns))
    misfit = ((turned @ tools[:, None] - turns) ** 2).sum((1, 2, 3))
    return first, tools, misfit


def _axes(turns: Array) -> Array:
    """(..., 3): axis times twice the sine of the angle of (..., 3, 3)."""
    return np.stack(
        [turns[..., 2, 1] - turns[..., 1, 2], turns[..., 0, 2] - turns[..., 2, 0], turns[..., 1, 0] - turns[..., 0, 1]],
        -1,
    )


# Least squares


def _fit_convention(convention: Convention, start_count: int, readings: _Readings) -> _Model | None:
    """Fit one convention, or None: orientations first, then lengths linearly, then everything together."""
    turn_only = _problem(convention, readings, places=False)
    for start in _starts(convention, start_count, readings):
        x = np.concatenate([start[:5], np.zeros(4), start[5:], np.zeros(6)])
        x, residuals, _ = minimise(turn_only, x, PASSES)
        if _rms(residuals) < 10.0 * FITS:
            return _fit_from(convention, _lengths(x, convention, readings), readings, NOTHING_FIXED)
    return None


def _fit_from(convention: Convention, x: Array, readings: _Readings, fixed: Mapping[int, float]) -> _Model:
    """The least-squares fit of one convention from start x; known: fixed values by parameter."""
    x, residuals, jacobian = minimise(_problem(convention, readings, fixed), x)
    return _Model(convention, x, float(residuals @ residuals), residuals, jacobian)


def _problem(
    convention: Convention, readings: _Readings, fixed: Mapping[int, float] = NOTHING_FIXED, places: bool = True
) -> Problem:
    """Residuals in units of the rounding error: 9 a reading, then (with places) 3 a reading, then priors."""
    free = np.arange(18) if places else TURN_ONLY
    steps = np.where(ANGLE_LIKE, 1e-6, 1e-2)
    prior, middle = np.where(ANGLE_LIKE, PRIOR_RAD * 10.0, PRIOR_MM), np.zeros(18)
    for k, value in fixed.items():
        middle[k], prior[k] = value, steps[k] / 100.0
    moved = np.concatenate([np.zeros((1, 18)), np.diag(steps)[free], -np.diag(steps)[free]])

    def problem(x: Array) -> tuple[Array, Array]:
        made_turns, made_places = tool_places(x + moved, convention, readings.printed)
        parts = [(made_turns - readings.turns).reshape(len(moved), -1) / (readings.turn_rad * np.sqrt(2.0))]
        if places:
            parts.append((made_places - readings.places).reshape(len(moved), -1) / readings.place_mm)
        parts.append((x + moved - middle) / prior)
        rows = np.concatenate(parts, axis=1)
        jacobian = np.zeros((rows.shape[1], 18))
        jacobian[:, free] = ((rows[1 : 1 + len(free)] - rows[1 + len(free) :]) / (2.0 * steps[free, None])).T
        return rows[0], jacobian

    return problem


def _lengths(x: Array, convention: Convention, readings: _Readings) -> Array:
    """x with lengths, joint 2's zero, tool and base: linear in a2's two components, given the orientations."""
    q1, q2, q23, *_ = q = arm_angles(x[None, :5] * np.array([1, 0, 1, 1, 1]), convention, readings.printed)
    flange, c, s = flange_turns(q)[0], np.cos(q1[0]), np.sin(q1[0])

    def placed(outward: Array, upward: Array) -> Array:
        return np.stack([c * outward, s * outward, upward], -1)

    columns = [
        placed(np.cos(q2[0]), np.sin(q2[0])),
        placed(-np.sin(q2[0]), np.cos(q2[0])),
        placed(np.cos(q23[0]), np.sin(q23[0])),
        np.stack([s, -c, np.zeros_like(c)], -1),
        placed(-np.sin(q23[0]), np.cos(q23[0])),
        *(flange[:, :, k] for k in range(3)),
        *(np.tile(axis, (len(c), 1)) for axis in np.eye(3)),
    ]
    matrix = np.stack([column.ravel() for column in columns], -1)
    weighed = np.concatenate([matrix / readings.place_mm, np.eye(len(columns)) / PRIOR_MM])
    wanted = np.concatenate([readings.places.ravel() / readings.place_mm, np.zeros(len(columns))])
    solution = np.linalg.lstsq(weighed, wanted, rcond=None)[0]
    made = x.copy()
    made[1] = np.arctan2(solution[1], solution[0])
    made[5:9] = np.hypot(solution[0], solution[1]), *solution[2:5]
    made[12:18] = solution[5:11]
    return made


# The canonical description


def _canonical(model: _Model, readings: _Readings) -> _Model:
    """Choose our table's description among the equivalent ones of a geometry: a2 and d4 forward, a3 not negative (or,
    where it is zero, joint 1 counted from the front), the tool ahead of the wrist, joint 4 within a quarter turn."""
    x, signs = model.parameters.copy(), list(model.convention.signs)
    if x[8] < 0:  # the forearm is counted backward
        x[2], x[4] = x[2] + np.pi, x[4] - np.pi
        x[6], x[8] = -x[6], -x[8]
        signs[3], x[3] = -signs[3], -x[3]
    sigma = np.sqrt(np.diag(np.linalg.pinv(model.jacobian.T @ model.jacobian)))
    significant = abs(x[6]) > max(SIGNIFICANT_MM, 5.0 * sigma[6])
    behind_signs, behind = _from_behind(signs, x)
    if (
        (x[6] < 0)
        if significant
        else _out_of_range(behind, behind_signs, model, readings) < _out_of_range(x, signs, model, readings)
    ):
        signs, x = behind_signs, behind
    tool = frames.rotation_from_vector(x[9:12])
    if tool[2, 2] < 0:  # the gripper points out of the wrist's back
        half = about_y(np.pi)
        x[4], signs[5] = x[4] - np.pi, -signs[5]
        tool, x[12:15] = half @ tool, half @ x[12:15]
    convention = Convention(tuple(signs), model.convention.against_horizon)
    fourth = float(np.median(arm_angles(x[None, :5], convention, readings.printed)[3]))
    if abs(_wrapped(np.array(fourth))) > np.pi / 2 + 1e-6:  # the wrist is flipped
        half = about_z(np.pi)
        x[3], signs[4], x[4] = x[3] - np.pi, -signs[4], -x[4]
        tool, x[12:15] = half @ tool, half @ x[12:15]
    x[:5] = _wrapped(x[:5])
    x[9:12] = frames.vector_from_rotation(tool)
    return _fit_from(Convention(tuple(signs), model.convention.against_horizon), x, readings, NOTHING_FIXED)


def _from_behind(signs: list[float], x: Array) -> tuple[list[float], Array]:
    """Describe the same arm from behind: front and back exchanged."""
    turned = x.copy()
    turned[:4] = x[0] + np.pi, np.pi - x[1], -x[2], x[3] - np.pi
    turned[6:8] = -x[6:8]
    return [signs[0], -signs[1], -signs[2], *signs[3:]], turned


def _out_of_range(x: Array, signs: Sequence[float], model: _Model, readings: _Readings) -> tuple[float, bool]:
    """Return how far joints 1 to 3 are out of a PUMA's ranges at the readings; and whether joint 1's zero is behind."""
    convention = Convention(tuple(signs), model.convention.against_horizon)
    q1, q2, q23, *_ = (np.median(each) for each in arm_angles(x[None, :5], convention, readings.printed))
    angles = _wrapped(np.array([q1, q2, q23 - q2]) - RANGE_MIDDLE_RAD)
    out = np.maximum(np.abs(angles) / RANGE_HALF_RAD - 1.0, 0.0)
    return round(float(out.sum()), 3), bool(abs(_wrapped(x[0])) > np.pi / 2 + 1e-6)


def _wrapped(angle: Array) -> Array:
    """Angles wrapped to [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def _covariance(model: _Model, count: int) -> Array:
    """(18, 18): places and orientations each with the noise that their own residuals show, from `count` readings."""
    inverse = np.linalg.inv(model.jacobian.T @ model.jacobian)
    turns, places, priors = np.split(np.arange(len(model.residuals)), [9 * count, 12 * count])
    noise = model.jacobian[priors].T @ model.jacobian[priors]
    for rows in (turns, places):
        slope, squares = model.jacobian[rows], float(model.residuals[rows] @ model.residuals[rows])
        noise = noise + max(ROUNDING**2, squares / (3 * count - 9)) * (slope.T @ slope)
    return inverse @ noise @ inverse


def _arm_found(model: _Model, readings: _Readings) -> ArmEstimate:
    """Values and standard deviations; joint 6's zero takes the tool's rotation about its axis, which is equivalent."""
    count = len(readings)
    x, rows = model.parameters, 12 * count
    sigma = np.sqrt(np.diag(_covariance(model, count)))
    open_ones = sigma > np.where(ANGLE_LIKE, np.radians(1.0), PRIOR_MM / 100.0)
    tool = frames.rotation_from_vector(x[9:12])
    turn = frames.turn_about(np.array([0.0, 0.0, 1.0]), tool)
    wrist_from_tool = frames.rigid(about_z(-turn) @ tool, about_z(-turn) @ x[12:15])
    zeros = _wrapped(np.array([x[0], x[1], x[2] - x[1], x[3], x[4], turn]))
    sigmas = np.where(ANGLE_LIKE, np.degrees(sigma), sigma)
    return ArmEstimate(
        convention=model.convention,
        zeros_deg=tuple(float(z) for z in np.degrees(zeros)),
        a2_mm=float(x[5]), a3_mm=float(x[6]), d3_mm=float(x[7]), d4_mm=float(x[8]),
        base_mm=tuple(float(v) for v in x[15:18]),
        wrist_from_tool=wrist_from_tool,
        sigma={name: float(value) for name, value in zip(NAMES, sigmas, strict=True)},
        undetermined=tuple(name for name, is_open in zip(NAMES, open_ones, strict=True) if is_open),
        place_mm=_rms(model.residuals[9 * count : rows]) * readings.place_mm,
        turn_deg=float(np.degrees(_rms(model.residuals[: 9 * count]) * readings.turn_rad * np.sqrt(3.0))),
        misfit=float((model.residuals[:rows] ** 2).sum()),
    )  # fmt: skip
