"""The first import of node programs: an interrupt before the node runs ends the process without a traceback.

`run_node` replaces the handler. Launches are often interrupted this early: a second one ends at once.
"""

import signal

signal.signal(signal.SIGINT, signal.SIG_DFL)
