"""A skill library for compliant arms: contact, search, insertion, pull test.

The skills command an arm through one port, `core.compliant_arm`, with adapters for the simulator in this process and
for the controllers of laboratories over ROS.
"""
