"""A skill library for depth cameras: `estimate_pose` locates a known object, `observe_scene` compares a view with the
world model. `core` computes, without ROS; `ros` reads images, point clouds and tf."""
