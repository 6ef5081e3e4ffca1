"""The memory: Fuzzy ARTMAP behind a pattern rotation layer. Pure: arrays in, values out.

others/ has the rest of the ART family: ART 1 for the thesis's silhouettes, the others for comparison.
"""

from daemon.art.errors import ArtError, InputError, ParameterError
from daemon.art.relation_artmap import RelationalView, RelationARTMAP

__all__ = ["ArtError", "InputError", "ParameterError", "RelationARTMAP", "RelationalView"]
