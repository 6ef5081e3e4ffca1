"""A group of facets and a model -> label, pose, confidence; or unknown, with the reason. No image."""

from daemon.vision.recognition.confidence import facet_kind_counts
from daemon.vision.recognition.fits import PoseEvidence, facet_placements, facet_poses, fit_candidates, recall_views
from daemon.vision.recognition.group_recognition import (
    CandidatePose,
    Recognised,
    candidate_poses,
    merge_adjacent,
    recognise_group,
    recognise_groups,
    recognise_part,
    typed_as,
    without_name,
)
