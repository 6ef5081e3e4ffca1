"""The VAL II link: the protocol without I/O (wire), locations, the commands' text, and the serial link itself."""
