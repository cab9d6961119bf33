"""Ends like a script."""

import sys

sys.exit("nothing to do")
