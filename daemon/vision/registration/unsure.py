"""Poses that the two edges of a corner, or two eyes at all, can hardly tell from a guess: all edges of the part do.

In: guesses and the lines they turn about; a laid part. Out: better guesses; other poses to be laid. Where an edge is
short, or runs along the baseline, where it points in depth is anyone's: twenty degrees are usual. The left eye sees the
corner the same when the part turns about one line; how far, the part's other edges say in both eyes.
"""

from __future__ import annotations

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Baseline, Polyhedron
from daemon.vision.registration.different import Guesses, thinned
from daemon.vision.registration.directed import DirectedMap, evidence
from daemon.vision.registration.pose_step import turned
from daemon.vision.registration.posed import Posed

MOST_TURNED, TURNS = 100, np.radians([-24.0, -16.0, -8.0, 8.0, 16.0, 24.0])
"""Of the likeliest guesses, and by how much each is turned: what maps of segments and the pictures take for one pose
lies between two of them."""
WORTH_TURNING = 1.1
"""So many times the evidence for a guess as it is must speak for it turned."""
FARTHER_MM, TILT = 5.0, np.radians(7.0)
"""By how much a laid part is moved along the sight, and tilted against it."""


def best_turned(
    guesses: Guesses, hinges: Array, geometry: Baseline, maps: tuple[DirectedMap, DirectedMap]
) -> tuple[Guesses, Array]:
    """The likeliest of every bundle of guesses, each turned to where most speaks for it, and of how many tries each is
    the best: 1 for those that stay as they are. hinges (G, 2, 3): a point and the direction of the line that each turns
    about, cyclopean, no direction where there is none. What speaks against guesses is less the evidence of the maps."""
    few = thinned(guesses)
    few = few[np.argsort(guesses.against[few], kind="stable")[:MOST_TURNED]]
    posed, against = guesses.posed.chosen(few), guesses.against[few]
    point, cross = hinges[few, 0], frames.cross_matrices(hinges[few, 1])
    rotations = (np.eye(3) + np.sin(by) * cross + (1 - np.cos(by)) * cross @ cross for by in TURNS)  # Rodrigues
    poses = np.stack([posed.poses, *(turned(posed.poses, rotation, point) for rotation in rotations)])
    every = Posed(posed.solids, np.tile(posed.part, len(TURNS)), poses[1:].reshape(-1, 4, 4))
    nats, _ = evidence(every, geometry, maps)
    each = np.concatenate([against[None], -nats.reshape(len(TURNS), -1)])
    best = np.concatenate([WORTH_TURNING * against[None], each[1:]]).argmin(0), np.arange(len(few))
    found = Guesses(Posed(posed.solids, posed.part, poses[best]), each[best])
    kept = thinned(found)
    return found.chosen(kept), np.where(best[0] > 0, len(TURNS) + 1.0, 1.0)[kept]


def nearby(solid: Polyhedron, pose: Array) -> list[Array]:
    """Poses (4, 4) cyclopean_from_part beside one at which a solid is laid: nearer, farther, tilted either way."""
    middle = frames.apply(pose, solid.corners_mm).mean(0)
    ahead = middle / np.linalg.norm(middle)
    aside = np.cross([0.0, 1.0, 0.0], ahead)
    turns = [frames.rotation_from_vector(by * axis) for axis in (aside, np.cross(ahead, aside)) for by in (TILT, -TILT)]
    moves = [frames.rigid(turn, middle - turn @ middle) for turn in turns]
    return [
        move @ pose for move in (*moves, *(frames.rigid(np.eye(3), by * ahead) for by in (FARTHER_MM, -FARTHER_MM)))
    ]
