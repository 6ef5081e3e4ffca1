"""`facetctl recognise` for which no time passes: what a look names must not hang on how fast the computer is."""

import sys
import time

from daemon import ctl

if __name__ == "__main__":
    time.thread_time = lambda: 0.0
    sys.exit(ctl.main(["recognise", *sys.argv[1:]]))
