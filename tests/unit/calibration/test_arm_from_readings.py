"""Which arm makes these WHEREs: conventions, lengths, base and tool, against arms whose truth is known."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.arm_from_readings import MIN_READINGS, ArmEstimate, NoArmError, find_arm, poses, refine_arm
from daemon.calibration.arm_hypotheses import NAMES
from drivers.puma560 import ArmGeometry, forward
from drivers.pumas import PUBLISHED, likeness
from drivers.val2.location import Location, location_from_matrix, matrix_from_location
from tests.fakes.chosen import few

LOW, HIGH = np.array([-160, -20, -225, -170, -100, -170.0]), np.array([160, 200, 45, 170, 100, 170.0])


@dataclass(frozen=True, eq=False)
class Truth:
    """An arm and how its controller counts."""

    geometry: ArmGeometry
    signs: Array
    zeros_deg: Array
    against_horizon: bool = False

    def printed_deg(self, joints_deg: Array) -> Array:
        """What WHERE prints of our angles (N, 6)."""
        printed = (joints_deg - self.zeros_deg) * self.signs
        if self.against_horizon:
            printed[:, 2] += self.signs[2] * self.signs[1] * printed[:, 1]
        return np.round(printed, 3)

    def places(self, joints_deg: Array) -> Array:
        """And the places, with WHERE's digits."""
        exact = [location_from_matrix(forward(np.radians(q), self.geometry)).values() for q in joints_deg]
        return np.array([matrix_from_location(Location(*np.round(v[:3], 2), *np.round(v[3:], 3))) for v in exact])


def geometry(lengths: Sequence[float], rng: np.random.Generator, tilted: bool) -> ArmGeometry:
    turn = frames.rotation_from_vector(rng.normal(size=3) * 0.4) if tilted else np.eye(3)
    tool = frames.rigid(turn, np.array([0.0, 0.0, 130.0]) + tilted * rng.uniform(-60, 60, 3))
    base = frames.rigid(frames.rotation_from_vector(np.array([0, 0, rng.uniform(-3, 3)])), rng.uniform(-500, 500, 3))
    a2, a3, d3, d4 = lengths
    return ArmGeometry(a2, a3, d3, d4, world_from_base=base, flange_from_tool=tool)


def read(truth: Truth, joints_deg: Array) -> tuple[ArmEstimate, Array, Array]:
    places, printed = truth.places(joints_deg), truth.printed_deg(joints_deg)
    return find_arm(places, printed), places, printed


@pytest.mark.parametrize(
    ("lengths", "name", "mirrored"),
    few(
        [
            ((431.8, 20.3, 150.05, 431.8), "560", False),
            ((431.8, 20.32, -149.09, 433.07), "560", True),
            ((203.2, 0.0, 127.0, 203.2), "260", None),
            ((650.0, 0.0, 190.0, 600.0), "762", None),
        ],
        3,
    ),
)
def test_twelve_readings_of_an_arm_with_any_convention_name_it_and_give_its_lengths_to_a_tenth_of_a_millimetre(
    lengths: tuple[float, ...], name: str, mirrored: bool | None
) -> None:
    rng = np.random.default_rng(len(name) + round(sum(lengths)))
    truth = Truth(
        geometry(lengths, rng, tilted=mirrored is None),
        rng.choice([-1.0, 1.0], 6),
        rng.choice([-180.0, -90.0, 0.0, 90.0], 6) if mirrored else rng.uniform(-180, 180, 6),
        against_horizon=bool(mirrored),
    )
    found, places, printed = read(truth, rng.uniform(LOW, HIGH, (12, 6)))
    seen = np.abs(found.lengths_mm)
    np.testing.assert_allclose(seen, np.abs(lengths), atol=0.1)
    assert (max(found.sigma[length] for length in ("a2", "a3", "d3", "d4"))) < 0.1
    assert found.convention.against_horizon is truth.against_horizon
    assert found.undetermined == ()
    assert found.place_mm < 0.03
    assert np.abs(poses(found, printed) - places).max() < 0.1
    elsewhere = rng.uniform(LOW, HIGH, (20, 6))
    assert np.abs(poses(found, truth.printed_deg(elsewhere)) - truth.places(elsewhere)).max() < 0.1
    sigma: Any = tuple(found.sigma[length] for length in ("a2", "a3", "d3", "d4"))
    alike = likeness(found.lengths_mm, sigma)
    assert alike is not None
    assert name in alike.arm.name
    assert alike.unit_mm == 1.0
    assert alike.mirrored is mirrored


def walk(start_deg: list[float], step_deg: float, rounds: int) -> Array:
    """One joint at a time, a small step each."""
    steps = [np.where(np.arange(6) == k % 6, step_deg, 0.0) for k in range(6 * rounds)]
    return np.array(start_deg) + np.concatenate([np.zeros((1, 6)), np.cumsum(steps, axis=0)])


def test_steps_of_two_degrees_show_the_convention_and_how_little_they_show_of_the_lengths() -> None:
    truth = Truth(ArmGeometry(), np.array([1.0, -1, -1, 1, -1, 1]), np.array([0.0, 0, -180, 0, 0, 0]))
    found, places, printed = read(truth, walk([10.0, 60, -160, 20, -40, 30], 2.0, 2))
    np.testing.assert_allclose(found.lengths_mm, (431.8, 20.3, 150.05, 431.8), atol=2.5)
    assert 0.1 < found.sigma["a2"] < 2.0
    assert found.convention.signs == (1.0, -1.0, -1.0, 1.0, -1.0, 1.0)
    settled = refine_arm(found, places, printed, PUBLISHED[0].lengths_mm)
    far = np.random.default_rng(1).uniform(LOW, HIGH, (20, 6))
    assert np.abs(poses(settled, truth.printed_deg(far))[:, :3, 3] - truth.places(far)[:, :3, 3]).max() < 0.5


def test_what_the_readings_leave_open_is_named() -> None:
    truth = Truth(ArmGeometry(), np.ones(6), np.zeros(6))
    still = walk([10.0, 60, -160, 20, -40, 30], 4.0, 3)
    still[:, 1:3] = still[0, 1:3]
    found, *_ = read(truth, still)
    assert {"a2", "d4"} <= set(found.undetermined)


def test_the_misfit_is_that_of_its_poses_and_what_exceeds_the_rounding_widens_the_standard_deviations() -> None:
    rng = np.random.default_rng(2)
    truth = Truth(ArmGeometry(), np.ones(6), np.zeros(6))
    joints = rng.uniform(LOW, HIGH, (MIN_READINGS + 2, 6))
    printed, exact = truth.printed_deg(joints), truth.places(joints)
    errors = np.hstack([rng.normal(0.0, 0.16, (len(joints), 3)), rng.normal(0.0, 1.6e-4, (len(joints), 3))])
    one, other = (
        find_arm(np.array([frames.perturb(*each) for each in zip(exact, k * errors, strict=True)]), printed)
        for k in (0.0, 1.0)
    )
    off = [
        frames.difference(frames.perturb(a, e), b) for a, e, b in zip(exact, errors, poses(other, printed), strict=True)
    ]
    mm2, rad2 = (float(np.sum(np.square(part))) for part in np.hsplit(np.array(off), 2))
    assert other.place_mm**2 == pytest.approx(mm2 / len(joints), rel=1e-3)
    assert np.radians(other.turn_deg) ** 2 == pytest.approx(rad2 / len(joints), rel=1e-3)
    assert other.misfit == pytest.approx(mm2 / 0.02**2 + rad2 / 2e-5**2, rel=1e-3)
    assert one.misfit < 6 * len(joints) - len(NAMES)
    half = find_arm(np.array([frames.perturb(*each) for each in zip(exact, 0.5 * errors, strict=True)]), printed)
    sigmas = [np.array(list(found.sigma.values())) for found in (one, other, half)]
    np.testing.assert_allclose(sigmas[2] / sigmas[1], 0.5, rtol=0.02)
    assert (sigmas[1] > 8.0 * sigmas[0]).all()


def test_the_truth_lies_within_the_standard_deviations_of_rounded_readings() -> None:
    """Neither too narrow nor too wide: rounding of places and of joints, each with the noise that it leaves."""
    squares = []
    for seed in range(3):
        rng = np.random.default_rng([seed, 7])
        shape = geometry((431.8, 20.3, 150.05, 431.8), rng, tilted=False)
        truth = Truth(shape, rng.choice([-1.0, 1.0], 6), rng.uniform(-180, 180, 6))
        found, *_ = read(truth, rng.uniform(LOW, HIGH, (12, 6)))
        errors = np.append(
            np.abs(found.lengths_mm) - np.abs(shape.lengths_mm), found.base_mm - shape.world_from_base[:3, 3]
        )
        names = ("a2", "a3", "d3", "d4", "base_x", "base_y", "base_z")
        squares += list((errors / [found.sigma[name] for name in names]) ** 2)
    assert 0.5 < np.sqrt(np.mean(squares)) < 1.5


def test_an_arm_of_another_kind_is_none() -> None:
    rng = np.random.default_rng(3)
    truth = Truth(ArmGeometry(), np.ones(6), np.zeros(6))
    joints = rng.uniform(LOW, HIGH, (12, 6))
    places = truth.places(joints)
    places[:, :3, 3] += 30.0 * np.sin(np.radians(joints[:, :3]) * 3.0)
    with pytest.raises(NoArmError, match="misses their positions by"):
        find_arm(places, truth.printed_deg(joints))


def test_too_few_readings_are_refused() -> None:
    with pytest.raises(NoArmError, match=f"{MIN_READINGS - 1} readings: at least {MIN_READINGS}"):
        find_arm(np.tile(np.eye(4), (MIN_READINGS - 1, 1, 1)), np.zeros((MIN_READINGS - 1, 6)))


def test_an_arm_without_an_elbow_offset_is_described_from_its_front() -> None:
    """From behind it fits the readings as well, with joints 2 and 3 the other way and outside of their ranges."""
    truth = Truth(ArmGeometry(203.2, 0.0, 127.0, 203.2), np.ones(6), np.zeros(6))
    found, *_ = read(truth, np.random.default_rng(3).uniform(LOW, HIGH, (10, 6)))
    assert found.convention.signs == (1.0,) * 6
    np.testing.assert_allclose(found.zeros_deg, 0.0, atol=0.1)
    np.testing.assert_allclose(found.lengths_mm, (203.2, 0.0, 127.0, 203.2), atol=0.1)


def test_a_260_that_counts_in_inches_is_known_by_its_proportions() -> None:
    alike = likeness((8.0, 0.0, -5.0, 8.0), (0.001,) * 4)
    assert alike is not None
    assert "260" in alike.arm.name
    assert alike.unit_mm == 25.4


def test_lengths_like_nobody_s_are_nobody_s() -> None:
    assert likeness((500.0, 10.0, 100.0, 480.0), (0.01,) * 4) is None


@pytest.mark.parametrize("turned_deg", few([90.0, 0.02, 0.0], 2))
def test_a_tool_that_is_square_on_the_flange_is_refined_to_be_just_that_and_another_is_left(turned_deg: float) -> None:
    rng = np.random.default_rng(5)
    square = geometry((431.8, 20.3, 150.05, 431.8), rng, tilted=False)
    tool = square.flange_from_tool @ frames.rigid(
        frames.rotation_from_vector(np.radians([0.0, turned_deg if turned_deg % 90 else 0.0, 0.0])), np.zeros(3)
    )
    truth = Truth(replace(square, flange_from_tool=tool), np.ones(6), np.zeros(6) - [0, 0, 0, 0, 0, turned_deg])
    found, places, printed = read(truth, rng.uniform(LOW, HIGH, (20, 6)))
    better = refine_arm(found, places, printed, (431.8, 20.3, 150.05, 431.8))
    tilted = np.degrees(np.arccos(np.clip(better.wrist_from_tool[2, 2], -1.0, 1.0)))
    assert tilted == pytest.approx(turned_deg % 90, abs=0.003 if turned_deg % 90 else 1e-6)
