"""Whether a part is where a hypothesis has it: evidence from both images, competing hypotheses, overlaps.

| module | what it weighs | called by |
| --- | --- | --- |
| `by_edges` | names parts that facets do not name: all edges against chance, in log odds | the look |
| `registered`, `edge_places` | for: edges of a part at a pose, in both images | `by_edges`, `counter_evidence` |
| `hole_rims` | for and against: rims of holes that are there, or missing | `by_edges` |
| `near_duplicates`, `other_sizes` | against: another part, taught or not, or size that fits better | both of these |
| `counter_evidence` | against, whichever way a part got its name: edges missing, edges off its faces | the look |
| `off_faces`, `occlusion` | edges in front of or behind the faces; what nearer objects hide | `counter_evidence` |
| `by_rounding`, `corner_rounding` | which of parts that differ in their corners' radii alone | `counter_evidence` |
| `photo_consistency` | no odds: whether print and edges agree in depth, a hint at the calibration | `by_edges` |
| `overlaps` | of two parts at one place, one | the look |
"""

from daemon.vision.evidence.by_edges import named_by_edges
from daemon.vision.evidence.counter_evidence import verified_names
from daemon.vision.evidence.hole_rims import hole_nats
from daemon.vision.evidence.overlaps import all_accounted_for, without_overlaps
