"""The command line of synthnet."""
