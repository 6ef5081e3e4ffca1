"""The memory: Fuzzy ARTMAP behind a pattern rotation layer; ART 1 for the thesis's silhouettes. Pure: arrays in, values
out. The rest of the ART family, for comparison, is in tests/bench/networks/.
"""

from daemon.art.art1 import ART1
from daemon.art.errors import ArtError, InputError, ParameterError
from daemon.art.relation_artmap import RelationalView, RelationARTMAP
