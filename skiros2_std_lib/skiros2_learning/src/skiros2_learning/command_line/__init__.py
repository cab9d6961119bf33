"""The program `learn`."""
