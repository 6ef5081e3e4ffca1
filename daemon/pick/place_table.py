"""The places of a cell, each with its goal and its status on disk: where the next part may be brought to."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from daemon.pick.planning import Goal, PartPlaceError, goal_of, too_tight
from daemon.store.place_file import CellPlaces
from daemon.store.place_status import FILLABLE, UNSEEN, PlaceStatus, PlaceStatuses
from daemon.vision.geometry import Polyhedron


@dataclass(eq=False)
class PlaceTable:
    """The places of a cell with their status: where a part goes, and what became of it.

    goals: of the places whose part is known, by name; unusable: why each of the others has none. Both are renewed with
    the model.
    """

    places: CellPlaces = field(default_factory=CellPlaces)
    statuses: PlaceStatuses = field(default_factory=lambda: PlaceStatuses(Path()))
    goals: Mapping[str, Goal] = field(default_factory=dict)
    unusable: Mapping[str, str] = field(default_factory=dict)

    @property
    def labels(self) -> set[str]:
        return {place.part for place in self.places.places}

    def status(self, name: str) -> PlaceStatus:
        """The status of a place. Raises FileError."""
        return self.statuses.of(name).status

    def know(self, shapes: Mapping[str, Polyhedron]) -> None:
        """Take the shapes of the parts."""
        goals, unusable = {}, {}
        for place in self.places.places:
            shape = shapes.get(place.part)
            try:
                if shape is None:
                    raise PartPlaceError(f"no part {place.part} is taught")
                goals[place.name] = goal_of(place, shape)
            except PartPlaceError as error:
                unusable[place.name] = str(error)
        tight = too_tight(goals)
        self.goals = {name: goal for name, goal in goals.items() if name not in tight}
        self.unusable = unusable | tight
        self.statuses.know({name: goal.spot for name, goal in goals.items()})

    def has(self, label: str) -> bool:
        """Whether parts of this label go to places, and not to the bin."""
        return label in self.labels

    def free(self, label: str, name: str | None = None) -> list[Goal]:
        """Goals that a part may be brought to, in the order in which they are filled; name: only this place, or those
        of this pattern. Raises FileError."""
        return [
            self.goals[place.name]
            for place in self.places.of(label, name)
            if place.name in self.goals
            and self.status(place.name) in FILLABLE
            and (place.on_top_of is None or self.status(place.on_top_of) is PlaceStatus.RIGHT)
        ]

    def taken(self) -> list[Goal]:
        """Goals at which something lies, or may lie. Raises FileError."""
        return [goal for name, goal in self.goals.items() if self.status(name) not in FILLABLE]

    def unseen(self) -> list[Goal]:
        """Goals that are to be looked at first: a pick that was cut off has left them, or they have moved. Raises
        FileError."""
        return [goal for name, goal in self.goals.items() if self.status(name) in UNSEEN]

    def moved(self) -> dict[str, str]:
        """Why each place is to be looked at that has moved since its status was kept, or lies where something was left.
        Raises FileError."""
        states = {name: self.statuses.of(name) for name in self.goals}
        return {name: state.why for name, state in states.items() if state.status is PlaceStatus.TO_LOOK_AT}
