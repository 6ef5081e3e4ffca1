"""The line's signals: digital inputs and outputs of the controller, and coils of a PLC, by name and role.

Settings, how this controller reads an input, hand-shakes, PackML's state. daemon/commands/signals.py has the command.
"""
