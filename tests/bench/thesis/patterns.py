"""The thesis's experiments on patterns: silhouettes, numbering, the 14 test views. The same on every machine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daemon import frames
from daemon.art import ART1
from daemon.store.library import load_facets
from daemon.vision.facets.grouping import merge_vertices
from daemon.vision.model import Model, empty_model, learn_view, relational_view, types_of
from daemon.vision.recognition.group_recognition import recognise_part
from daemon.vision.thesis import silhouette
from daemon.vision.values import Group
from tests.bench.networks import FuzzyARTMAP, best_numbering, choose
from tests.bench.thesis.document import table
from tests.fakes.solids import KNOWN, Body, measured, pose
from tests.fakes.thesis import ALPHA, NODE_LABELS, NODES, PRINTED, RHO, renumbered
from tests.fakes.thesis_scenes import OUTLINES, silhouette_picture

RENUMBERINGS = 50
DISTURBED = (
    ("shifted by 60, -40 px", {"shift_px": (60, -40)}),
    ("turned by 3 degrees", {"turn_deg": 3.0}),
    ("turned by 10 degrees", {"turn_deg": 10.0}),
    ("turned by 45 degrees", {"turn_deg": 45.0}),
    ("at 0.7 of its size", {"scale": 0.7}),
)


def silhouettes_table() -> str:
    """Section 4.1: which node each silhouette calls up, by vigilance."""
    shapes = np.stack([silhouette(silhouette_picture(name)) for name in OUTLINES])
    rows = []
    for rho in (0.2, 0.3, 0.4, 0.5, 0.6):
        nodes = ART1(rho=rho, capacity=4).learn(shapes).tolist()
        again = ART1(rho=rho, capacity=4).learn(shapes[[0, 1, 3, 0]]).tolist()
        own = "its own" if again[-1] == again[0] else "another"
        rows.append([f"{rho:g}", *(str(n + 1) for n in nodes), str(len(set(nodes))), own])
    return table(["vigilance", *OUTLINES, "categories", "floppy shown again calls up"], rows)


def disturbed_table() -> str:
    """Section 4.1, observations: the node that each object calls up when shown again otherwise, vigilance 0.4."""
    network = ART1(rho=0.4, capacity=4)
    own = network.learn(np.stack([silhouette(silhouette_picture(name)) for name in OUTLINES])).tolist()
    rows = []
    for said, change in DISTURBED:
        shapes = np.stack([silhouette(silhouette_picture(name, **change)) for name in OUTLINES])
        called = network.predict(shapes).tolist()
        answers = ["its own" if c == k else "none" if c < 0 else "another" for c, k in zip(called, own, strict=True)]
        rows.append([said, *answers])
    return table(["shown again", *OUTLINES], rows)


def numbering_table() -> str:
    """Section 5.4: views whose facets are numbered otherwise than taught, without the rotation layer and with it."""
    rng = np.random.default_rng(0)
    first = FuzzyARTMAP(rho=0.9, alpha=0.1, beta=1.0).fit(NODES.reshape(-1, 36), list(NODE_LABELS))
    rows, sums = [], np.zeros(2, int)
    for node, label in zip(NODES, NODE_LABELS, strict=True):
        shown = [renumbered(node, rng) for _ in range(RENUMBERINGS)]
        without = sum(first.predict(np.stack(shown).reshape(-1, 36)) == label)
        layer = [choose(best_numbering(view, NODES, ALPHA, complement=False), NODE_LABELS, RHO) for view in shown]
        right = without, sum(one.label == label for one in layer)
        sums += right
        rows.append([label, str(len(_occupied(node))), *map(str, right)])
    rows.append(["all", "", *map(str, sums)])
    heads = ["taught view of", "facets", f"first system, right of {RENUMBERINGS}", "with the rotation layer"]
    return table(heads, rows)


def activations_table() -> str:
    """Figures 5.23 to 5.26: printed, computed his way, with all numberings, and by the memory that facetd uses."""
    memory = empty_model(load_facets())
    for name, facets in TAUGHT_FACETS:
        memory = learn_view(memory, _shown(KNOWN[name], facets), name)
    rows = []
    for printed in PRINTED:
        his = choose(best_numbering(printed.view, NODES, ALPHA, complement=False, scope="occupied"), NODE_LABELS, RHO)
        every = choose(best_numbering(printed.view, NODES, ALPHA, complement=False), NODE_LABELS, RHO)
        activation = "" if printed.activation is None else f", {printed.activation:g}"
        rows.append([printed.figure, printed.truth, f"{printed.said}, {printed.ratio:g}{activation}",
                     f"{his.label}, {his.match_ratio:.3f}, {his.activation:.3f}",
                     f"{every.label}, {every.match_ratio:.3f}, {every.activation:.3f}",
                     _ours(memory, printed.truth, printed.facets)])  # fmt: skip
    return table(["figure", "shown", "printed: prediction, match ratio, activation", "computed his way",
                   "all six slots, types alone", "facetd: recalled, name"], rows)  # fmt: skip


TAUGHT_FACETS = (
    ("cube", (1, 2, 3)),
    ("pyramid", (1, 2, 3, 4)),
    ("pyramid", (0, 1, 2)),
    ("triangular_prism", (1, 2, 3)),
    ("pentagonal_prism", (1, 2, 3, 4)),
    ("pentagonal_prism", (1, 2, 3)),
)
"""Figure 5.22 on solids with measures: the facets that each training view shows (tests/fakes/solids.py)."""


def _ours(memory: Model, truth: str, facets: Sequence[int]) -> str:
    """The labels that the memory recalls for facets of a part, and the name that measurement leaves."""
    group = _shown(KNOWN[truth.replace(" ", "_")], facets)
    types = types_of(group.facets, memory.library)
    view = relational_view(group.polyhedron, types, memory.library, memory.parameters.tolerance_mm)
    found = memory.artmap.recall(view, memory.parameters.vigilance)
    recalled = dict.fromkeys(memory.artmap.node_labels[node].replace("_", " ") for node in found.node.tolist())
    named = recognise_part(group, memory).recognition
    return f"{' or '.join(recalled) or 'nothing'}; {named.label.replace('_', ' ')}"


def _shown(body: Body, facets: Sequence[int]) -> Group:
    """Some facets of a body as a look measures them, seen from where they face."""
    rings = [body.corners_mm[list(body.facets[f])] for f in facets]
    normals = [np.cross(r[1] - r[0], r[2] - r[1]) for r in rings]
    towards = np.sum([n / np.linalg.norm(n) for n in normals], axis=0)
    placed = pose(towards, 0.3)
    return merge_vertices(tuple(measured(frames.apply(placed, ring), None) for ring in rings))


def _occupied(view: np.ndarray) -> np.ndarray:
    return np.flatnonzero(view.any(1) | view.any(0))
