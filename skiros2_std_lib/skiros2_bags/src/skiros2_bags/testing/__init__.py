"""Recorded runs as regression tests: replays a bag and reports the first divergence.

For pytest, name this package in the top `conftest.py`; see `skiros2_bags.testing.plugin`. For the command line, there
is `rosrun skiros2_bags replay BAG KIND`.
"""

#: Loaded by pytest only.
pytest_plugins = ["skiros2_bags.testing.plugin"]
