"""A polyhedron as a STEP file (AP214), for tests: there is no small library that writes one."""

from __future__ import annotations

import numpy as np

from daemon.vision.geometry import area_vector, sides_of

HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));
ENDSEC;
DATA;
"""


class _Lines:
    def __init__(self) -> None:
        self.lines: list[str] = []

    def add(self, text: str) -> str:
        self.lines.append(text)
        return f"#{len(self.lines)}"

    def point(self, at: np.ndarray) -> str:
        return self.add(f"CARTESIAN_POINT('',{_triple(at)})")

    def direction(self, way: np.ndarray) -> str:
        return self.add(f"DIRECTION('',{_triple(way / np.linalg.norm(way))})")

    def frame(self, at: np.ndarray, z: np.ndarray, x: np.ndarray) -> str:
        return self.add(f"AXIS2_PLACEMENT_3D('',{self.point(at)},{self.direction(z)},{self.direction(x)})")


def step_file(corners: np.ndarray, rings: list[tuple[int, ...]], unit: str = "MILLI") -> bytes:
    """unit: STEP's prefix of metre, in which the corners (K, 3) are."""
    made = _Lines()
    faces = _faces(made, corners, rings)
    shell = made.add(f"CLOSED_SHELL('',({','.join(faces)}))")
    brep = made.add(f"MANIFOLD_SOLID_BREP('',{shell})")
    length = made.add(f"(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.{unit}.,.METRE.))")
    angle = made.add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
    solid = made.add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
    unsure = made.add(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-07),{length},'','')")
    context = made.add(
        f"(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({unsure}))"
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid}))REPRESENTATION_CONTEXT('',''))"
    )
    frame = made.frame(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]))
    shape = made.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',({frame},{brep}),{context})")
    _product(made, shape)
    body = "\n".join(f"#{k}={text};" for k, text in enumerate(made.lines, 1))
    return f"{HEAD}{body}\nENDSEC;\nEND-ISO-10303-21;\n".encode()


def _faces(made: _Lines, corners: np.ndarray, rings: list[tuple[int, ...]]) -> list[str]:
    ends = [made.add(f"VERTEX_POINT('',{made.point(corner)})") for corner in corners]
    edges: dict[tuple[int, int], str] = {}
    faces = []
    for ring in rings:
        sides = []
        for a, b in sides_of(ring):
            if (b, a) not in edges:
                vector = made.add(f"VECTOR('',{made.direction(corners[b] - corners[a])},1.)")
                line = made.add(f"LINE('',{made.point(corners[a])},{vector})")
                edges[a, b] = made.add(f"EDGE_CURVE('',{ends[a]},{ends[b]},{line},.T.)")
            edge, along = (edges[a, b], "T") if (a, b) in edges else (edges[b, a], "F")
            sides.append(made.add(f"ORIENTED_EDGE('',*,*,{edge},.{along}.)"))
        points = corners[list(ring)]
        loop = made.add(f"EDGE_LOOP('',({','.join(sides)}))")
        bound = made.add(f"FACE_OUTER_BOUND('',{loop},.T.)")
        plane = made.add(f"PLANE('',{made.frame(points[0], area_vector(points), points[1] - points[0])})")
        faces.append(made.add(f"ADVANCED_FACE('',({bound}),{plane},.T.)"))
    return faces


def _product(made: _Lines, shape: str) -> None:
    use = made.add("APPLICATION_CONTEXT('automotive design')")
    made.add(f"APPLICATION_PROTOCOL_DEFINITION('','automotive_design',2000,{use})")
    kind = made.add(f"PRODUCT_CONTEXT('',{use},'mechanical')")
    product = made.add(f"PRODUCT('part','part','',({kind}))")
    version = made.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
    stage = made.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{use},'design')")
    definition = made.add(f"PRODUCT_DEFINITION('design','',{version},{stage})")
    whole = made.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
    made.add(f"SHAPE_DEFINITION_REPRESENTATION({whole},{shape})")


def _triple(values: np.ndarray) -> str:
    """STEP's real numbers have a point."""
    return "(" + ",".join(f"{value:.9f}" for value in values) + ")"
