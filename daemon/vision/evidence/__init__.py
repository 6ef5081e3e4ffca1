"""Whether a part is where a hypothesis has it: evidence from both pictures, competing hypotheses, overlaps."""

from daemon.vision.evidence.by_edges import named_by_segments
from daemon.vision.evidence.missing import with_all_they_show
from daemon.vision.evidence.overlaps import all_explained, beside

__all__ = ["all_explained", "beside", "named_by_segments", "with_all_they_show"]
