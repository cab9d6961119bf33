"""A skill library for mobile pick-and-place: drive, pick and place, made of motions of base, arm and gripper.

`transport_skills` holds what the robot can do and how, `motions` the motions it is made of, `timed_motions` stand-ins
for these that take time and move nothing. A library for a real or simulated robot brings other implementations of the
motions.
"""
