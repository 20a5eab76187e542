"""Contacts that a controller relies on, and that its simulation does not have.

The ground and the walls of a simulation push, with friction. A grip in the air, or a hand that
leans on a wall that nobody built, exists in the controller alone, and its robot falls.
"""

from __future__ import annotations

from wbc.constraints.contact import Contact
from wbc.constraints.mechanics import holds_bolted
from wbc.controllers.torque_tick import TorqueTick
from wbc.simulation.plant import Plant
from wbc.validate import Array

LOADED = 0.01  # of the robot's weight: a contact that should bear less is not missed


class UnmetContacts:
    """Watches a simulation for contacts that nothing there meets."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._grips: dict[str, bool] = {}  # of the contacts that should have borne load, by frame
        self._touching = set[int]()  # joints whose links touch anything of the world

    def add(self, tick: TorqueTick) -> None:
        """Count a control period, at its end."""
        robot = self._plant.robot
        for link in set(self._plant.contacts.links):
            self._touching.add(robot.frame(link).parentJoint)
        wanted: dict[str, Array] = {}
        for part in tick.reaction.layout.parts:
            contact = part.contact
            if not isinstance(contact, Contact) or holds_bolted(contact):
                continue
            if contact.frame not in self._grips:
                wanted = wanted or tick.forces
                if abs(wanted[contact.name][:3]).max() > LOADED * robot.weight:
                    self._grips[contact.frame] = contact.friction is None

    @property
    def notes(self) -> tuple[str, ...]:
        """What the controller relied on in vain, in words."""
        robot, touching = self._plant.robot, self._touching
        missing = [one for one in self._grips if robot.frame(one).parentJoint not in touching]
        grips = [one for one, grip in self._grips.items() if grip and one not in missing]
        notes = []
        if missing:
            notes.append(
                f"nothing touched {', '.join(missing)}, where the controller relied on forces: the"
                " simulation has the ground, and steps and walls of its terrain"
            )
        if grips:
            notes.append(
                f"{', '.join(grips)}: grips of the controller alone, where the simulation's ground"
                " pushes, with friction, and never pulls"
            )
        return tuple(notes)
