"""Recorded runs as regression tests: a bag is played again, and what is otherwise is told.

With pytest, name the package in the top `conftest.py`; see `skiros2_bags.testing.plugin`. Without, there is
`rosrun skiros2_bags replay BAG KIND`.
"""

#: pytest loads the plugin with the package, and only pytest does.
pytest_plugins = ["skiros2_bags.testing.plugin"]
