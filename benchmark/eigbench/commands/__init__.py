"""The command line of eigbench."""
