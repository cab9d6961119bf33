"""Goals: completion, planning and execution."""
