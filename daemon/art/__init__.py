"""The memory: Fuzzy ARTMAP behind a pattern rotation layer. Arrays in, values out; knows nothing of vision, files or
clocks.

`others` has the rest of the ART family, for comparison.
"""

from daemon.art.errors import ArtError, InputError, ParameterError
from daemon.art.relation_artmap import RelationalView, RelationARTMAP

__all__ = ["ArtError", "InputError", "ParameterError", "RelationARTMAP", "RelationalView"]
