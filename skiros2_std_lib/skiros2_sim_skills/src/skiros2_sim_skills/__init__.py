"""A skill library for mobile manipulators that work through the interfaces of their drivers: drive, look, pick, place.

`transport` says what a robot can do, `compounds` how. `motions` describes the motions that the pick-and-place demo
without physics lacks; `base_motion`, `arm_motions`, `planned_motions`, `gripper_motions`, `controllers` and
`look_around` have drivers do them. Which drivers, postures and sizes these are, the elements of the world model tell
(`core`): nothing here knows whether the robot is simulated.
"""
