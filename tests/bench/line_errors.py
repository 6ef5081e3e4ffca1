"""How far measured edges are off, as multiples of what their own fits say: LINE_SIGMAS and LINE_TAIL are made by this.

usage: python -m tests.bench.line_errors [--cases 200] [--first 0] [--step 2]

The edges of named parts of rendered looks, measured at their true poses. A row for each number of degrees of freedom of
Student's t: the scale that makes the errors likeliest, and how likely they are with it, nats an edge. The most likely
rows differ by little; of these the first that has a variance, 3, is taken.
"""

import argparse
import math

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry import SolidBatch
from daemon.vision.image import MODEL_PX, open_stereo
from daemon.vision.refine.expected_edges import LINE_SIGMAS, measure_edges, project_edges
from daemon.vision.settings import TOLERANCE_MM
from tests.bench.sigmas import looked
from tests.bench.simulated_looks import true_rig
from tests.fakes.photographed import cell

TAILS, SCALES = (2, 3, 4, 6, 10), np.arange(1.0, 4.05, 0.1)


def errors(seed: int) -> list[tuple[Array, Array]]:
    """(N, 2) px how far both ends of each edge are off, and (N, 2, 2) px^2 what its fit says, of each camera."""
    found = []
    for one in looked(seed, made_mm=0.0):
        cameras = open_stereo(one.photo.left, one.photo.right, true_rig(cell()))
        edges = project_edges(SolidBatch.of([one.solid]), cameras, one.true[None], np.ones(1, bool), TOLERANCE_MM)
        for seen in measure_edges(edges, cameras):
            if seen.sides is not None:
                use = seen.there & seen.edges.sharp
                said = (seen.line_doubt - MODEL_PX**2 * np.eye(2)) / LINE_SIGMAS**2
                found.append((seen.off[use], said[use]))
    return found


def likelihood(off: Array, said: Array, scale: float, tail: int) -> float:
    """Mean log density of the errors by Student's t."""
    covariance = scale**2 * said + MODEL_PX**2 * np.eye(2)
    chi2 = (np.linalg.solve(covariance, off[..., None])[..., 0] * off).sum(1)
    constant = math.lgamma(tail / 2 + 1) - math.lgamma(tail / 2) - math.log(tail * math.pi)
    log_density = constant - np.linalg.slogdet(covariance)[1] / 2 - (tail / 2 + 1) * np.log1p(chi2 / tail)
    return float(log_density.mean())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="0: tuned on; 1: held out")
    parser.add_argument("--step", type=int, default=2)
    args = parser.parse_args()
    every = [one for k in range(args.cases) for one in errors(args.first + args.step * k)]
    off, said = (np.concatenate(each) for each in zip(*every, strict=True))
    print(f"{len(off)} edges\n{'degrees of freedom':>18} {'scale':>6} {'nats an edge':>13}")
    for tail in TAILS:
        by_scale = [likelihood(off, said, scale, tail) for scale in SCALES]
        best = int(np.argmax(by_scale))
        print(f"{tail:18} {SCALES[best]:6.1f} {by_scale[best]:13.3f}")


if __name__ == "__main__":
    main()
