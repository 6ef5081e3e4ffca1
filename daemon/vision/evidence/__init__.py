"""Whether a part is where a hypothesis has it: evidence from both images, competing hypotheses, overlaps.

| module | what it weighs | for or against | called by |
| --- | --- | --- | --- |
| `by_edges` | names parts that facets do not name: all edges against chance, in log odds | both | the look |
| `registered` | grey levels along a part's edges at a pose, in both images | for | `by_edges` |
| `hole_rims` | rims of holes that are there, missing, or of another size | both | `by_edges`, `counter_evidence` |
| `competing` | edges that only another part, orientation or length has | against | both of these |
| `other_sizes` | edges that another size, or radius of arcs, fits better | against | `by_edges`, `by_rounding` |
| `photo_consistency` | whether print and edges agree in depth, a hint at the calibration | neither | `by_edges` |
| `counter_evidence` | whichever way a part got its name: the four below, in one probability | against | the look |
| `edge_places` | edges missing though the levels beside them differ | against | `counter_evidence`, `registered` |
| `near_duplicates` | solids nearly the same that nobody taught | against | `counter_evidence` |
| `off_faces` | edges in front of or behind the faces | against | `counter_evidence` |
| `occlusion` | what nearer objects hide: not missing, after all | for | `counter_evidence`, `registered` |
| `by_rounding`, `corner_rounding` | which of parts that differ in corner radii alone | both | `counter_evidence` |
| `overlaps` | of two parts at one place, one | against | the look |
"""

from daemon.vision.evidence.by_edges import named_by_edges
from daemon.vision.evidence.counter_evidence import verified_names
from daemon.vision.evidence.hole_rims import hole_nats
from daemon.vision.evidence.overlaps import all_accounted_for, without_overlaps
