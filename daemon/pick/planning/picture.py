"""The picture of `place plan`: each pick and set-down, part and gripper, as an SVG. Pure."""

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from daemon import frames
from daemon.arm import HandBody
from daemon.arrays import Array
from daemon.pick.planning.place_plan import SidePlan
from daemon.vision.geometry import Polyhedron

CELL_PX, HEAD_PX, FLOOR = 190, 26, 0.8
"""Size of one drawing, height of a line of text, and where in a drawing the table is."""
DOWN_RAD, ASIDE_RAD = 0.35, 0.45
"""From how far above, and how far round from the line between the fingers, it is looked at."""


def plan_picture(shape: Polyhedron, plans: Mapping[str, Sequence[SidePlan]], hand: HandBody) -> bytes:
    """A row for each side, by place: taken, set down, taken ... to the place; or why not."""
    rows, most = list[str](), 1
    for name, each in plans.items():
        for plan in each:
            count = len(plan.motions)
            text = f"{count} grasp{'s' * (count != 1)}, {plan.found} of {plan.tried} headings" if count else plan.why
            poses = [(m.part_taken, m.tool_taken, "take") for m in plan.motions]
            ends = ["lay down"] * (count - 1) + ["set down"]
            laid = [(m.part_laid, m.tool_laid, end) for m, end in zip(plan.motions, ends, strict=False)]
            steps = [one for pair in zip(poses, laid, strict=True) for one in pair]
            most = max(most, len(steps))
            y = len(rows) * (CELL_PX + HEAD_PX)
            cells = [_cell(shape, hand, *step, k * CELL_PX, HEAD_PX) for k, step in enumerate(steps)]
            head = f'<text x="6" y="18">{escape(f"{name}, from side {plan.side} down: {text}")}</text>'
            rows.append(f'<g transform="translate(0 {y})">{head}{"".join(cells)}</g>')
    width, height = max(most * CELL_PX, 640), len(rows) * (CELL_PX + HEAD_PX)
    style = (
        "text{font:13px sans-serif}.part{fill:#9bd;fill-opacity:.75;stroke:#124}.hand{stroke:#444;stroke-opacity:.5}"
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}">'
        f"<style>{style}</style>"
        f'<rect width="100%" height="100%" fill="#fff"/>{"".join(rows)}</svg>'
    ).encode()


def _cell(shape: Polyhedron, hand: HandBody, part: Array, tool: Array, text: str, x: int, y: int) -> str:
    """One drawing: the part in front of the hand's far side, and behind its near one."""
    corners = frames.apply(part, shape.corners_mm)
    ends = [frames.apply(tool, np.array([c.from_mm, c.to_mm])) for c in hand.capsules]
    scale = 0.5 * CELL_PX / float(np.ptp(np.vstack([corners, *ends]), axis=0).max())
    right, up, towards = _view(tool)
    middle, floor_mm = corners.mean(axis=0), float(corners[:, 2].min())
    origin = np.array([middle[0], middle[1], floor_mm])

    def flat(points: Array) -> Array:
        local = (points - origin) * scale
        return np.column_stack([CELL_PX / 2 + local @ right, FLOOR * CELL_PX - local @ up])

    drawn = list[tuple[float, str]]()
    for (a, b), capsule in zip(map(flat, ends), hand.capsules, strict=True):
        depth = float((frames.apply(tool, np.array([capsule.from_mm]))[0] - middle) @ towards)
        wide = 2.0 * capsule.radius_mm * scale
        drawn.append((depth, f'<line class="hand" stroke-width="{wide:.1f}" stroke-linecap="round" '
                             f'x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}"/>'))  # fmt: skip
    faces = shape.normals @ part[:3, :3].T @ towards
    for ring, faced in zip(shape.rings, faces, strict=True):
        if faced > 0.0:
            points = " ".join(f"{u:.1f},{v:.1f}" for u, v in flat(corners[ring]))
            drawn.append(
                (float((corners[ring].mean(axis=0) - middle) @ towards), f'<polygon class="part" points="{points}"/>')
            )
    shapes = "".join(text for _, text in sorted(drawn, key=lambda each: each[0]))
    table = f'<line x1="10" x2="{CELL_PX - 10}" y1="{FLOOR * CELL_PX}" y2="{FLOOR * CELL_PX}" stroke="#a86"/>'
    label = f'<text x="10" y="{CELL_PX - 8}">{escape(text)}</text>'
    return f'<g transform="translate({x} {y})">{table}{shapes}{label}</g>'


def _view(tool: Array) -> tuple[Array, Array, Array]:
    """(3,) each: to the right, up and towards who looks, for a drawing that shows how far a tool (4, 4) leans."""
    heading = float(np.arctan2(tool[1, 1], tool[0, 1])) + ASIDE_RAD
    across, ahead = np.cos(heading), np.sin(heading)
    towards = np.array([np.cos(DOWN_RAD) * across, np.cos(DOWN_RAD) * ahead, np.sin(DOWN_RAD)])
    right = np.array([-ahead, across, 0.0])
    return right, np.cross(towards, right), towards
