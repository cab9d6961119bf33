"""The first import of node programs: an interrupt before the node runs ends the process without a traceback.

`run_node` replaces the handler. Launches are often interrupted this early: a second one ends at once.

Until then, Python's garbage collector makes no collections either. Nearly all that imports make stays; visiting it
again and again takes a tenth of a node's start.
"""

import gc
import signal

signal.signal(signal.SIGINT, signal.SIG_DFL)
gc.disable()
