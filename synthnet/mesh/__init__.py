"""Triangle meshes: facts about them, isometries, reading files of strangers and repairing them."""
