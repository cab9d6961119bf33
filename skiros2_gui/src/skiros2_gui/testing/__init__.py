"""Test doubles: synchronous jobs and a system in this process."""
