"""Signals to and from the line: digital inputs and outputs of the controller, by name and role. What they are, how an
input is read on this controller, what each says of the cell. Which commands an operator has is daemon/commands'."""
