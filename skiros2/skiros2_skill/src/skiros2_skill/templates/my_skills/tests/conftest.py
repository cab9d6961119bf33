pytest_plugins = ["skiros2_skill.testing"]
