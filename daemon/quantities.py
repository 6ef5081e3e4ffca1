"""Numbers of the configuration as types: what a value may be at all. The unit is in the field's name.

A limit that is no number compares with nothing and so would never refuse: each of these has two ends, and neither takes
it. Whoever types a section by them (daemon/store/yamlfile.py) refuses what lies outside with its file, line and key.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

Coordinate = Annotated[float, Meta(ge=-5000, le=5000)]
Length = Annotated[float, Meta(gt=0, le=5000)]
Room = Annotated[float, Meta(ge=0, le=500)]
Direction = Annotated[float, Meta(ge=-360, le=360)]
Lean = Annotated[float, Meta(ge=-90, le=90)]
Turn = Annotated[float, Meta(gt=0, le=360)]
Sigma = Annotated[float, Meta(gt=0, le=100)]
Percent = Annotated[float, Meta(ge=0.1, le=100)]
Share = Annotated[float, Meta(gt=0, le=1)]
Seconds = Annotated[float, Meta(gt=0, le=3600)]
Pixels = Annotated[float, Meta(gt=0, le=100)]
Few = Annotated[int, Meta(ge=1, le=100)]
Name = Annotated[str, Meta(min_length=1, max_length=4096)]
