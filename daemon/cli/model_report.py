"""Reports on models, as text and as JSON values: parts, views, nodes, confusable parts, differences of two models."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from daemon.console.phrases import plural
from daemon.store.model import ModelFile
from daemon.vision.geometry import Polyhedron
from daemon.vision.model import Model
from daemon.vision.recognition import fit_candidates, recall_views

SAME_TYPES = 0.8
"""A vigilance at which a view is recalled by its types only, whatever lengths and angles."""


@dataclass(frozen=True)
class ModelReport:
    """A report as text for people and as values for programs."""

    text: str
    data: dict[str, Any]


def describe(file: ModelFile) -> ModelReport:
    """Describe a model: parts with their shape, nodes with their views, parameters."""
    model = file.model
    parts = [_part(model, label, file.codes.get(label, "")) for label in model.labels]
    nodes = [_node(model, j) for j in range(len(model.artmap.node_labels))]
    p = model.parameters
    data = {
        "trained": file.trained,
        "sha256": file.sha256,
        "parameters": {"rho": p.rho, "alpha": p.alpha, "beta": p.beta, "vigilance": p.vigilance,
                       "tolerance_mm": p.tolerance_mm, "matrix_size": model.artmap.slots},
        "parts": parts,
        "nodes": nodes,
    }  # fmt: skip
    lines = [
        f"trained {file.trained or 'at an unknown time'}, {plural(len(parts), 'part')}, "
        f"{plural(len(model.views), 'view')}"
    ]
    lines += [f"rho {p.rho:g}, alpha {p.alpha:g}, beta {p.beta:g}, vigilance {p.vigilance:g}, "
              f"matrix {model.artmap.slots}x{model.artmap.slots}"]  # fmt: skip
    lines += ["", *_columns(
        ("part", "code", "views", "facets", "corners", "size mm", "not joined"),
        [(r["label"], r["code"], r["views"], r["facets"], r["corners"], f"{r['size_mm']:.1f}",
          ", ".join(r["not_joined"]) or "-") for r in parts],
    )]  # fmt: skip
    shown = [(n["node"], n["label"], ", ".join(n["facets"]), "; ".join(n["views"])) for n in nodes]
    lines += ["", *_columns(("node", "part", "facets", "views"), shown)]
    return ModelReport("\n".join(lines), data)


def _columns(heads: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """Lay out rows below their heads in aligned columns; numbers to the right."""
    cells = [list(heads), *([str(cell) for cell in row] for row in rows)]
    widths = [max(len(line[k]) for line in cells) for k in range(len(heads))]
    right = [all(line[k].replace(".", "").isdecimal() for line in cells[1:]) for k in range(len(heads))]
    return [
        "  ".join(
            text.rjust(width) if to_right else text.ljust(width)
            for text, width, to_right in zip(line, widths, right, strict=True)
        ).rstrip()
        for line in cells
    ]


def check(file: ModelFile) -> ModelReport:
    """Check a model: views that could not be joined, parts that look alike from some side."""
    model = file.model
    warnings = [
        f"{label}: view {source} shares no facet with the others; teach a view in between"
        for label in model.labels
        for source in _not_joined(model, label)
    ]
    pairs = confusable(model)
    warnings += [f"{p['seen']} as {p['taken_for']}: {p['how']}" for p in pairs]
    text = "\n".join(["sound: the file's checksum matches its content", *warnings])
    return ModelReport(text, {"sound": True, "warnings": warnings, "confusable": pairs})


def compare(one: ModelFile, two: ModelFile) -> ModelReport:
    """Compare two models: parts, views and parameters that only one has, and shapes that differ."""
    a, b = one.model, two.model
    removed = [label for label in a.labels if label not in b.labels]
    new = [label for label in b.labels if label not in a.labels]
    lines = [f"- {label}" for label in removed] + [f"+ {label}" for label in new]
    changed: dict[str, list[str]] = {}
    for label in (x for x in a.labels if x in b.labels):
        if differences := _differences(a, b, label):
            changed[label] = differences
            lines += [f"~ {label}: {text}" for text in differences]
    if a.parameters != b.parameters:
        lines.append(f"~ parameters: {a.parameters} -> {b.parameters}")
    if a.library != b.library:
        lines.append("~ facet library")
    data = {"gone": removed, "new": new, "changed": changed, "same": not lines, "sha256": [one.sha256, two.sha256]}
    return ModelReport("\n".join(lines) or "the same", data)


def confusable(model: Model) -> list[dict[str, str]]:
    """Views of one part that another part's pattern fits too; `how`: what distinguishes them."""
    found = list[dict[str, str]]()
    for view in model.views:
        seen, reported = model.solid_of(view), set[str]()
        for count in (len(seen.facets), 2):
            for some in combinations(range(len(seen.facets)), count):
                part = seen.only(some)
                for label, how in _confusable_labels(model, part).items() if part.seams else ():
                    if label != view.label and label not in reported:
                        reported.add(label)
                        found.append({"seen": view.label, "taken_for": label, "how": how})
    unique = {(f["seen"], f["taken_for"], f["how"]): f for f in found}
    return list(unique.values())


def _confusable_labels(model: Model, part: Polyhedron) -> dict[str, str]:
    """Every part that is recalled from these types, and whether lengths and angles distinguish it."""
    ways = [
        (one.label, one.correspondence)
        for one in recall_views(part, [(name,) for name in part.types], model, SAME_TYPES)
        if one.correspondence.explained == len(part.facets)
        and _same_types(part, model.metric[one.label].solid, one.correspondence.facets)
    ]
    found = dict[str, str]()
    for label in dict.fromkeys(label for label, _ in ways):
        own = [way for way in ways if way[0] == label]
        best = fit_candidates(part, model.metric, own, model.parameters.tolerance_mm)[0]
        decided = "lengths and angles do not distinguish them" if best.tail > 1e-4 else (
            f"lengths and angles distinguish them ({best.rms_mm:.1f} mm rms)"
        )  # fmt: skip
        found[label] = f"{', '.join(part.types)} alone have the same pattern; {decided}"
    return found


def _same_types(seen: Polyhedron, taught: Polyhedron, facets: tuple[int, ...]) -> bool:
    return all(seen.types[f] == taught.types[g] for f, g in enumerate(facets))


def _part(model: Model, label: str, code: str) -> dict[str, Any]:
    metric = model.metric[label]
    return {
        "label": label,
        "code": code,
        "views": sum(v.label == label for v in model.views),
        "facets": len(metric.solid.facets),
        "corners": len(metric.solid.corners_mm),
        "size_mm": round(metric.solid.size_mm, 2),
        "not_joined": _not_joined(model, label),
    }


def _not_joined(model: Model, label: str) -> list[str]:
    own = [v for v in model.views if v.label == label]
    return [v.source or f"view {i + 1}" for i, v in enumerate(own) if i not in model.metric[label].joined]


def _node(model: Model, node: int) -> dict[str, Any]:
    behind = [v for v in model.views if v.node == node]
    return {
        "node": node + 1,
        "label": model.artmap.node_labels[node],
        "facets": list(model.solid_of(behind[0]).types) if behind else [],
        "views": [v.source or "?" for v in behind],
    }


def _differences(a: Model, b: Model, label: str) -> list[str]:
    found = []
    views = [sum(v.label == label for v in m.views) for m in (a, b)]
    if views[0] != views[1]:
        found.append(f"{views[0]} -> {views[1]} views")
    one, two = a.metric[label].solid, b.metric[label].solid
    if len(one.facets) != len(two.facets):
        found.append(f"{len(one.facets)} -> {len(two.facets)} facets")
    elif one.corners_mm.shape == two.corners_mm.shape:
        apart = float(np.abs(one.corners_mm - two.corners_mm).max())
        if apart > 0:
            found.append(f"corners up to {apart:.2f} mm apart")
    return found
