"""World model, robots and goal executor in one process, without ROS.

with LocalSystem(Path("owl/scene.ttl")) as system:
    system.add_robot("my_skills:my_robot", ["my_skills", "skiros2_std_skills"], ["drive", "inspect"])
    result = system.achieve("(my_skills:Inspected skiros:Product-5)").wait()
    assert result.reached, result.message
"""

from skiros2_local.system import LocalGoal, LocalRobot, LocalSystem

__all__ = ["LocalGoal", "LocalRobot", "LocalSystem"]
