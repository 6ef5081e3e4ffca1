"""Whether a part is where a hypothesis has it: evidence from both pictures, competing hypotheses, overlaps."""

from daemon.vision.evidence.by_edges import named_by_edges
from daemon.vision.evidence.counter_evidence import verified_names
from daemon.vision.evidence.hole_rims import hole_nats
from daemon.vision.evidence.overlaps import all_accounted_for, without_overlaps
