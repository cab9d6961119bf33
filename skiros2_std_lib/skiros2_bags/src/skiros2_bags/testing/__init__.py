"""Recorded runs as regression tests: re-runs a bag and reports the first divergence.

For pytest, name this package in the top `conftest.py`; see `skiros2_bags.testing.plugin`. For the command line, there
is `rosrun skiros2_bags replay BAG`.
"""

#: Loaded by pytest only.
pytest_plugins = ["skiros2_bags.testing.plugin"]
