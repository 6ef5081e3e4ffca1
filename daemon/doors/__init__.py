"""Where operators come in: the serial terminal, the socket, its client and the prompt. What words mean is console's."""
