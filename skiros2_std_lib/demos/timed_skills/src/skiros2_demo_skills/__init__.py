"""A skill library for mobile manipulation: drive, pick and place.

`transport_skills` has these skills as compounds of motions, `motions` the descriptions of the motions, and
`timed_motions` placeholder implementations of the motions without a robot. A library for a real or simulated robot
provides its own implementations of the motions.
"""
