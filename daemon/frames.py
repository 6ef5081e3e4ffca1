"""Rigid transforms, and how uncertainty moves through them. Pure: arrays in, arrays out; no clock, no file.

`b_from_a` is the 4x4 matrix that takes coordinates in a to coordinates in b. Lengths in mm, angles in radians.
A pose covariance is 6x6, ordered (translation x y z mm, rotation x y z rad), and describes a small motion of the pose
written in the *target* frame b: b_from_a_true = exp([t, r]) @ b_from_a, with the rotation taken about the origin of a
(so that the translation block is the uncertainty of where a's origin lies).
"""

import numpy as np

from daemon.arrays import Array


def rigid(rotation: Array, translation_mm: Array) -> Array:
    """Build transforms (..., 4, 4) from rotations (..., 3, 3) and translations (..., 3) in mm."""
    b_from_a = np.zeros((*np.shape(rotation)[:-2], 4, 4))
    b_from_a[..., :3, :3], b_from_a[..., :3, 3], b_from_a[..., 3, 3] = rotation, translation_mm, 1.0
    return b_from_a


def inverse(b_from_a: Array) -> Array:
    """The transforms a_from_b of rigid (..., 4, 4) b_from_a."""
    rotation_t = np.swapaxes(b_from_a[..., :3, :3], -1, -2)
    return rigid(rotation_t, -(rotation_t @ b_from_a[..., :3, 3:])[..., 0])


def apply(b_from_a: Array, points: Array) -> Array:
    """Take (..., 3) points in a, mm, to b."""
    return points @ b_from_a[:3, :3].T + b_from_a[:3, 3]


def cross_matrices(vectors: Array) -> Array:
    """(..., 3) -> (..., 3, 3) with matrix @ x = vector x x."""
    out = np.zeros((*vectors.shape, 3))
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def rotation_from_vector(vector: Array) -> Array:
    """(3,) axis times angle in rad -> (3, 3) rotation (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    cross = cross_matrices(np.asarray(vector, float))
    first, second = (1.0, 0.5) if angle < 1e-8 else (np.sin(angle) / angle, (1 - np.cos(angle)) / angle**2)
    rotation: Array = np.eye(3) + first * cross + second * (cross @ cross)
    return rotation


def rotations_from_vectors(vectors: Array) -> Array:
    """The same of many: (N, 3) rad -> (N, 3, 3)."""
    angle = np.sqrt((vectors**2).sum(1))[:, None, None]
    cross = cross_matrices(vectors)
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 1.0, np.sin(safe) / safe)
    second = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    rotations: Array = np.eye(3) + first * cross + second * (cross @ cross)
    return rotations


def vector_from_rotation(rotation: Array) -> Array:
    """(3, 3) rotation -> (3,) axis times angle in rad, angle in [0, pi]."""
    skew = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine, cosine = float(np.linalg.norm(skew)), (float(np.trace(rotation)) - 1) / 2
    angle = float(np.arctan2(sine, cosine))
    if sine > 1e-7:
        return skew * (angle / sine)
    if cosine > 0:
        return skew
    # Half a turn: the axis is the eigenvector of R to eigenvalue 1, read off (R + I) / 2 = a a^T.
    outer = (rotation + np.eye(3)) / 2
    k = int(np.argmax(np.diag(outer)))
    axis: Array = outer[:, k] / np.sqrt(outer[k, k])
    return axis * angle


def nearest_rotation(matrices: Array) -> Array:
    """The rotation R nearest to each of (..., 3, 3): proper, and with the largest trace of R^T matrix.

    Of the sum of b a^T over matched vectors it is the turn that takes the a nearest to the b. Source: Kabsch, A
    solution for the best rotation to relate two sets of vectors, Acta Crystallographica A32, 1976.
    """
    u, _, vt = np.linalg.svd(matrices)
    u[np.linalg.det(u @ vt) < 0, :, 2] *= -1.0
    nearest: Array = u @ vt
    return nearest


def not_a_rotation(matrix: Array, within: float) -> str | None:
    """Why a finite (3, 3) is no rotation, each of R R^T to `within`: how far off it is, or that it mirrors."""
    with np.errstate(over="ignore", invalid="ignore"):
        off = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
    if not off <= within:
        return f"one off by {off:.2g}"
    return "a mirrored one" if np.linalg.det(matrix) < 0 else None


def not_rigid(matrix: Array) -> str | None:
    """Why what a file gives for a rigid transform is none, in a line for who wrote it: a rotation to 1e-4 is one."""
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        return "expected 4x4 finite numbers, found others: write four rows of four"
    wrong = not_a_rotation(matrix[:3, :3], 1e-4)
    if wrong is not None:
        return f"expected a rotation in the 3x3 block, found {wrong}: write all digits, each axis a column"
    if not np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0]):
        return f"expected a last row [0, 0, 0, 1], found {matrix[3].tolist()}: write the translation as last column"
    return None


def angle_between(a: Array, b: Array) -> float:
    """Angle in rad of the rotation that takes orientation a (3, 3 or 4, 4) to b."""
    return float(np.linalg.norm(vector_from_rotation(a[:3, :3].T @ b[:3, :3])))


def turn_about(axis: Array, rotation: Array) -> float:
    """The angle in rad of the turn about a unit axis (3,) that is nearest to a rotation (3, 3)."""
    turned = rotation - rotation.T
    sine = axis @ [turned[2, 1], turned[0, 2], turned[1, 0]]
    return float(np.arctan2(sine, np.trace(rotation) - axis @ rotation @ axis))


def rms_deg(covariance: Array) -> float:
    """Rms angle, degrees, of a rotation vector with a covariance (N, N), rad^2, over its axes together."""
    return float(np.degrees(np.sqrt(np.trace(covariance))))


def transport_covariance(c_from_b: Array, covariance_in_b: Array) -> Array:
    """Covariance (6, 6) of b_from_a -> that of c_from_a = c_from_b @ b_from_a, c_from_b exact.

    The perturbation is about a's origin, so both blocks only turn.
    """
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = c_from_b[:3, :3]
    return turn @ covariance_in_b @ turn.T


def with_known_turn(covariance: Array, axis: Array) -> Array:
    """Covariance (6, 6) of a pose of which the turn about a unit axis (3,) through somewhere on the body is known, or
    does not matter: what goes with that turn does not count either."""
    by_turn = covariance[:, 3:] @ axis
    return np.asarray(covariance - np.outer(by_turn, by_turn) / (axis @ by_turn[3:]))


def lever_covariance(b_from_a: Array, covariance_of_c_from_b: Array, c_from_b: Array) -> Array:
    """What an uncertain c_from_b (6, 6; see module) adds to the covariance of c_from_a = c_from_b @ b_from_a."""
    jacobian = np.eye(6)
    jacobian[:3, 3:] = -cross_matrices(c_from_b[:3, :3] @ b_from_a[:3, 3])
    return jacobian @ covariance_of_c_from_b @ jacobian.T


def point_motion(levers: Array) -> Array:
    """(..., 3) levers from a's origin, along b's axes -> (..., 3, 6) motion of each point with a pose's (6,) motion."""
    rows = np.zeros((*levers.shape, 6))
    rows[..., :3] = np.eye(3)
    rows[..., 3:] = -cross_matrices(levers)
    return rows


def perturb(b_from_a: Array, motion: Array) -> Array:
    """Move b_from_a by a small (6,) motion as the module's covariance convention has it."""
    return rigid(rotation_from_vector(motion[3:]) @ b_from_a[:3, :3], b_from_a[:3, 3] + motion[:3])


def difference(b_from_a: Array, reference: Array) -> Array:
    """The (6,) motion with perturb(reference, motion) == b_from_a."""
    rotation = b_from_a[:3, :3] @ reference[:3, :3].T
    return np.concatenate([b_from_a[:3, 3] - reference[:3, 3], vector_from_rotation(rotation)])


def size(motion: Array) -> tuple[float, float]:
    """How far a (6,) motion goes, mm, and by how much it turns, rad."""
    return float(np.linalg.norm(motion[:3])), float(np.linalg.norm(motion[3:]))


def fuse(poses: list[Array], covariances: list[Array]) -> tuple[Array, Array]:
    """The least-squares mean (4, 4) of poses b_from_a with covariances (6, 6), and its covariance.

    Raises ValueError on an empty list. Source: Gauss-Newton on the information-weighted motions.
    """
    if not poses:
        raise ValueError("no poses to fuse")
    information = [np.linalg.inv(c) for c in covariances]
    total = np.linalg.inv(np.sum(information, axis=0))
    mean = poses[0]
    for _ in range(5):
        step = total @ np.sum([w @ difference(p, mean) for w, p in zip(information, poses, strict=True)], axis=0)
        mean = perturb(mean, step)
        if np.linalg.norm(step) < 1e-9:
            break
    return mean, total
