"""Libraries, scenes and programs written for SkiROS2, as callers use them: one test for each rule they rely on."""
